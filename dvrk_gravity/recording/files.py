"""Reading files of recordings, of any kind, in parts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypedDict, Unpack

from dvrk_gravity.arms import Arm
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.files import text_file
from dvrk_gravity.recording.bag import OTHERS, SUFFIXES, is_bag
from dvrk_gravity.recording.csv_columns import Columns
from dvrk_gravity.recording.csv_file import iterate_csv
from dvrk_gravity.recording.joint_states import iterate_bag
from dvrk_gravity.recording.renewal import renewed
from dvrk_gravity.recording.repair import repaired
from dvrk_gravity.recording.samples import CHUNK, Coordinates, Samples, TimeBase, converted, join
from dvrk_gravity.validation import path_of

A_PATH = "the path of a .csv file or a rosbag2"
CSV_SUFFIXES = (".csv", ".txt", ".tsv")


def is_recording(path: Path) -> bool:
    """Return whether a path is a recording's, by its name."""
    return is_bag(path) or path.suffix.lower() in CSV_SUFFIXES


class ReadOptions(TypedDict, total=False):
    """Options of ``Recording.load``."""

    topic: str | None
    coordinates: Coordinates
    time_base: TimeBase
    arm: Arm | None
    columns: Columns | None


def iterate_recording(
    path: str | Path, chunk: int = CHUNK, **options: Unpack[ReadOptions]
) -> Iterator[Samples]:
    """Yield a recording in consecutive parts of at most ``chunk`` samples.

    Memory stays at a few parts, whatever the length of the file. Times are relative to the first
    sample of the whole. Readings are as they were recorded (:func:`mended`).

    Raises:
        RecordingError: On reaching a part that cannot be used.
    """
    arm, columns = options.get("arm"), options.get("columns")
    coordinates = options.get("coordinates", "joint")
    time_base = options.get("time_base", "stamp")
    path = path_of("recording", path, A_PATH)
    if not path.exists():
        raise RecordingError(path, "no such file or folder")
    if not text_file.is_file(path):
        raise RecordingError(path, "is a pipe or device, expected a file or a folder")
    if is_bag(path):
        topic = options.get("topic")
        parts = iterate_bag(path, topic, coordinates, time_base, chunk, arm, columns)
    elif path.suffix.lower() in CSV_SUFFIXES:
        parts = iterate_csv(path, coordinates, chunk, arm, columns, time_base)
    else:
        raise RecordingError(
            path,
            f"expected a .csv file, a rosbag2 folder, or a {', '.join(SUFFIXES)} file; of .npz, "
            f".hdf5 or .parquet, make a CSV as {OTHERS} shows",
        )
    return _in_torque(parts, arm)


def mended(parts: Sequence[Samples]) -> Samples:
    """Return the parts of a recording as one, without what cannot have been read."""
    return renewed(repaired(join(parts)))


def _in_torque(parts: Iterator[Samples], arm: Arm | None) -> Iterator[Samples]:
    """Return parts with efforts in N·m, or N, of an arm that reads them in another unit."""
    if arm is None or (arm.drive_gains is None and arm.gravity_in_reading):
        return parts
    return (
        replace(part, effort=converted(part.effort, part.position, part.joints, None, arm))
        for part in parts
    )
