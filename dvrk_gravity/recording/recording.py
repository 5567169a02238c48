"""A recording: time, position, velocity, effort and direction arrays of some joints."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import numpy as np

from dvrk_gravity.arms import STAYS, Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.errors import ArgumentError, RecordingError, ShapeError
from dvrk_gravity.recording import files, writing
from dvrk_gravity.recording.csv_columns import Columns
from dvrk_gravity.recording.joint_names import arm_names, note_on
from dvrk_gravity.recording.samples import (
    LARGEST,
    QUANTITIES,
    Coordinates,
    Samples,
    Storage,
    TimeBase,
    converted,
    not_recorded,
)
from dvrk_gravity.tabular import frame_of
from dvrk_gravity.validation import floats, path_of

if TYPE_CHECKING:
    import pandas


def known_coordinates(given: Coordinates | None) -> Coordinates | None:
    """Return the coordinates; raise ``ArgumentError`` unless joint, actuator or ``None``."""
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
    """The motion and efforts of some joints of an arm: checked samples in read-only arrays.

    Raises:
        ShapeError: If an array does not fit ``position``.
        RecordingError: No sample or joint; a joint twice, not the arm's or out of its order; a
            value not finite (velocities and efforts of a joint may be NaN throughout) or beyond
            1e12; time that does not increase; a direction other than +1 or -1.
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
            if (value := getattr(self, name)) is None and name != "position":
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
        """Return samples as a recording; raises as the constructor does."""
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
                one of those that other programs write.
            topic: JointState topic of a bag; found if there is one candidate.
            coordinates: Of the file's columns; files do not state them.
            time_base: For bags: the header's stamp, or the time at which the bag received it.
            arm: Arm, or its name or file: its joints are read in its order. ``None``: the
                recording's joints in its own order.
            columns: Meaning of CSV columns with other names: ``{"q1": "elbow.position"}``, or as
                ``--columns`` takes them.

        Raises:
            RecordingError: If the file cannot be used; the text says where and why.
            ArgumentError: An argument of a wrong type.
        """
        parts = files.iterate_recording(
            path, topic=topic, coordinates=coordinates, time_base=time_base, columns=columns,
            arm=None if arm is None else Arm.of(arm),
        )  # fmt: skip
        return cls.checked(files.mended(list(parts)))

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
            ArgumentError: Not a path.
        """
        writing.save_recording([self], path_of("path", path), storage, topic)

    def __repr__(self) -> str:
        """Return source, size, joints and coordinates in short."""
        if self.time is None:
            what = f"{len(self)} static poses"
        else:
            what = f"{len(self)} samples, {self.time[-1] - self.time[0]:.4g} s"
        number = len(self.joints)
        joints = f"{number} joints" if number > 1 else self.joints[0]
        return f"<Recording {self.source}: {what}, {joints}, {self.coordinates} coordinates>"

    def to_dataframe(self) -> pandas.DataFrame:
        """Return the samples with the columns of a CSV file: ``time``, ``<joint>.position``, ….

        Raises:
            PackageError: pandas is not installed.
        """
        return frame_of(writing.columns(self))

    def joint(self, name: str) -> int:
        """Return the column of a joint; raise ``RecordingError`` if it was not recorded."""
        if name not in self.joints:
            raise RecordingError(
                self.source, f"has no joint {name!r}, expected one of: {', '.join(self.joints)}"
            )
        return self.joints.index(name)

    def of(self, arm: Arm) -> Recording:
        """Return the recording of an arm's joints, in its order and with its drive gains applied.

        Joints without efforts are left out if others have some.

        Raises:
            RecordingError: If no joint is the arm's, or one that it holds is elsewhere.
        """
        if self.arm is arm:
            return self
        names = {} if self.arm else arm_names(self.joints, arm.joint_names)
        if names:
            joints = tuple(names.get(joint, joint) for joint in self.joints)
            return replace(self, joints=joints, notes=(*self.notes, *note_on(names))).of(arm)
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
                f"expected some of: {', '.join(arm.joint_names)} (arm {arm.name}, by --arm or "
                "--model)",
            )
        if joints == self.joints:
            effort = converted(self.effort, self.position, joints, self.arm, arm)
            return replace(self, arm=arm, effort=effort)
        columns = [self.joints.index(joint) for joint in joints]
        arrays: dict[str, Any] = {
            name: array[:, columns] for name, array in self.arrays().items() if name != "time"
        }
        effort = converted(arrays.get("effort"), arrays["position"], joints, self.arm, arm)
        return replace(self, joints=joints, arm=arm, **arrays | {"effort": effort})

    def require_held(self, arm: Arm) -> None:
        """Raise ``RecordingError`` if a joint that an arm has as held is elsewhere."""
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
