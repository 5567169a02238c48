"""Recordings for analysis: read once into memory; of a file too long for that, stretches."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Unpack

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Mask
from dvrk_gravity.errors import ArgumentError
from dvrk_gravity.recording.files import A_PATH, ReadOptions, iterate_recording, mended
from dvrk_gravity.recording.notes import note
from dvrk_gravity.recording.recording import Recording
from dvrk_gravity.recording.samples import Coordinates, Samples
from dvrk_gravity.validation import path_of

MOST_SAMPLES = 600_000  # of a file, that are held in memory: ten minutes at 1 kHz
STRETCH = 60.0  # s, of each stretch of a longer one: enough to find a period of the motion
_LONGER = 1.01  # part of the samples from which on a recording is cut: rates are known as well


def load_excerpt(path: str | Path, **options: Unpack[ReadOptions]) -> Recording:
    """Return a recording; of a trajectory of more than ``MOST_SAMPLES``, evenly spread stretches.

    Options are those of ``Recording.load``. Stretches are apart in time, as at a gap.

    Raises:
        RecordingError: If the file cannot be used.
    """
    arm = options.get("arm")
    if arm is not None and arm.held:  # those are not among the arm's joints
        whole: ReadOptions = {**options, "arm": None}
        Recording.checked(mended([next(iterate_recording(path, **whole))])).require_held(arm)
    parts, total, rate = list[Samples](), 0, None
    for part in iterate_recording(path, **options):
        total, rate = total + len(part), rate or part.rate
        parts.append(part)
        if total > MOST_SAMPLES and part.time is not None:  # from now on only counted
            first, *others = parts
            parts = [first.rows(slice(1)).with_found(others)]
    if total <= MOST_SAMPLES or rate is None:
        return Recording.checked(mended(parts))
    length = round(STRETCH * rate)
    kept, row = list[Samples](), 0
    for part in iterate_recording(path, **options):
        chosen = _spread(total, length, MOST_SAMPLES // length, slice(row, row + len(part)))
        row += len(part)
        if chosen.any():
            kept.append(part.rows(chosen).counted())
    left = total - sum(len(part) for part in kept)
    return _noted(Recording.checked(mended(kept).with_found(parts)), left, STRETCH)


def excerpt(recording: Recording, longest: float, stretch: float = STRETCH) -> Recording:
    """Return a trajectory, or evenly spread stretches of one that is longer.

    Args:
        recording: Trajectory; or static poses, which are never cut.
        longest: Time that all samples may last together, s.
        stretch: Length of a stretch, s.
    """
    rate, total = recording.rate, len(recording)
    if rate is None or total <= _LONGER * longest * rate:
        return recording
    length = max(1, round(stretch * rate))
    chosen = _spread(total, length, int(longest / stretch), slice(0, total))
    return _noted(recording.rows(chosen), total - int(chosen.sum()), stretch)


def _spread(total: int, length: int, number: int, rows: slice) -> Mask:
    """Return which rows, of all, are in one of a number of stretches, spread evenly over all."""
    stretches, number = -(-total // length), max(1, number)
    chosen = ((np.arange(number) + 0.5) * stretches / number).astype(int)
    which = np.arange(rows.start, rows.stop) * stretches // total
    return np.isin(which, chosen)


def _noted(kept: Recording, left_out: int, stretch: float) -> Recording:
    """Return stretches of a recording with a note that so many samples are not in them."""
    text = f"outside of evenly spread stretches of {stretch:.3g} s"
    return replace(kept, notes=(note("excerpt", text, left_out=left_out), *kept.notes))


Given = Recording | str | os.PathLike[str]


def opened(
    given: Given | Iterable[Given], coordinates: Coordinates = "joint", arm: Arm | None = None
) -> list[Recording]:
    """Return one or several recordings or paths as a list of recordings.

    Args:
        given: One or several.
        coordinates: Of files that are given as paths.
        arm: Whose joints they are to be; see ``Recording.of``.

    Raises:
        ArgumentError: Neither a recording nor a path.
        RecordingError: A file that cannot be used, or joints that are not the arm's.
    """
    if isinstance(given, Recording | str | os.PathLike):
        given = [given]
    elif not isinstance(given, Iterable):
        raise ArgumentError("recordings", given, f"a Recording, {A_PATH}, or several of them")

    def opened_recording(source: Given) -> Recording:
        if isinstance(source, Recording):
            return source if arm is None else source.of(arm)
        path = path_of("recordings", source, f"a Recording or {A_PATH}")
        return load_excerpt(path, coordinates=coordinates, arm=arm)

    return [opened_recording(source) for source in given]
