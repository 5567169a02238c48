"""The model's own parameters beside a cause that changes what they do.

In a base that is tilted weights have other torques than in one that is level: what a calibration
left open between weights and springs shows there. Model and cause are linear each, and their
product is not; linearised anew at the fit itself (Gauss and Newton), it is in values and intervals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.diagnosis.candidate import Candidate, split
from dvrk_gravity.diagnosis.cross_validation import CrossValidation


@dataclass(frozen=True)
class RelinearisationSettings:
    """How often model and cause are linearised anew.

    Attributes:
        rounds: At most: a bound on time. The second moves a tilt by a few thousandths.
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
    uncertainty = data.motion.model.uncertainty
    if uncertainty is None or data.motion.reference is not None:
        return validation, result
    last = np.full(0, np.inf)
    for _ in range(settings.rounds):
        own_parameters, theta = validation.solution(result)
        motion = data.motion
        acting, at = motion.model, []
        for i, (candidate, values) in enumerate(split(result, theta)):
            changed = candidate.hypothesis.acting_on(acting, values)
            if changed is not None:
                acting = changed
                at.append((i, values))
        if not at:
            break
        now = np.concatenate([values for _, values in at])
        if len(last) and np.abs(now - last).max() <= settings.tolerance * np.abs(now).max():
            break
        last = now
        # After them comes what the model says beyond its range, on which no cause acts.
        terms = uncertainty.moved(motion.model.terms, own_parameters[: uncertainty.size])
        moved = replace(motion, model=replace(motion.model, terms=terms))
        validation = CrossValidation(
            data.relinearised(replace(motion, model=acting), own_parameters)
        )
        for i, values in at:
            hypothesis = result[i].hypothesis
            named = hypothesis.describe(values, hypothesis.setting)
            setting = {**hypothesis.setting, **{n: named[n] for n in hypothesis.fixed_point}}
            result[i] = validation.data.candidate(replace(hypothesis, setting=setting), moved)
        changing = {i for i, _ in at}
        for i, other in enumerate(result):
            # A payload weighs in the base as it leans, too; readings of what acts have their own.
            if i not in changing and not other.hypothesis.OF_ACTING:
                beside = replace(motion, model=acting)
                result[i] = validation.data.candidate(other.hypothesis, beside)
        validation.weigh(validation.out_of_fold(result))
    return validation, result
