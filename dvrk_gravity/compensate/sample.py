"""One measured joint state, checked: whether a command may answer it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dvrk_gravity.arms import STAYS, Arm, other_arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.errors import DvrkGravityError


class DroppedSampleError(DvrkGravityError):
    """A message that gives no command.

    Attributes:
        cause: Short name under which it is counted.
    """

    def __init__(self, cause: str, detail: str) -> None:
        self.cause = cause
        super().__init__(detail)


CAUSES = (
    "no_stamp",
    "stamp_backwards",
    "stamp_repeated",
    "stamp_too_old",
    "stamp_ahead",
    "no_clock",
    "missing_joint",
    "duplicate_joint",
    "other_arm",
    "not_held",
    "wrong_length",
    "not_finite",
    "out_of_range",
    "position_jump",
    "malformed",
    "after_gap",
)
"""Every cause under which a message is dropped."""


@dataclass(frozen=True, eq=False)
class Sample:
    """A valid reading of the arm's joints.

    Attributes:
        stamp: Stamp of the message, ns.
        position: (n,) rad.
        velocity: (n,) rad/s, ``None`` where the message has none.
        effort: (n,) N·m, ``None`` where the message has no usable one.
    """

    stamp: int
    position: Array
    velocity: Array | None
    effort: Array | None


class SampleReader:
    """Picks the arm's joints out of messages, by name and in any order."""

    def __init__(self, arm: Arm, margin: Array | float = np.inf) -> None:
        """Read samples of an arm.

        Joints of a larger shipped arm are refused, a joint that the arm holds fixed where a message
        has it elsewhere, and positions further than ``margin``, (n,) rad or m, outside the limits.
        """
        self._arm, self._joints = arm, arm.joint_names
        # Lists: of so few numbers, Python compares them faster than numpy.
        self._lower: list[float] = (arm.lower - margin).tolist()
        self._upper: list[float] = (arm.upper + margin).tolist()
        self._names: tuple[str, ...] = self._joints
        self._index: NDArray[np.intp] | None = None  # None: the message's order is the arm's
        self._held_at: list[tuple[int, str, float]] = []  # held joints that the messages have

    def read(
        self,
        stamp: int,
        names: Sequence[str],
        position: Sequence[float] | Array,
        velocity: ArrayLike,
        effort: ArrayLike,
    ) -> Sample:
        """Return the sample in a message's fields.

        Raises:
            DroppedSampleError: No command may answer it.
        """
        if stamp == 0:
            raise DroppedSampleError("no_stamp", "stamp 0, the console's mark of invalid data")
        self._match(tuple(names))
        values = self._pick("position", position)
        if values is None:
            raise DroppedSampleError("wrong_length", f"no positions for {len(self._names)} names")
        for low, value, high in zip(self._lower, values.tolist(), self._upper, strict=True):
            if not low <= value <= high:
                raise self._out_of_range(values)
        for index, name, at in self._held_at:
            if not abs(position[index] - at) <= STAYS:
                raise DroppedSampleError(
                    "not_held",
                    f"{name} is at {position[index]:.4g}, the model expects it fixed at {at:.4g}",
                )
        # The measured effort serves the start alone: without it the message is still valid.
        try:
            applied = self._pick("effort", effort)
        except DroppedSampleError:
            applied = None
        if applied is not None:
            applied = self._arm.torque_of_reading(applied)
        return Sample(stamp, values, self._pick("velocity", velocity), applied)

    def _match(self, names: tuple[str, ...]) -> None:
        """Find the joints among the names, which hardly ever change."""
        if names == self._names:
            return
        indices = []
        for joint in self._joints:
            count = names.count(joint)
            if count == 0:
                raise DroppedSampleError(
                    "missing_joint", f"no joint {joint} among {list(names)[:9]}"
                )
            if count > 1:
                raise DroppedSampleError("duplicate_joint", f"joint {joint} appears {count} times")
            indices.append(names.index(joint))
        other = other_arm(self._arm.name, names)
        if other:
            raise DroppedSampleError(
                "other_arm", f"the joints of arm {other}, expected those of {self._arm.name} alone"
            )
        self._names = names
        self._held_at = [
            (names.index(name), name, at) for name, at in self._arm.held.items() if name in names
        ]
        self._index = None if names == self._joints else np.array(indices)

    def _pick(self, field: str, given: ArrayLike) -> Array | None:
        values = np.asarray(given, dtype=float)
        if len(values) != len(self._names):
            if len(values) == 0:
                return None
            raise DroppedSampleError(
                "wrong_length", f"{len(values)} numbers of {field} for {len(self._names)} names"
            )
        picked = values if self._index is None else values[self._index]
        if not all(map(math.isfinite, picked.tolist())):
            joint = self._joints[int(np.argmin(np.isfinite(picked)))]
            raise DroppedSampleError("not_finite", f"{field} of {joint} is not a finite number")
        return picked

    def _out_of_range(self, values: Array) -> DroppedSampleError:
        joint = int(np.argmin((values >= self._lower) & (values <= self._upper)))
        return DroppedSampleError(
            "out_of_range",
            f"{self._joints[joint]} at {values[joint]:.4g} {self._arm.units[joint]}, expected "
            f"{self._lower[joint]:.4g} to {self._upper[joint]:.4g}: "
            "the model of another arm, a wrong unit, or a broken encoder?",
        )
