"""Structure that no name fits: smooth functions of the state, and names that they refute."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.candidate import Candidate
from dvrk_gravity.diagnosis.cross_validation import CrossValidation
from dvrk_gravity.diagnosis.held_out import HeldOut
from dvrk_gravity.diagnosis.places import SelectedEffect
from dvrk_gravity.diagnosis.selection import EffectTrial, Selection, SelectionSettings
from dvrk_gravity.effects import nameless


@dataclass(frozen=True)
class NamelessSettings:
    """When there is structure without a name.

    Attributes:
        at_floor: Times the noise: nothing worth finding is left. Chosen.
        least: Part of a joint's error that a function without a name must remove: half as much
            again as one with a name. Chosen.
        most: Functions at most: a bound on time.
        mimic: Part of a nameless function's gain below which a name does not fit. Chosen.
    """

    at_floor: float = 1.05
    least: float = 1.5 * SelectionSettings().least_gain
    most: int = 3
    mimic: float = 0.5


def with_nameless(
    validation: CrossValidation, selection: Selection, selected: list[SelectedEffect], floor: Array
) -> tuple[list[SelectedEffect], list[EffectTrial]]:
    """Return the selected effects that bear their name, and structure that no name fits.

    Args:
        validation: The samples.
        selection: What chose the effects.
        selected: Those.
        floor: (n,) noise, N·m.
    """
    settings = NamelessSettings()
    named = [effect.trial.candidate for effect in selected]
    present = validation.data.motion.present
    # False where the floor is not known.
    clean = validation.score(named).rms <= settings.at_floor * floor
    joints = np.flatnonzero(present & ~clean).tolist()
    pool = list(validation.data.candidates(nameless(validation.data.motion, joints)))
    unknown, beside_names = list[EffectTrial](), list[EffectTrial]()
    while len(unknown) < settings.most:
        beside = [*named, *(trial.candidate for trial in unknown)]
        validation.weigh(validation.out_of_fold(beside), final=True)
        before = validation.score(beside)
        best = selection.best(beside, before, pool)
        if not unknown:
            beside_names = [trial for trial in best if trial.passes and not trial.other_day]
        strong = [
            trial for trial in best
            if trial.passes and not trial.other_day and trial.removed > settings.least
            and np.any(trial.size > validation.data.expected_on_another_day)
        ]  # fmt: skip
        if not strong:
            break
        unknown.append(strong[0])
    held_out = HeldOut(validation)
    unknown = [
        trial
        for trial in unknown
        if not held_out.unconfirmed([*named, trial.candidate], [trial.candidate])
    ]
    for trial in unknown:
        named = [
            candidate
            for candidate in named
            if not _mimics(validation, named, candidate, trial.candidate)
        ]
    kept = [
        replace(effect, doubt=_doubt(selection, named, effect.trial.candidate, pool, beside_names))
        for effect in selected
        if any(effect.trial.candidate is candidate for candidate in named)
    ]
    return kept, unknown


def _doubt(
    selection: Selection, named: Sequence[Candidate], candidate: Candidate,
    pool: Sequence[Candidate], beside_names: Sequence[EffectTrial],
) -> str:  # fmt: skip
    """Return why a name is not certain: an omnibus alternative, any smooth function, stands up.

    Beside all names it is significant still at a joint of this one; or in the place of this one it
    does better, its many parameters paid for.

    Args:
        selection: What compares hypotheses.
        named: All that bear their name.
        candidate: The one in question.
        pool: Functions without a name.
        beside_names: Those of them that are significant beside all names.
    """
    joints = candidate.hypothesis.joints
    for trial in beside_names:
        function = trial.candidate.hypothesis
        if function.joints[0] in joints:
            of = function.words({})["what"]
            return f"beside it an error of {function.names[0]} stays that depends on {of}"
    validation = selection.validation
    functions = [each for each in pool if each.hypothesis.joints[0] in joints]
    if selection.fixed(candidate) or not functions:
        return ""
    rest = [other for other in named if other is not candidate]
    validation.weigh(validation.out_of_fold(named), final=True)
    without = validation.score(rest)
    current = selection.evaluate(rest, candidate, without)
    least = current.gain + selection.settings.equal_least * current.inflation
    better = [trial for trial in selection.best(rest, without, functions) if trial.gain > least]
    if not better:
        return ""
    of = better[0].candidate.hypothesis.words({})["what"]
    return f"any smooth function of {of} explains unseen blocks better"


def _mimics(
    validation: CrossValidation,
    named: Sequence[Candidate],
    candidate: Candidate,
    function: Candidate,
) -> bool:
    """Tell whether a function without a name does so much better that the name does not fit."""
    if not set(candidate.hypothesis.joints) & set(function.hypothesis.joints):
        return False
    rest = [other for other in named if other is not candidate]
    without = validation.score(rest).likelihood
    gain = validation.score([*rest, candidate]).likelihood - without
    function_gain = validation.score([*rest, function]).likelihood - without
    return gain < NamelessSettings().mimic * function_gain
