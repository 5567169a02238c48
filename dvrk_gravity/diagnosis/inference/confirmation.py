"""Which of the selected effects the held-out blocks confirm."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.candidate import Candidate
from dvrk_gravity.diagnosis.inference.alternatives import SelectedEffect, merge, refine
from dvrk_gravity.diagnosis.inference.cross_validation import CrossValidation
from dvrk_gravity.diagnosis.inference.held_out import HeldOut, Unconfirmed
from dvrk_gravity.diagnosis.inference.nonlinear import relinearised
from dvrk_gravity.diagnosis.inference.selection import EffectTrial, Selection
from dvrk_gravity.estimation import eliminate_backward

_ATTEMPTS = 3  # at a choice that held-out blocks confirm: a bound on time

# Part by which a joint's error may grow, RMS. Chosen: parameters that fit noise add their number
# over that of independent samples to the mean square, a few per cent.
_GROWN = 0.05
# Times the model's known error, that what is added must be, RMS: less does not matter
# (``SelectionSettings``). Less than the noise may be chance: seen of true causes, up to .45 of it
# (test_diagnose_hidden.py).
_KNOWN = 1.36
# Part of a joint's error that an effect adds which is dropped for it. Chosen: that from which on a
# gain is worth a finding (``JudgementSettings``).
_GUILTY = 0.03


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
    unconfirmed: list[Unconfirmed] = []
    for attempt in range(_ATTEMPTS):
        selection.report("comparing alternatives")
        chosen = merge(selection, refine(selection, chosen))
        chosen = selection.eliminate_backward(chosen)
        validation, significant = selection.validation, selection.is_significant
        chosen, failed = _held_out_confirms(validation, chosen, significant, noise)
        unconfirmed += failed
        if not failed or attempt == _ATTEMPTS - 1:
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
    kept, failed = _held_out_confirms(acting, chosen, selection.is_significant, noise)
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
    significant: Callable[[Sequence[Candidate], Candidate], bool],
    noise: Array,
) -> tuple[list[Candidate], list[Unconfirmed]]:
    """Return the effects that blocks show which no choice had seen, and those that they do not.

    Args:
        validation: The validation.
        chosen: What was chosen.
        significant: Whether one of those kept that acts in no held-out block is significant.
        noise: (n,) RMS that noise alone leaves, N·m.
    """
    failed: list[Unconfirmed] = []

    def failing(kept: list[Candidate]) -> list[tuple[float, Candidate]]:
        validation.weigh(validation.out_of_fold(kept))
        tested = [candidate for candidate in kept if not candidate.hypothesis.refits_model]
        held_out = HeldOut(validation)
        found = held_out.unconfirmed(kept, tested, lambda candidate: significant(kept, candidate))
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


def worse(held_out: HeldOut, chosen: Sequence[Candidate], before: Array, noise: Array) -> list[int]:
    """Return the joints at which what was chosen adds to the error.

    There the error is larger than before, and than what the model's own parameters leave that move
    without it: where they fit noise, that is none of its doing.

    Args:
        held_out: The held-out samples.
        chosen: The candidates.
        before: (H, n) errors of the given model.
        noise: (n,) RMS that noise alone leaves, N·m; NaN where it is not known: as much as what was
            there.
    """
    after = held_out.rmse(held_out.error(chosen))
    least = np.fmax(held_out.rmse(before), held_out.rmse(held_out.error([])))
    harm = np.maximum(_KNOWN * held_out.known_error, np.where(np.isnan(noise), least, noise))
    added = np.sqrt(np.maximum(after**2 - least**2, 0.0))
    grown = after > (1.0 + _GROWN) * least
    return np.flatnonzero(grown & (added > harm)).tolist()


def worsening(
    held_out: HeldOut, chosen: Sequence[Candidate], noise: Array
) -> list[tuple[Unconfirmed, Candidate]]:
    """Return the chosen candidate that adds most to the error of a joint that is worse.

    None where no joint's error is larger than that of the given model, or where it is hardly less
    without any of them.

    Args:
        held_out: The held-out samples.
        chosen: The candidates.
        noise: (n,) RMS that noise alone leaves, N·m; see :func:`worse`.
    """
    joints = worse(held_out, chosen, held_out.as_read(), noise)
    after = held_out.rmse(held_out.error(chosen))[joints]
    found: list[tuple[float, int, Candidate]] = []
    for candidate in chosen if joints else ():
        rest = [other for other in chosen if other is not candidate]
        added = 1.0 - held_out.rmse(held_out.error(rest))[joints] / after
        found.append((float(added.max()), joints[int(np.argmax(added))], candidate))
    guilty = [each for each in found if each[0] > _GUILTY]
    if not guilty:
        return []
    _, joint, candidate = max(guilty, key=lambda each: each[0])
    name = held_out.joint_names[joint]
    return [(Unconfirmed(candidate.hypothesis, name, None, worsens=True), candidate)]
