"""A recording: time, position, velocity, effort and direction arrays of some joints."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import get_args

import numpy as np

from dvrk_gravity.arms import STAYS, Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.errors import ArgumentError, RecordingError, ShapeError
from dvrk_gravity.recording import files
from dvrk_gravity.recording.csv_columns import Columns
from dvrk_gravity.recording.samples import (
    CHUNK,
    LARGEST,
    QUANTITIES,
    Coordinates,
    Samples,
    Storage,
    TimeBase,
    join,
    not_recorded,
)
from dvrk_gravity.validation import floats, path_of


def known_coordinates(given: Coordinates | None) -> Coordinates | None:
    """Return what coordinates are said to be, ``None`` where they are not.

    Raises:
        ArgumentError: Anything else than joint or actuator.
    """
    if given is not None and given not in get_args(Coordinates):
        raise ArgumentError("coordinates", given, "joint or actuator")
    return given


def _frozen(name: str, array: Array) -> Array:
    """Return ``array`` as read-only float64; a writable one is copied, not locked."""
    result = floats(name, array)
    if result.flags.writeable:
        result = result.copy()
        result.flags.writeable = False
    return result


@dataclass(frozen=True, eq=False)
class Recording(Samples):
    """What some joints of an arm did: samples that were checked, in arrays that are read-only.

    Raises:
        ShapeError: If an array does not fit ``position``.
        RecordingError: If there is no sample or joint, a joint is twice, or not the arm's or out of
            its order, a value is not finite (but NaN throughout, of a joint without velocities or
            efforts) or beyond 1e12, time does not increase, or a direction
            is not +1 or -1.
    """

    def __post_init__(self) -> None:
        """Check the parts against each other and make the arrays read-only."""
        if isinstance(self.joints, str) or not isinstance(self.joints, Iterable):
            raise ArgumentError("joints", self.joints, "the names of joints")
        object.__setattr__(self, "joints", tuple(self.joints))
        self._check_joints()
        if self.coordinates not in ("joint", "actuator"):
            raise RecordingError(
                self.source, f"coordinates {self.coordinates!r}, expected 'joint' or 'actuator'"
            )
        position = floats("position", self.position)
        shape = (position.shape[0] if position.ndim else 0, len(self.joints))
        for name in (*QUANTITIES, "direction"):
            value = getattr(self, name)
            if value is None and name != "position":
                continue
            array = _frozen(name, value)
            if array.shape != shape:
                raise ShapeError(name, array.shape, f"(N, n) = {shape}")
            object.__setattr__(self, name, array)
            self._require_finite(name, array)
        if shape[0] == 0:
            raise RecordingError(self.source, "holds no samples")
        if self.direction is not None and not np.all(np.abs(self.direction) == 1.0):
            row, column = np.argwhere(np.abs(self.direction) != 1.0)[0]
            raise RecordingError(
                self.source,
                f"sample {row}: {self.joints[column]}.direction is "
                f"{self.direction[row, column]:g}, expected +1 or -1",
            )
        self._check_time(shape[0])

    def _check_joints(self) -> None:
        given = ", ".join(map(str, self.joints)) or "missing"
        if self.arm is not None:
            known = self.arm.joint_names
            if not self.joints or self.joints != tuple(j for j in known if j in self.joints):
                raise RecordingError(
                    self.source,
                    f"joints are {given}, expected some of, in this order: {', '.join(known)}",
                )
        named = all(isinstance(joint, str) and joint for joint in self.joints)
        if not self.joints or not named or len(set(self.joints)) < len(self.joints):
            raise RecordingError(self.source, f"joints are {given}, expected names, each once")

    def _require_finite(self, name: str, array: Array) -> None:
        usable = np.abs(array) < LARGEST
        if name in ("velocity", "effort"):
            usable |= not_recorded(array)
        if not usable.all():
            row, column = np.argwhere(~usable)[0]
            raise RecordingError(
                self.source,
                f"sample {row}: {self.joints[column]}.{name} is {array[row, column]}, "
                f"expected a finite number below {LARGEST:g}",
            )

    def _check_time(self, count: int) -> None:
        if self.time is None:
            return
        time = _frozen("time", self.time)
        object.__setattr__(self, "time", time)
        if time.shape != (count,):
            raise ShapeError("time", time.shape, f"(N,) = ({count},)")
        if not np.isfinite(time).all():
            row = int(np.flatnonzero(~np.isfinite(time))[0])
            raise RecordingError(
                self.source, f"sample {row}: time is {time[row]}, expected a finite number"
            )
        back = np.flatnonzero(np.diff(time) <= 0.0)
        if len(back):
            row = int(back[0]) + 1
            raise RecordingError(
                self.source,
                f"sample {row}: time {time[row]:.9g} s after {time[row - 1]:.9g} s, "
                "expected increasing times",
            )

    @classmethod
    def checked(cls, samples: Samples) -> Recording:
        """Return what a file holds as a recording.

        Raises:
            RecordingError: If it is none; see above.
        """
        return cls(**vars(samples))

    @classmethod
    def load(
        cls,
        path: str | Path,
        topic: str | None = None,
        coordinates: Coordinates = "joint",
        time_base: TimeBase = "stamp",
        arm: Arm | str | Path | None = None,
        columns: Columns | None = None,
    ) -> Recording:
        """Read a whole recording.

        Args:
            path: Folder of a rosbag2 (sqlite3 or mcap), one of its ``.db3`` or ``.mcap`` files, a
                ROS 1 ``.bag``, or a ``.csv`` with a header ``time``, ``<joint>.position``,
                ``<joint>.velocity``, ``<joint>.effort``, ``direction`` or ``<joint>.direction``, or
                such as many programs write it.
            topic: JointState topic of a bag; found if there is one candidate.
            coordinates: What the file's columns are; files do not tell.
            time_base: For bags: the header's stamp, or the time at which the bag received it.
            arm: Whose joints are read, in its order, or its name or file; ``None``: those that the
                recording names, in its.
            columns: What columns of a CSV file are, where their names do not say it: ``{"q1":
                "elbow.position"}``, or as ``--columns`` takes them.

        Raises:
            RecordingError: If the file cannot be used; the text says where and why.
            ArgumentError: An argument of a wrong type.
        """
        of = None if arm is None else Arm.of(arm)
        return cls.checked(
            join(list(files.read(path, topic, coordinates, time_base, arm=of, columns=columns)))
        )

    def save(
        self, path: str | Path, storage: Storage = "sqlite3", topic: str = "/measured_js"
    ) -> None:
        """Write a ``.csv`` file, or else the folder of a rosbag2, complete or not at all.

        Args:
            path: Target; must not exist yet.
            storage: For bags.
            topic: For bags: name of the JointState topic.

        Raises:
            RecordingError: If the target exists or cannot be written, or if a bag was asked for
                and the recording has no time or has directions, which JointState cannot carry.
            ArgumentError: A path that is none.
        """
        files.save_recording([self], path_of("path", path), storage, topic)

    def __repr__(self) -> str:
        """Say what it holds, in short."""
        if self.time is None:
            what = f"{len(self)} static poses"
        else:
            what = f"{len(self)} samples, {self.time[-1] - self.time[0]:.4g} s"
        number = len(self.joints)
        joints = f"{number} joints" if number > 1 else self.joints[0]
        return f"<Recording {self.source}: {what}, {joints}, {self.coordinates} coordinates>"

    @property
    def head(self) -> Recording:
        """What tells joints, quantities, and whether there is a time: the whole, in memory."""
        return self

    def joint(self, name: str) -> int:
        """Return the column of a joint.

        Raises:
            RecordingError: If the joint was not recorded.
        """
        if name not in self.joints:
            raise RecordingError(
                self.source, f"has no joint {name!r}, expected one of: {', '.join(self.joints)}"
            )
        return self.joints.index(name)

    def of(self, arm: Arm) -> Recording:
        """Return what an arm's joints did, in its order; other joints are left out.

        So are such as have no effort where others have one.
        Efforts that are not yet an arm's are taken to N·m by its drive gains.

        Raises:
            RecordingError: If no joint is the arm's, or one that it holds is elsewhere.
        """
        if self.arm is arm:
            return self
        self.require_held(arm)
        without = not_recorded(self.effort)
        recorded = [
            joint for joint, missing in zip(self.joints, without.tolist(), strict=True)
            if not missing
        ] if without.any() and not without.all() else self.joints  # fmt: skip
        joints = tuple(joint for joint in arm.joint_names if joint in recorded)
        if not joints:
            raise RecordingError(
                self.source,
                f"joints are {', '.join(self.joints)}, "
                f"expected some of: {', '.join(arm.joint_names)}",
            )
        if joints == self.joints:
            effort = files.converted(self.effort, self.position, joints, self.arm, arm)
            return replace(self, arm=arm, effort=effort)
        columns = [self.joints.index(joint) for joint in joints]

        def pick(array: Array | None) -> Array | None:
            return None if array is None else array[:, columns]

        return replace(
            self,
            joints=joints,
            position=self.position[:, columns],
            velocity=pick(self.velocity),
            effort=files.converted(
                pick(self.effort), self.position[:, columns], joints, self.arm, arm
            ),
            direction=pick(self.direction),
            arm=arm,
        )

    def require_held(self, arm: Arm) -> None:
        """Refuse a recording in which joints that an arm has as held are elsewhere.

        Raises:
            RecordingError: Naming the joint and where it is.
        """
        for name, at in arm.held.items():
            if name not in self.joints:
                continue
            position = self.position[:, self.joints.index(name)]
            row = int(np.argmax(np.abs(position - at)))
            if abs(position[row] - at) > STAYS:
                raise RecordingError(
                    self.source,
                    f"sample {row}: {name} is at {position[row]:.4g}, expected {at:.4g}, where the "
                    "model's arm holds it",
                )

    def without(self, left_out: Sequence[tuple[int, int]]) -> Recording:
        """Return it without some spans of its rows, each from one row to before another."""
        keep = np.ones(len(self), dtype=bool)
        for start, stop in left_out:
            keep[start:stop] = False
        return self.rows(keep)

    def parts(self, size: int = CHUNK) -> Iterator[Recording]:
        """Yield consecutive parts; samples that were left out are counted with the first."""
        for first in range(0, len(self), size):
            part = self.rows(slice(first, first + size))
            yield part.counted() if first else part

    def between(self, start: float, stop: float) -> Recording:
        """Return the samples with ``start <= time < stop``, s.

        Raises:
            RecordingError: If the recording has no time, or no sample there.
        """
        if self.time is None:
            raise RecordingError(self.source, "static poses have no time to select by")
        first, last = np.searchsorted(self.time, [start, stop])
        if first == last:
            raise RecordingError(
                self.source,
                f"no sample between {start:g} and {stop:g} s, "
                f"expected times within {self.time[0]:g} to {self.time[-1]:g} s",
            )
        return self.rows(slice(int(first), int(last)))

    def blocks(self, count: int) -> tuple[Recording, ...]:
        """Return ``count`` contiguous blocks of equal length (to within one sample).

        Raises:
            RecordingError: If there are fewer samples than blocks.
        """
        if not 1 <= count <= len(self):
            raise RecordingError(
                self.source, f"cannot be cut into {count} blocks, expected 1 to {len(self)}"
            )
        edges = np.linspace(0, len(self), count + 1).round().astype(int)
        return tuple(self.rows(slice(int(a), int(b))) for a, b in pairwise(edges))
