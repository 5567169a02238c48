"""What makes a joint's held-out error larger than the given model's explains nothing there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.candidate import Candidate
from dvrk_gravity.diagnosis.inference.held_out import HeldOut, Unconfirmed


@dataclass(frozen=True)
class WorseningSettings:
    """When an error has grown.

    Attributes:
        grown: Part by which a joint's error may grow, RMS. Chosen: parameters that fit noise add
            their number over that of independent samples to the mean square, a few per cent.
        known: Times the model's known error, that what is added must be, RMS: less is of no
            consequence (``SelectionSettings``). Less than the noise may be chance: seen of true
            causes, up to .45 of it (test_diagnose_hidden.py).
        guilty: Part of a joint's error that one adds which is dropped for it. Chosen: that from
            which on a gain is worth a finding (``JudgementSettings``).
    """

    grown: float = 0.05
    known: float = 1.36
    guilty: float = 0.03


_SETTINGS = WorseningSettings()


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
    harm = np.maximum(
        _SETTINGS.known * held_out.known_error, np.where(np.isnan(noise), least, noise)
    )
    added = np.sqrt(np.maximum(after**2 - least**2, 0.0))
    grown = after > (1.0 + _SETTINGS.grown) * least
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
    guilty = [each for each in found if each[0] > _SETTINGS.guilty]
    if not guilty:
        return []
    _, joint, candidate = max(guilty, key=lambda each: each[0])
    name = held_out.joint_names[joint]
    return [(Unconfirmed(candidate.hypothesis, name, None, worsens=True), candidate)]
