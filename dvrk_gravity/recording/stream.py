"""Reading and writing recordings of any kind, whole or in parts."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from dvrk_gravity import text_file
from dvrk_gravity.arguments import path_of
from dvrk_gravity.arms import Arm
from dvrk_gravity.errors import ArgumentError, RecordingError
from dvrk_gravity.recording.bag import SUFFIXES
from dvrk_gravity.recording.bag_writer import write_bag
from dvrk_gravity.recording.csv_file import iterate_csv, write_csv
from dvrk_gravity.recording.data import CHUNK, Array, Coordinates, Recording, Storage, TimeBase
from dvrk_gravity.recording.joint_states import iterate_bag

A_PATH = "the path of a .csv file or a rosbag2"
# Names that would promise something else than the folder of a bag.
FOREIGN_SUFFIXES = (".json", ".yaml", ".yml", ".txt", ".bag")


def iterate_recording(
    path: str | Path,
    topic: str | None = None,
    coordinates: Coordinates = "joint",
    time_base: TimeBase = "stamp",
    chunk: int = CHUNK,
    arm: Arm | None = None,
) -> Iterator[Recording]:
    """Yield a recording in consecutive parts of at most ``chunk`` samples.

    Memory stays at a few parts, whatever the length of the file. Times are relative to the first
    sample of the whole; arguments are those of ``Recording.load``.

    Raises:
        RecordingError: When the part that cannot be used is reached.
    """
    path = path_of("recording", path, A_PATH)
    if not path.exists():
        raise RecordingError(path, "no such file or folder")
    if not text_file.is_file(path):
        raise RecordingError(path, "is a pipe or device, expected a file or a folder")
    if path.is_dir() or path.suffix in SUFFIXES:
        return iterate_bag(path, topic, coordinates, time_base, chunk, arm)
    if path.suffix.lower() == ".csv":
        return iterate_csv(path, coordinates, chunk, arm)
    raise RecordingError(path, "expected a .csv file, a rosbag2 folder, or a .db3 or .mcap file")


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
    ) -> None:
        """Read the first part; arguments are those of ``Recording.load``."""
        self._path, self._topic, self._time_base = path, topic, time_base
        self._coordinates, self._arm = coordinates, arm
        self.head = next(self.parts())

    def __repr__(self) -> str:
        """Say which file it is."""
        return f"<RecordingFile {self._path}>"

    def of(self, arm: Arm) -> RecordingFile:
        """Return the same file read as an arm's; see ``Recording.of``."""
        if self._arm is arm:
            return self
        return RecordingFile(self._path, self._topic, self._time_base, self._coordinates, arm)

    def parts(self) -> Iterator[Recording]:
        """Yield consecutive parts."""
        return iterate_recording(
            self._path, self._topic, self._coordinates, self._time_base, arm=self._arm
        )

    def load(self) -> Recording:
        """Return the whole."""
        return join(list(self.parts()))


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

    def opened_one(one: Given) -> Recording | RecordingFile:
        if isinstance(one, Recording | RecordingFile):
            return one if arm is None else one.of(arm)
        path = path_of("recordings", one, f"a Recording or {A_PATH}")
        return RecordingFile(path, coordinates=coordinates, arm=arm)

    return [opened_one(one) for one in given]


def load_recording(
    path: str | Path,
    topic: str | None,
    coordinates: Coordinates,
    time_base: TimeBase,
    arm: Arm | None,
) -> Recording:
    """Read a whole recording; see ``Recording.load``."""
    return join(list(iterate_recording(path, topic, coordinates, time_base, arm=arm)))


def join(parts: Sequence[Recording]) -> Recording:
    """Return consecutive parts of one recording as one."""
    if len(parts) == 1:
        return parts[0]

    def joined(name: str) -> Array | None:
        values = [getattr(part, name) for part in parts]
        if values[0] is None:
            return None
        result = np.concatenate(values)
        result.flags.writeable = False
        return result

    position = joined("position")
    assert position is not None
    return replace(
        parts[0],
        time=joined("time"),
        position=position,
        velocity=joined("velocity"),
        effort=joined("effort"),
        direction=joined("direction"),
        invalid=sum(part.invalid for part in parts),
        repeated=sum(part.repeated for part in parts),
    )


def save_recording(
    parts: Iterable[Recording], path: str | Path, storage: Storage, topic: str
) -> None:
    """Write consecutive parts of one recording; see ``Recording.save``."""
    if Path(path).suffix.lower() == ".csv":
        write_csv(parts, path)
    elif Path(path).suffix in (*SUFFIXES, *FOREIGN_SUFFIXES):
        raise RecordingError(path, "expected a .csv file or the name of a new rosbag2 folder")
    else:
        write_bag(parts, path, storage, topic)
