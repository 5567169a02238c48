"""What a model's error looked like when it was identified: what comes back of it is no news.

A model never explains everything, and what it leaves hangs on the arm's state: friction of another
law than the model's looks like a little presliding in every motion. The samples that it was
identified on show how much of each cause that is; another recording brings news as far as it shows
more of it, or less.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.diagnosis.candidate import Candidate
from dvrk_gravity.diagnosis.cross_validation import CrossValidation
from dvrk_gravity.diagnosis.filtered_data import FilteredData, FilterSettings
from dvrk_gravity.diagnosis.load import LoadSettings
from dvrk_gravity.diagnosis.motion import MeasuredMotion

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Expected:
    """Parameters of a cause, and what of them is expected though nothing has changed.

    Attributes:
        theta: (k,) parameters in the recording on trial.
        covariance: (k, k) of them.
        mean: (k,) what comes back of them.
        variance: (k, k) of that.
    """

    theta: Array
    covariance: Array
    mean: Array
    variance: Array

    @property
    def news(self) -> float:
        """Which part of the evidence of the cause is of a change.

        By squared distances, each in units of its covariance (Mahalanobis): of the parameters from
        what is expected, over that from zero.
        """
        change = _distance(self.theta - self.mean, self.covariance + self.variance)
        whole = _distance(self.theta, self.covariance)
        return min(change / whole, 1.0) if whole > 0.0 else 1.0

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
        self._found: dict[tuple[object, ...], tuple[Array, Array] | None] = {}

    @classmethod
    def of(cls, motion: MeasuredMotion) -> AtCalibration | None:
        """Return those of the model of a motion; ``None`` where they are not kept, or too few."""
        uncertainty = motion.model.uncertainty
        kept = None if uncertainty is None else uncertainty.calibration
        if uncertainty is None or kept is None or motion.reference is not None:
            return None
        if len(kept.q) < LoadSettings().shortest * kept.rate or not motion.present.all():
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

    def comes_back(
        self, validation: CrossValidation, candidates: Sequence[Candidate], index: int
    ) -> Expected:
        """Return what of a cause is expected where nothing has changed.

        Before any data a part of the known error looks like any cause
        (``SignificanceSettings.coherent``), of which what was left at calibration tells how much
        comes back: by Bayes' rule, for Gaussian errors. Where that is more than such a part, its
        prior is as much wider (empirical Bayes: Efron and Morris 1973).

        Args:
            validation: Of the recording on trial.
            candidates: As they are fitted together.
            index: Which of them.
        """
        edges = np.cumsum([0, *(candidate.size for candidate in candidates)])
        own = slice(edges[index], edges[index + 1])
        settings = validation.significance.settings
        parts = validation.fit_in_parts(candidates)
        theta, noise, by_known_error = parts[0][own], *(part[own, own] for part in parts[1:])
        covariance = noise + settings.changed**2 * by_known_error
        prior = (settings.coherent**2 - settings.changed**2) * by_known_error
        then = self._left(candidates[index])
        if then is None:
            return Expected(theta, covariance, np.zeros(len(theta)), prior)
        left, error = then
        more = max(1.0, _distance(left, prior + error) / len(left))
        gain = more * prior @ _inverse(more * prior + error)
        return Expected(theta, covariance, gain @ left, more * (prior - gain @ prior))

    def _left(self, on_trial: Candidate) -> tuple[Array, Array] | None:
        """Return parameters (k,) of a candidate at calibration, and their covariance (k, k).

        ``None`` of what does not come back with the arm's state, or did not show.
        """
        hypothesis = on_trial.hypothesis
        if hypothesis.transient or hypothesis.of_model:
            return None
        key = (*hypothesis.key, on_trial.size, *sorted(hypothesis.setting.items()))
        if key not in self._found:
            validation = self._validation
            candidate = validation.candidate(hypothesis)
            felt = bool(validation.size(candidate, np.ones(candidate.size)).any())
            self._found[key] = validation.fit([candidate], 0.0) if felt else None
        return self._found[key]


def _distance(theta: Array, covariance: Array) -> float:
    return float(theta @ _inverse(covariance) @ theta)


def _inverse(covariance: Array) -> Array:
    """Return the inverse (k, k), zero of what does not vary; parameters are of many units."""
    deviation = np.sqrt(np.diag(covariance))
    per = np.where(deviation > 0.0, 1.0 / np.where(deviation > 0.0, deviation, 1.0), 0.0)
    scale = np.outer(per, per)
    return np.asarray(scale * np.linalg.pinv(scale * covariance, hermitian=True))
