"""Which of the selected effects the held-out blocks confirm."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.candidate import Candidate
from dvrk_gravity.diagnosis.inference.alternatives import refine
from dvrk_gravity.diagnosis.inference.beside import Beside
from dvrk_gravity.diagnosis.inference.held_out import HeldOut, Unconfirmed
from dvrk_gravity.diagnosis.inference.nonlinear import relinearised
from dvrk_gravity.diagnosis.inference.selection import Selection
from dvrk_gravity.estimation import eliminate_backward

_ATTEMPTS = 3  # at a choice that held-out blocks confirm: a bound on time

# Part by which a joint's error may grow, RMS. Chosen: parameters that fit noise add their number
# over that of independent samples to the mean square, a few per cent.
_GROWN = 0.05
# Times the model's known error, that what is added must be, RMS: less does not matter
# (``SelectionSettings``). Less than the noise may be chance: seen of true causes, up to .45 of it
# (test_diagnose_hidden.py).
_KNOWN = 1.36


def confirmed(
    selection: Selection, chosen: Sequence[Candidate]
) -> tuple[list[Candidate], list[Unconfirmed]]:
    """Return the effects that hold in the end, and those that the held-out blocks do not confirm.

    In the place of one that fails the choice may find a simpler one.

    Args:
        selection: The choice.
        chosen: What it chose.
    """
    unconfirmed: list[Unconfirmed] = []
    for attempt in range(_ATTEMPTS):
        selection.report("comparing alternatives")
        chosen = selection.eliminate_backward(refine(selection, chosen)).candidates
        chosen, failed = _held_out_confirms(selection, chosen)
        unconfirmed += failed
        if not failed or attempt == _ATTEMPTS - 1:
            break
        selection = selection.excluding(effect.hypothesis for effect in failed)
        chosen = selection.run(chosen).candidates
    return list(chosen), unconfirmed


def _held_out_confirms(
    selection: Selection, chosen: Sequence[Candidate]
) -> tuple[list[Candidate], list[Unconfirmed]]:
    """Return the effects that blocks show which no choice had seen, and those that they do not.

    Linearised at the fit: what made up for the product of two others, a tilt and weights that are
    off, is none there.

    Args:
        selection: The choice.
        chosen: What was chosen.
    """
    failed: list[Unconfirmed] = []

    def failing(kept: list[Candidate]) -> list[tuple[float, Candidate]]:
        acting, there = relinearised(selection.validation.weighted(kept), kept)
        held_out, beside = HeldOut(acting), Beside(acting, tuple(there))
        tested = [candidate for candidate in there if not candidate.hypothesis.refits_model]
        found = held_out.unconfirmed(
            there, tested, lambda candidate: selection.is_significant(beside, candidate)
        )
        as_chosen = {id(at_fit): candidate for at_fit, candidate in zip(there, kept, strict=True)}
        failures.update({id(as_chosen[id(each)]): failure for failure, each in found})
        return [
            (0.0 if failure.gain is None else failure.gain.relative, as_chosen[id(each)])
            for failure, each in found
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
