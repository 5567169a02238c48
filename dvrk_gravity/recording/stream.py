"""Recordings that are read from their files in parts, or are given in memory."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from copy import copy
from functools import partial
from pathlib import Path

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.errors import ArgumentError, RecordingError
from dvrk_gravity.recording import files
from dvrk_gravity.recording.csv_columns import Columns
from dvrk_gravity.recording.data import Recording
from dvrk_gravity.recording.files import A_PATH
from dvrk_gravity.recording.pieces import blocks
from dvrk_gravity.recording.samples import CHUNK, Coordinates, TimeBase, join
from dvrk_gravity.validation import path_of

HEAD = 10_000  # samples by which what is the same for all of a file is found out


def iterate_recording(
    path: str | Path,
    topic: str | None = None,
    coordinates: Coordinates = "joint",
    time_base: TimeBase = "stamp",
    chunk: int = CHUNK,
    arm: Arm | None = None,
    columns: Columns | None = None,
) -> Iterator[Recording]:
    """Yield a recording in consecutive parts of at most ``chunk`` samples.

    Memory stays at a few parts, whatever the length of the file. Times are relative to the first
    sample of the whole; arguments are those of ``Recording.load``.

    Raises:
        RecordingError: When the part that cannot be used is reached.
    """
    parts = files.read(path, topic, coordinates, time_base, chunk, arm, columns)
    return map(Recording.checked, parts)


class RecordingFile:
    """A recording that is left in its file and read in parts, as often as asked for.

    Attributes:
        head: Its first part; tells joints, quantities, and whether there is a time.

    Raises:
        RecordingError: On opening, if the first part cannot be used.
    """

    def __init__(
        self,
        path: str | Path,
        topic: str | None = None,
        time_base: TimeBase = "stamp",
        coordinates: Coordinates = "joint",
        arm: Arm | None = None,
        columns: Columns | None = None,
    ) -> None:
        """Read the first part; arguments are those of ``Recording.load``."""
        self._path, self._topic, self._time_base = path, topic, time_base
        self._coordinates, self._arm, self._columns = coordinates, arm, columns
        self._changes: tuple[Callable[[Iterator[Recording]], Iterator[Recording]], ...] = ()
        if arm is not None and arm.held:  # which the arm's own joints do not tell
            whole = iterate_recording(path, topic, coordinates, time_base, columns=columns)
            next(whole).require_held(arm)
        self.head = next(blocks(self.parts(), HEAD))

    def __repr__(self) -> str:
        """Say which file it is."""
        return f"<RecordingFile {self._path}>"

    def of(self, arm: Arm) -> RecordingFile:
        """Return the same file read as an arm's; see ``Recording.of``."""
        if self._arm is arm:
            return self
        given = self._path, self._topic, self._time_base, self._coordinates
        result = RecordingFile(*given, arm, self._columns)
        return result._changed(*self._changes) if self._changes else result

    def without(self, left_out: Sequence[tuple[int, int]]) -> RecordingFile:
        """Return the same file without some spans of its rows, each from one row to before another.

        Raises:
            RecordingError: If nothing is left.
        """
        return self._changed(partial(_without, left_out=tuple(left_out)))

    def mended(self, mend: Callable[[Recording], Recording]) -> RecordingFile:
        """Return the same file with each of its parts put right; samples stay in their places."""
        return self._changed(partial(map, mend))

    def _changed(
        self, *changes: Callable[[Iterator[Recording]], Iterator[Recording]]
    ) -> RecordingFile:
        result = copy(self)
        result._changes = (*self._changes, *changes)
        first = next(blocks(result.parts(), HEAD), None)
        if first is None:
            raise RecordingError(self.head.source, "holds no samples")
        result.head = first
        return result

    def parts(self) -> Iterator[Recording]:
        """Yield consecutive parts."""
        parts = iterate_recording(
            self._path, self._topic, self._coordinates, self._time_base,
            arm=self._arm, columns=self._columns,
        )  # fmt: skip
        for change in self._changes:
            parts = change(parts)
        return parts

    def load(self) -> Recording:
        """Return the whole."""
        return join(list(self.parts()))


def _without(
    parts: Iterator[Recording], left_out: Sequence[tuple[int, int]]
) -> Iterator[Recording]:
    """Yield what is left of parts without some spans of the rows of all."""
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
    """Return one or several recordings as a list, paths as the files that they name.

    Args:
        given: One or several.
        coordinates: Of the files that are given as paths, which do not tell.
        arm: Whose joints they are to be; see ``Recording.of``.

    Raises:
        ArgumentError: What is neither a recording nor a path.
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
