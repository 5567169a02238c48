"""What held-out blocks confirm of what was chosen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.candidate import Candidate
from dvrk_gravity.diagnosis.inference.cross_validation import CrossValidation
from dvrk_gravity.diagnosis.inference.held_out import HeldOut, Unconfirmed
from dvrk_gravity.diagnosis.inference.places import SelectedEffect, merge, refine
from dvrk_gravity.diagnosis.inference.relinearisation import relinearised
from dvrk_gravity.diagnosis.inference.selection import EffectTrial, Selection
from dvrk_gravity.diagnosis.inference.worse_joints import worsening
from dvrk_gravity.estimation import eliminate_backward


@dataclass(frozen=True)
class ConfirmationSettings:
    """How a choice is made that the held-out blocks confirm.

    Attributes:
        attempts: At it: a bound on time.
    """

    attempts: int = 3


def confirmed(
    selection: Selection, chosen: list[Candidate], noise: Array
) -> tuple[list[Candidate], list[Unconfirmed]]:
    """Return the effects that hold in the end, and those that the held-out blocks do not confirm.

    In the place of one that fails the choice may find a simpler one.

    Args:
        selection: The choice.
        chosen: What it chose.
        noise: (n,) RMS that noise alone leaves, N·m.
    """
    settings = ConfirmationSettings()
    unconfirmed: list[Unconfirmed] = []
    for attempt in range(settings.attempts):
        selection.report("comparing alternatives")
        chosen = merge(selection, refine(selection, chosen))
        chosen = selection.eliminate_backward(chosen)
        chosen, failed = _held_out_confirms(selection.validation, chosen, selection.sure_of, noise)
        unconfirmed += failed
        if not failed or attempt == settings.attempts - 1:
            break
        selection.exclude(effect.hypothesis for effect in failed)
        chosen = selection.run(chosen)
    return chosen, unconfirmed


def at_the_fit(
    selection: Selection,
    selected: Sequence[SelectedEffect],
    unknown: Sequence[EffectTrial],
    noise: Array,
) -> tuple[CrossValidation, list[SelectedEffect], list[EffectTrial], list[Unconfirmed]]:
    """Return what was selected, linearised at the fit, and what is confirmed no more there.

    What made up for the product of two others, a tilt and weights that are off, is none there; nor
    need what has no name be.
    """
    validation = selection.validation
    acting, chosen = relinearised(validation, _named(selected))
    if acting is validation:
        return validation, list(selected), list(unknown), []
    kept, failed = _held_out_confirms(acting, chosen, selection.sure_of, noise)
    if failed:
        left = {id(candidate) for candidate in kept}
        selected = [e for e, c in zip(selected, chosen, strict=True) if id(c) in left]
        acting, chosen = relinearised(validation, _named(selected))
    held_out = HeldOut(acting)
    return (
        acting,
        [
            replace(effect, trial=replace(effect.trial, move=candidate))
            for effect, candidate in zip(selected, chosen, strict=True)
        ],
        [
            trial
            for trial in unknown
            if not held_out.unconfirmed([*chosen, trial.candidate], [trial.candidate])
        ],
        failed,
    )


def _named(selected: Sequence[SelectedEffect]) -> list[Candidate]:
    return [effect.trial.candidate for effect in selected]


def _held_out_confirms(
    validation: CrossValidation,
    chosen: Sequence[Candidate],
    sure: Callable[[Sequence[Candidate], Candidate], bool],
    noise: Array,
) -> tuple[list[Candidate], list[Unconfirmed]]:
    """Return the effects that blocks show which no choice had seen, and those that they do not.

    Args:
        validation: The validation.
        chosen: What was chosen.
        sure: Tells of one of those kept, which acts in none of these blocks, whether it is sure
            without them.
        noise: (n,) RMS that noise alone leaves, N·m.
    """
    failed: list[Unconfirmed] = []

    def failing(kept: list[Candidate]) -> list[tuple[float, Candidate]]:
        validation.weigh(validation.out_of_fold(kept))
        on_trial = [candidate for candidate in kept if not candidate.hypothesis.refits_model]
        held_out = HeldOut(validation)
        found = held_out.unconfirmed(kept, on_trial, lambda candidate: sure(kept, candidate))
        found = found or worsening(held_out, kept, noise)
        failures.update({id(candidate): failure for failure, candidate in found})
        return [
            (0.0 if failure.gain is None else failure.gain.relative, candidate)
            for failure, candidate in found
        ]

    # The weakest goes first: of two that share one torque, either may hold without the other.
    failures: dict[int, Unconfirmed] = {}
    kept = eliminate_backward(chosen, failing, lambda gone: failed.append(failures[id(gone)]))
    return kept, failed
