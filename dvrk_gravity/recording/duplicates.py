"""Duplicate samples: a file given twice, a copy of it, a recording appended to itself.

Two measurements differ by their noise; samples equal to the last bit are one measurement. Counted
twice it would weigh double, and a motion would seem to repeat without noise.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arrays import Mask
from dvrk_gravity.recording.notes import Note
from dvrk_gravity.recording.recording import Recording

Hashes = NDArray[np.uint64]

_RUN = 100  # samples in a row that must be equal. Chosen: noise makes no two samples equal
# Part of them that must differ from the sample before: samples at rest, or not renewed, are always
# equal. Chosen.
_CHANGING = 0.1
_LEAST = 2.0  # s left of a recording below which it is not used. Chosen: some lengths of the filter
_FACTOR = 0x9E3779B97F4A7C15  # odd, so that it has an inverse modulo 2^64


def duplicate_samples(recording: Recording, before: Iterable[Recording] = ()) -> Mask:
    """Return (N,) samples of a recording that are those of an earlier one, or earlier ones of it.

    Of trajectories, equal runs of samples in which the readings change; of poses, equal ones.
    """
    run = 1 if recording.time is None else _RUN
    own = _hashes(recording)
    windows = _windows(own, run)
    known = [_windows(_hashes(other), run) for other in before]
    first, which = np.unique(windows, return_index=True, return_inverse=True)[1:]
    equal = first[which] < np.arange(len(windows))
    if known:
        equal |= np.isin(windows, np.concatenate(known))
    changes = np.cumsum(np.append(False, own[1:] != own[:-1]))
    found = np.zeros(len(own), dtype=bool)
    edges = np.flatnonzero(np.diff(equal, prepend=False, append=False)).tolist()
    for begin, end in list(pairwise(edges))[::2]:
        last = end + run - 2
        if run == 1 or changes[last] - changes[begin] >= _CHANGING * (last - begin):
            found[begin : last + 1] = True
    return found


def without_duplicates(
    recordings: Sequence[Recording],
) -> tuple[list[Recording | None], tuple[Note, ...]]:
    """Return recordings without duplicate samples, and warnings about these.

    ``None`` stands for a recording of which too little is left.
    """
    kept: list[Recording | None] = []
    warnings: list[Note] = []
    for index, recording in enumerate(recordings):
        again = duplicate_samples(recording, recordings[:index])
        left: Recording | None = recording
        if again.any():
            left = None if spent(recording, again) else recording.rows(~again)
            warnings.append(_warning(recording, again, left is None))
        kept.append(left)
    return kept, tuple(warnings)


def spent(recording: Recording, again: Mask) -> bool:
    """Return whether too little is left of a recording without its (N,) duplicate samples."""
    left = int((~again).sum())
    return bool(again.any()) and (not left or left < _LEAST * (recording.rate or 0.0))


def _warning(recording: Recording, again: Mask, skipped: bool) -> Note:
    number, total = int(again.sum()), len(recording)
    text = (
        f"{recording.source}: {number} of {total} samples are exact duplicates of earlier samples, "
        "and count once"
    )
    if skipped:
        text += "; the rest is too short to be used" if number < total else "; it is skipped"
    numbers = {"samples": number, "share": number / total}
    return Note("duplicate_samples", None, numbers, text)


def _windows(hashes: Hashes, run: int) -> Hashes:
    """Return a hash of each run of (N,) samples: a polynomial of theirs, modulo 2^64."""
    powers, inverse = (
        np.cumprod(np.full(len(hashes), factor, dtype=np.uint64))
        for factor in (_FACTOR, pow(_FACTOR, -1, 2**64))
    )
    total = np.append(np.uint64(0), np.cumsum(hashes * powers))
    return (total[run:] - total[:-run]) * inverse[: max(len(hashes) - run + 1, 0)]


def _hashes(part: Recording) -> Hashes:
    """Return (N,) hashes of positions, efforts and directions."""
    values = [a for a in (part.position, part.effort, part.direction) if a is not None]
    bits = (np.hstack(values) + 0.0).view(np.uint64)  # -0 is 0
    total = np.zeros(len(bits), dtype=np.uint64)
    for column in bits.T:
        total = _mixed(total ^ column)
    return total


def _mixed(bits: Hashes) -> Hashes:
    """Return 64 bits that each depend on all (the finaliser of SplitMix64, Steele et al. 2014)."""
    bits = bits + np.uint64(0x9E3779B97F4A7C15)
    bits = (bits ^ (bits >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    bits = (bits ^ (bits >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return bits ^ (bits >> np.uint64(31))
