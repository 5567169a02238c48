"""What a model's error looked like when it was identified: what comes back of it is no news.

A model never explains everything, and what it leaves hangs on the arm's state: friction of another
law than the model's looks like a little presliding in every motion. The samples that it was
identified on show how much of each cause that is; another recording brings news as far as it shows
more of it, or less.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.diagnosis.candidate import Candidate
from dvrk_gravity.diagnosis.cross_validation import CrossValidation
from dvrk_gravity.diagnosis.filtered_data import FilteredData, FilterSettings
from dvrk_gravity.diagnosis.load import LoadSettings
from dvrk_gravity.diagnosis.motion import MeasuredMotion
from dvrk_gravity.estimation.covariance import squared_distance

Array = NDArray[np.float64]

_PARTS = np.linspace(0.0, 1.0, 21)  # of what is expected, that are tried; the first: nothing


@dataclass(frozen=True, eq=False)
class Expected:
    """What of a cause is expected though nothing has changed.

    Attributes:
        mean: (k,) parameters.
        variance: (k, k) of them.
    """

    mean: Array
    variance: Array

    def news(self, theta: Array, covariance: Array) -> float:
        """Return which part of the evidence of a cause is of a change.

        By squared distances in units of the covariance (Mahalanobis): of the parameters from the
        nearest between nothing and all that is expected, over that from nothing. Another motion
        may show less of it, and that is no news either. How uncertain it is what comes back widens
        intervals only: a calibration that hardly tells must not swallow what another motion shows.

        Args:
            theta: (k,) parameters in the recording on trial.
            covariance: (k, k) of them.
        """
        whole = squared_distance(theta, covariance)
        change = min(
            squared_distance(theta - part * self.mean, covariance) for part in _PARTS.tolist()
        )
        return change / whole if whole > 0.0 else 1.0

    @property
    def spread(self) -> Array:
        """(k, k) by how much parameters may differ for what comes back.

        Its second moment: whether it is this cause or another error of the model, the samples of
        its calibration do not tell.
        """
        return np.asarray(self.variance + np.outer(self.mean, self.mean))


class AtCalibration:
    """Fits of hypotheses to what a model leaves of the samples that it was identified on."""

    def __init__(self, validation: CrossValidation) -> None:
        """Take a validation of these samples."""
        self._validation = validation
        self._found: dict[tuple[object, ...], Expected | None] = {}

    @classmethod
    def of(cls, motion: MeasuredMotion) -> AtCalibration | None:
        """Return those of the model of a motion; ``None`` where they are not kept, or too few."""
        uncertainty = motion.model.uncertainty
        kept = None if uncertainty is None else uncertainty.calibration
        if uncertainty is None or kept is None or motion.reference is not None:
            return None
        shortest = LoadSettings().shortest * kept.rate
        if max(part.stop - part.start for part in kept.parts) < shortest:
            return None
        if not motion.present.all():
            return None
        then = MeasuredMotion(
            motion.model, kept.q, kept.qd, kept.qdd, kept.effort, None,
            np.arange(len(kept.q)) / kept.rate + kept.part, kept.parts, kept.rate, motion.present,
            motion.step,
        )  # fmt: skip
        data = FilteredData.of(then, FilterSettings(band=uncertainty.band))
        # The efforts went through that filter when they were read.
        left = data.reduce_state(then.effort) - data.reduce(then.modelled)
        validation = CrossValidation(replace(data, residual=left))
        return cls(validation)

    def comes_back(self, candidate: Candidate) -> Expected | None:
        """Return what of a cause is expected where nothing has changed; ``None``: nothing.

        A part of the known error may look like any cause, in one motion and not in another
        (``SignificanceSettings.coherent``). What was left at calibration is expected to come back
        as far as it is more than that: of parameters phi with covariance F there,
        (1 - 1/s) phi ± (1 - 1/s) F, with s = phi' F^-1 phi / k where that is above 1, after James
        and Stein (1961) with the variance as Efron and Morris (1973) have it. What does not come
        back with the arm's state, or was not felt there, is not expected.
        """
        hypothesis = candidate.hypothesis
        key = (*hypothesis.key, candidate.size, *sorted(hypothesis.setting.items()))
        if key not in self._found:
            self._found[key] = self._expected(candidate)
        return self._found[key]

    def _expected(self, on_trial: Candidate) -> Expected | None:
        hypothesis, validation = on_trial.hypothesis, self._validation
        if hypothesis.transient or hypothesis.of_model:
            return None
        candidate = validation.data.candidate(hypothesis)
        if not validation.size(candidate, np.ones(candidate.size)).any():
            return None
        theta, covariance = validation.fit([candidate])
        more = squared_distance(theta, covariance) / len(theta)
        if more <= 1.0:
            return None
        part = 1.0 - 1.0 / more
        return Expected(part * theta, part * covariance)
