"""The model's own parameters beside a cause that changes what they do.

In a base that is tilted weights have other torques than in one that is level: what a calibration
left open between weights and springs shows there. Model and cause are linear each, and their
product is not; linearised anew at the fit itself (Gauss and Newton), it is in values and intervals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.candidate import Candidate, split
from dvrk_gravity.diagnosis.inference.cross_validation import CrossValidation
from dvrk_gravity.effects import ChangesModelTorque


@dataclass(frozen=True)
class RelinearisationSettings:
    """How often model and cause are linearised anew.

    Attributes:
        rounds: At most: a bound on time.
        tolerance: Change of the cause's parameters, of their size, at which the search ends.
            Chosen.
    """

    rounds: int = 4
    tolerance: float = 3e-3


def relinearised(
    validation: CrossValidation, chosen: Sequence[Candidate]
) -> tuple[CrossValidation, list[Candidate]]:
    """Return a validation in which the model's parameters act beside what was chosen, and that.

    The same where nothing that was chosen changes what they do.
    """
    settings, data, result = RelinearisationSettings(), validation.data, list(chosen)
    motion, uncertainty = data.motion, data.motion.model.uncertainty
    if uncertainty is None or motion.reference is not None:
        return validation, result
    last: Array | None = None
    for _ in range(settings.rounds):
        own_parameters, theta = validation.solution(result)
        acting, at = motion.model, {}
        for i, (candidate, values) in enumerate(split(result, theta)):
            claim = candidate.hypothesis
            if isinstance(claim, ChangesModelTorque):
                acting, at[i] = claim.applied_to(acting, values), values
        if not at:
            break
        now = np.concatenate(list(at.values()))
        if last is not None and np.abs(now - last).max() <= settings.tolerance * np.abs(now).max():
            break
        last = now
        # After them comes what no term has, on which no cause acts.
        terms = uncertainty.moved(motion.model.terms, own_parameters[: uncertainty.size])
        moved = replace(motion, model=replace(motion.model, terms=terms))
        beside = replace(motion, model=acting)
        validation = CrossValidation(data.relinearised(beside, own_parameters))
        for i, hypothesis in enumerate(candidate.hypothesis for candidate in result):
            if i in at:
                result[i] = validation.data.candidate(hypothesis.relinearised(at[i]), moved)
            elif not hypothesis.EFFORT_READING:
                # A payload weighs in the base as it leans, too; readings have what acts already.
                result[i] = validation.data.candidate(hypothesis, beside)
        validation.weigh(validation.out_of_fold(result))
    return validation, result
