"""Files of recordings, whatever their kind: read in parts, or written."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.files import text_file
from dvrk_gravity.model import stated_weight
from dvrk_gravity.recording.bag import SUFFIXES, is_bag
from dvrk_gravity.recording.bag_writer import write_bag
from dvrk_gravity.recording.csv_columns import Columns
from dvrk_gravity.recording.csv_file import iterate_csv, write_csv
from dvrk_gravity.recording.joint_states import iterate_bag
from dvrk_gravity.recording.repair import repaired
from dvrk_gravity.recording.samples import CHUNK, Coordinates, Samples, Storage, TimeBase
from dvrk_gravity.validation import path_of

A_PATH = "the path of a .csv file or a rosbag2"
CSV_SUFFIXES = (".csv", ".txt", ".tsv")
# Names that would promise something else than the folder of a bag.
FOREIGN_SUFFIXES = (".json", ".yaml", ".yml", ".txt", ".tsv")


def is_recording(path: Path) -> bool:
    """Tell whether a path is that of a recording, by its name."""
    return is_bag(path) or path.suffix.lower() in CSV_SUFFIXES


def read(
    path: str | Path,
    topic: str | None = None,
    coordinates: Coordinates = "joint",
    time_base: TimeBase = "stamp",
    chunk: int = CHUNK,
    arm: Arm | None = None,
    columns: Columns | None = None,
) -> Iterator[Samples]:
    """Yield what a file holds in consecutive parts of at most ``chunk`` samples.

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
    if is_bag(path):
        parts = iterate_bag(path, topic, coordinates, time_base, chunk, arm)
    elif path.suffix.lower() in CSV_SUFFIXES:
        parts = iterate_csv(path, coordinates, chunk, arm, columns, time_base)
    else:
        raise RecordingError(
            path, f"expected a .csv file, a rosbag2 folder, or a {', '.join(SUFFIXES)} file"
        )
    return repaired(_in_torque(parts, arm))


def _in_torque(parts: Iterator[Samples], arm: Arm | None) -> Iterator[Samples]:
    """Return parts with efforts in N·m, or N, of an arm that reads them in another unit."""
    if arm is None or (arm.drive_gains is None and arm.gravity_in_reading):
        return parts
    return (
        replace(part, effort=converted(part.effort, part.position, part.joints, None, arm))
        for part in parts
    )


def converted(
    effort: Array | None,
    position: Array,
    joints: Sequence[str],
    before: Arm | None,
    after: Arm | None,
) -> Array | None:
    """Return (N, k) efforts of some joints, as one arm has them, as another does.

    Efforts that an arm reads without its weight are completed by what its file states of that; of
    a file that states nothing, and where a joint was not recorded, they stay as they are.

    Args:
        effort: (N, k), ``None`` where not recorded.
        position: (N, k) rad or m.
        joints: Names of the k joints.
        before: The arm by whose drive gains they are; ``None``: as they were read.
        after: The arm by whose gains they are to be; ``None``: as they were read.
    """
    if effort is None:
        return None
    unread = [_unread(position, joints, arm) for arm in (before, after)]
    factor = np.ones(len(joints))
    for arm, power in ((before, -1.0), (after, 1.0)):
        if arm is not None and arm.drive_gains is not None:
            gains = dict(zip(arm.joint_names, arm.drive_gains.tolist(), strict=True))
            factor *= np.array([gains[joint] for joint in joints]) ** power
    if (factor == 1.0).all() and unread[0] is unread[1]:
        return effort
    result = effort if unread[0] is None else effort - unread[0]
    result = result * factor
    if unread[1] is not None:  # what was never measured stays nothing
        result = np.where(result.any(axis=0), result + unread[1], 0.0)
    result.flags.writeable = False
    return result


def _unread(position: Array, joints: Sequence[str], arm: Arm | None) -> Array | None:
    """Return the (N, k) weight that an arm's readings lack, if they do and its file states it."""
    if arm is None or arm.gravity_in_reading or tuple(joints) != arm.joint_names:
        return None
    return stated_weight(arm, position)


def save_recording(
    parts: Iterable[Samples], path: str | Path, storage: Storage, topic: str
) -> None:
    """Write consecutive parts of one recording; see ``Recording.save``.

    Efforts are written as the arm reads them: a file does not tell drive gains.
    """
    parts = (
        replace(part, effort=converted(part.effort, part.position, part.joints, part.arm, None))
        for part in parts
    )
    if Path(path).suffix.lower() == ".csv":
        write_csv(parts, path)
    elif Path(path).name.endswith((*SUFFIXES, *FOREIGN_SUFFIXES)):
        raise RecordingError(path, "expected a .csv file or the name of a new rosbag2 folder")
    else:
        write_bag(parts, path, storage, topic)
