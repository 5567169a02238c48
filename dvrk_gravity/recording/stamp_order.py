"""Which of a recording's stamps are in order: those that repeat or go back are left out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arrays import Mask

# Samples in a row that may be out of order: 0.1 s at 1 kHz. Chosen: more is another recording
# appended, or a clock that was set, and which part is right would have to be guessed.
_MOST = 100
HELD = _MOST + 1  # samples whose stamps are judged together with those that follow them


def increasing(
    stamps: NDArray[np.int64], previous: int | None, decided: int
) -> tuple[Mask, Mask, int | None]:
    """Find the increasing ones of consecutive stamps, leaving out as few as possible.

    Where time goes back, either the stamps before were ahead for a moment, or those after are late
    for one: the shorter run of the two is out of order.

    Args:
        stamps: ``(N,)`` ns.
        previous: Last stamp in use before them; ``None``: they are the first.
        decided: Number of stamps to decide on; the others are context.

    Returns:
        ``(N,)`` masks of those that are later than all used before, and of those out of order; the
        others repeat the one before. The index of the first one of a run that is too long to be
        left out, ``None`` if there is none.
    """
    steps = np.diff(stamps, prepend=stamps[0] - 1 if previous is None else previous)
    if (steps >= 0).all():
        return steps > 0, np.zeros(len(stamps), dtype=bool), None
    wild = np.zeros(len(stamps), dtype=bool)
    values = stamps.tolist()
    used: list[int] = []
    at = 0
    while at < len(values):
        value = values[at]
        last = values[used[-1]] if used else previous
        if last is None or value >= last:
            used.append(at)
            at += 1
            continue
        ahead = _ahead(values, used, value) if previous is None or value >= previous else HELD
        late = 0
        while late <= _MOST and at + late < len(values) and values[at + late] <= last:
            late += 1
        if min(ahead, late) > _MOST:
            if at < decided:
                return wild, wild, at
            break
        if ahead < late:
            wild[used[len(used) - ahead :]] = True
            del used[len(used) - ahead :]
        else:
            wild[at : at + late] = True
            at += late
    kept = np.zeros(len(stamps), dtype=bool)
    first = stamps[used[:1]] - 1 if previous is None else [previous]
    kept[used] = np.diff(stamps[used], prepend=first) > 0
    return kept, wild, None


def _ahead(values: list[int], used: list[int], value: int) -> int:
    """Return how many of the last used stamps are later than a value, at most ``HELD``."""
    count = 0
    while count <= _MOST and count < len(used) and values[used[-1 - count]] > value:
        count += 1
    return count
