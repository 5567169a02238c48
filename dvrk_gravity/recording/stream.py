"""Recordings read from their files in parts, or in memory."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from copy import copy
from functools import partial
from pathlib import Path
from typing import Unpack

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.errors import ArgumentError, RecordingError
from dvrk_gravity.recording.files import A_PATH, ReadOptions, read
from dvrk_gravity.recording.recording import Recording
from dvrk_gravity.recording.samples import CHUNK, Coordinates, join
from dvrk_gravity.validation import path_of

Change = Callable[[Iterator[Recording]], Iterator[Recording]]
"""What makes other consecutive parts of those of a recording."""

HEAD = 10_000  # samples of a file's first part


def iterate_recording(
    path: str | Path, chunk: int = CHUNK, **options: Unpack[ReadOptions]
) -> Iterator[Recording]:
    """Yield a recording in consecutive parts of at most ``chunk`` samples.

    Memory stays at a few parts, whatever the length of the file. Times are relative to the first
    sample of the whole; options are those of ``Recording.load``.

    Raises:
        RecordingError: On reaching a part that cannot be used.
    """
    return map(Recording.checked, read(path, chunk, **options))


def blocks(parts: Iterable[Recording], size: int) -> Iterator[Recording]:
    """Yield consecutive parts of any length as blocks of ``size`` samples, the last one shorter."""
    held: list[Recording] = []
    count = 0
    for part in parts:
        held.append(part)
        count += len(part)
        while count > size:
            whole = join(held)
            yield whole.rows(slice(0, size))
            # Left-out samples were counted with the block.
            held = [whole.rows(slice(size, None)).counted()]
            count -= size
    if held:
        yield join(held)


class RecordingFile:
    """A recording that stays in its file and is read in parts, any number of times.

    Attributes:
        head: Its first part, which has joints, quantities and kind of time.

    Raises:
        RecordingError: On opening, if the first part cannot be used.
    """

    def __init__(self, path: str | Path, **options: Unpack[ReadOptions]) -> None:
        """Read the first part; options are those of ``Recording.load``."""
        self._path, self._options = path, options
        self._changes: tuple[Change, ...] = ()
        arm = options.get("arm")
        if arm is not None and arm.held:  # those are not among the arm's joints
            whole: ReadOptions = {**options, "arm": None}
            next(iterate_recording(path, **whole)).require_held(arm)
        self.head = next(blocks(self.parts(), HEAD))

    def __repr__(self) -> str:
        """Return the file's name."""
        return f"<RecordingFile {self._path}>"

    def of(self, arm: Arm) -> RecordingFile:
        """Return the same file read as an arm's; see ``Recording.of``."""
        if self._options.get("arm") is arm:
            return self
        options: ReadOptions = {**self._options, "arm": arm}
        result = RecordingFile(self._path, **options)
        return result.changed(*self._changes) if self._changes else result

    def without(self, left_out: Sequence[tuple[int, int]]) -> RecordingFile:
        """Return the same file without some spans [start, stop) of its rows.

        Raises:
            RecordingError: If nothing is left.
        """
        return self.changed(partial(_without, left_out=tuple(left_out)))

    def mended(self, mend: Callable[[Recording], Recording]) -> RecordingFile:
        """Return the same file with each part corrected by a function that keeps its samples."""
        return self.changed(partial(map, mend))

    def changed(self, *changes: Change) -> RecordingFile:
        """Return the same file with its consecutive parts changed by functions, in order.

        Raises:
            RecordingError: If nothing is left.
        """
        result = copy(self)
        result._changes = (*self._changes, *changes)
        first = next(blocks(result.parts(), HEAD), None)
        if first is None:
            raise RecordingError(self.head.source, "holds no samples")
        result.head = first
        return result

    def parts(self) -> Iterator[Recording]:
        """Yield consecutive parts."""
        parts = iterate_recording(self._path, **self._options)
        for change in self._changes:
            parts = change(parts)
        return parts

    def load(self) -> Recording:
        """Return the whole."""
        return join(list(self.parts()))


def changed(recording: Recording | RecordingFile, change: Change) -> Recording | RecordingFile:
    """Return a recording whose consecutive parts were changed by a function.

    Raises:
        RecordingError: If nothing is left.
    """
    if isinstance(recording, RecordingFile):
        return recording.changed(change)
    parts = list(change(iter((recording,))))
    if not parts:
        raise RecordingError(recording.source, "holds no samples")
    return join(parts)


def _without(
    parts: Iterator[Recording], left_out: Sequence[tuple[int, int]]
) -> Iterator[Recording]:
    """Yield parts without some spans of the rows of all."""
    row = 0
    for part in parts:
        keep = np.ones(len(part), dtype=bool)
        for start, stop in left_out:
            keep[max(start - row, 0) : max(stop - row, 0)] = False
        row += len(part)
        if keep.any():
            yield part.rows(keep)


Given = Recording | RecordingFile | str | os.PathLike[str]


def opened(
    given: Given | Iterable[Given], coordinates: Coordinates = "joint", arm: Arm | None = None
) -> list[Recording | RecordingFile]:
    """Return one or several recordings or paths as a list of recordings.

    Args:
        given: One or several.
        coordinates: Of files that are given as paths.
        arm: Whose joints they are to be; see ``Recording.of``.

    Raises:
        ArgumentError: Neither a recording nor a path.
        RecordingError: A file that cannot be used, or joints that are not the arm's.
    """
    if isinstance(given, Recording | RecordingFile | str | os.PathLike):
        given = [given]
    elif not isinstance(given, Iterable):
        raise ArgumentError("recordings", given, f"a Recording, {A_PATH}, or several of them")

    def opened_recording(source: Given) -> Recording | RecordingFile:
        if isinstance(source, Recording | RecordingFile):
            return source if arm is None else source.of(arm)
        path = path_of("recordings", source, f"a Recording or {A_PATH}")
        return RecordingFile(path, coordinates=coordinates, arm=arm)

    return [opened_recording(source) for source in given]
