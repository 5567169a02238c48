"""Recurring misfit: how much of each cause the calibration recording shows already.

Unmodelled torque depends on the arm's state: friction of another law than the model's looks like a
little presliding in every motion. The samples that the model was identified on show how much of
each cause that is. Another recording is evidence of a change as far as it shows more, or less.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.candidate import Candidate
from dvrk_gravity.diagnosis.data.filtered_data import FilteredData, FilterSettings
from dvrk_gravity.diagnosis.data.loading import LoadSettings
from dvrk_gravity.diagnosis.data.motion import MeasuredMotion
from dvrk_gravity.diagnosis.inference.cross_validation import CrossValidation
from dvrk_gravity.diagnosis.inference.nonlinear import setting_columns
from dvrk_gravity.estimation import squared_distance

_PARTS = np.linspace(0.0, 1.0, 21)  # of what is expected, that are compared; the first: nothing


@dataclass(frozen=True, eq=False)
class RecurringMisfit:
    """What of a cause is expected though nothing has changed.

    Attributes:
        mean: (k,) parameters.
        variance: (k, k) of them.
    """

    mean: Array
    variance: Array

    def changed_fraction(self, theta: Array, covariance: Array) -> float:
        """Return the fraction of a cause's evidence not already present at calibration.

        By squared distances in units of the covariance (Mahalanobis): of the parameters from the
        nearest between nothing and all that is expected, over that from nothing. Another motion
        may show less of it, which is expected, too. How uncertain the recurring misfit is widens
        intervals only: a short calibration must not absorb what another motion shows.

        Args:
            theta: (k,) parameters in the recording under test.
            covariance: (k, k) of them.
        """
        whole = squared_distance(theta, covariance)
        change = min(
            squared_distance(theta - part * self.mean, covariance) for part in _PARTS.tolist()
        )
        return change / whole if whole > 0.0 else 1.0

    @property
    def spread(self) -> Array:
        """(k, k) by how much parameters may differ for the recurring misfit.

        Its second moment: the samples of calibration do not show whether it is this cause or
        another error of the model.
        """
        return np.asarray(self.variance + np.outer(self.mean, self.mean))


class AtCalibration:
    """Fits of hypotheses to what a model leaves of the samples that it was identified on."""

    def __init__(self, validation: CrossValidation) -> None:
        """Take a validation of these samples."""
        self._validation = validation
        self._found: dict[tuple[object, ...], RecurringMisfit | None] = {}

    @classmethod
    def of(cls, motion: MeasuredMotion) -> AtCalibration | None:
        """Return those of the model of a motion; ``None`` where they are not kept, or too few."""
        uncertainty = motion.model.uncertainty
        kept = None if uncertainty is None else uncertainty.calibration
        if uncertainty is None or kept is None:
            return None
        shortest = LoadSettings().shortest * kept.rate
        if max(part.stop - part.start for part in kept.parts) < shortest:
            return None
        if not motion.present.all():
            return None
        then = MeasuredMotion(
            model=motion.model, q=kept.q, qd=kept.qd, qdd=kept.qdd, effort=kept.effort,
            time=np.arange(len(kept.q)) / kept.rate + kept.part, parts=kept.parts, rate=kept.rate,
            present=motion.present, step=motion.step,
        )  # fmt: skip
        data = FilteredData.of(then, FilterSettings(band=uncertainty.band))
        # The efforts went through that filter when they were read.
        left = data.reduce_state(then.effort) - data.reduce(then.modelled)
        validation = CrossValidation.of(replace(data, residual=left))
        return cls(validation)

    def misfit(self, candidate: Candidate) -> RecurringMisfit | None:
        """Return what of a cause is expected where nothing has changed; ``None``: nothing.

        A part of the known error may look like any cause, in one motion and not in another
        (``SignificanceSettings.coherent``). What was left at calibration is expected to recur
        as far as it is more than that: of parameters phi with covariance F there,
        (1 - 1/s) phi ± (1 - 1/s) F, with s = phi' F^-1 phi / k where that is above 1, after James
        and Stein (1961) with the variance as Efron and Morris (1973) have it. What does not depend
        on the arm's state, or was not felt there, is not expected.
        """
        hypothesis = candidate.hypothesis
        key = (*hypothesis.key, candidate.size, *sorted(hypothesis.setting.items()))
        if key not in self._found:
            felt = self._felt(candidate)
            self._found[key] = None if felt is None else self._misfit([felt])
        return self._found[key]

    def spread(self, tested: Candidate, theta: Array) -> tuple[Array, dict[str, float]]:
        """Return by how much a cause's parameters may differ for the recurring misfit.

        Settings that were searched for, too: what looked like the slope of its torque by one of
        them at calibration shifts that one.

        Args:
            tested: The cause.
            theta: (k,) its parameters in the recording under test.

        Returns:
            (k, k) second moments of its parameters, and standard deviations of its settings.
        """
        k = tested.size
        candidate = self._felt(tested)
        if candidate is None:
            return np.zeros((k, k)), {}
        names, slopes = setting_columns(self._validation, candidate, theta)
        back = self._misfit([candidate, *slopes])
        if back is None:
            return np.zeros((k, k)), {}
        settings = np.sqrt(np.diag(back.spread)[k:])
        return back.spread[:k, :k], dict(zip(names, settings.tolist(), strict=True))

    def _felt(self, tested: Candidate) -> Candidate | None:
        """Return a cause in the calibration's samples; ``None`` where it comes with no state."""
        hypothesis, validation = tested.hypothesis, self._validation
        if hypothesis.transient or hypothesis.refits_model:
            return None
        candidate = validation.data.candidate(hypothesis)
        felt = validation.size(candidate, np.ones(candidate.size)).any()
        return candidate if felt else None

    def _misfit(self, candidates: Sequence[Candidate]) -> RecurringMisfit | None:
        theta, covariance = self._validation.fit(candidates)
        more = squared_distance(theta, covariance) / len(theta)
        if more <= 1.0:
            return None
        part = 1.0 - 1.0 / more
        return RecurringMisfit(part * theta, part * covariance)
