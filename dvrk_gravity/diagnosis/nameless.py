"""Structure that no name fits: smooth functions of the state, and names that they refute."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.diagnosis.candidate import Candidate
from dvrk_gravity.diagnosis.cross_validation import CrossValidation
from dvrk_gravity.diagnosis.held_out import HeldOut
from dvrk_gravity.diagnosis.selection import (
    EffectTrial,
    SelectedEffect,
    Selection,
    SelectionSettings,
)
from dvrk_gravity.effects.unknown import nameless

Array = NDArray[np.float64]


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
    validation: CrossValidation, selection: Selection, accepted: list[SelectedEffect], floor: Array
) -> tuple[list[SelectedEffect], list[EffectTrial]]:
    """Return the accepted effects that bear their name, and structure that no name fits.

    Args:
        validation: The samples.
        selection: What chose the effects.
        accepted: Those.
        floor: (n,) noise, N·m.
    """
    settings = NamelessSettings()
    named = [one.trial.candidate for one in accepted]
    present = validation.data.motion.present
    # False where the floor is not known.
    clean = validation.score(named).rms <= settings.at_floor * floor
    joints = np.flatnonzero(present & ~clean).tolist()
    pool = list(validation.candidates(nameless(validation.data.motion, joints)))
    unknown: list[EffectTrial] = []
    while len(unknown) < settings.most:
        beside = [*named, *(one.candidate for one in unknown)]
        validation.weigh(validation.out_of_fold(beside), final=True)
        before = validation.score(beside)
        best = selection.best(beside, before, pool)
        strong = [
            one for one in best
            if one.passes and not one.other_day and one.removed > settings.least
            and np.any(one.size > validation.data.expected_on_another_day)
        ]  # fmt: skip
        if not strong:
            break
        unknown.append(strong[0])
    held_out = HeldOut(validation)
    unknown = [
        one for one in unknown if not held_out.unconfirmed([*named, one.candidate], [one.candidate])
    ]
    for found in unknown:
        named = [one for one in named if not _mimics(validation, named, one, found.candidate)]
    kept = [one for one in accepted if any(one.trial.candidate is other for other in named)]
    return kept, unknown


def _mimics(
    validation: CrossValidation, named: Sequence[Candidate], one: Candidate, function: Candidate
) -> bool:
    """Tell whether a function without a name does so much better that the name does not fit."""
    if not set(one.hypothesis.joints) & set(function.hypothesis.joints):
        return False
    rest = [other for other in named if other is not one]
    without = validation.score(rest).likelihood
    mine = validation.score([*rest, one]).likelihood - without
    its = validation.score([*rest, function]).likelihood - without
    return mine < NamelessSettings().mimic * its
