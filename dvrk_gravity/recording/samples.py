"""Samples of some joints as arrays, not yet checked: what readers return and writers take."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arms import Arm, other_arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import stated_weight
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.recording.notes import Kind, Note, merged, note

Coordinates = Literal["joint", "actuator"]
TimeBase = Literal["stamp", "receive"]
Storage = Literal["sqlite3", "mcap"]

QUANTITIES = ("position", "velocity", "effort")
CHUNK = 4_000  # samples read at a time
LARGEST = 1e12  # no reading of a robot; keeps squares and sums finite


@dataclass(frozen=True, eq=False)
class Samples:
    """N samples of n joints.

    Attributes:
        joints: Names of the n columns; joints that were not recorded are left out. Of an arm, they
            are in its order.
        time: ``(N,)`` s, strictly increasing, relative to ``start_ns`` (so the first sample
            of a file is at 0; a slice keeps its own times). ``None``: static poses.
        position: ``(N, n)`` rad or m.
        velocity: ``(N, n)`` rad/s or m/s, or ``None`` where not recorded; NaN throughout of a
            joint without it.
        effort: ``(N, n)`` N·m or N that the actuators apply, like ``velocity``.
        direction: ``(N, n)``, +1 or -1: how a static pose was approached, or ``None``.
        coordinates: ``"joint"`` (what measured_js publishes) or ``"actuator"`` (motors).
        source: File or folder that it came from.
        start_ns: Absolute stamp of time 0, ns; 0 where the file has none.
        invalid: Number of messages left out with stamp 0, by which the dVRK marks invalid data.
        repeated: Number of samples left out with the stamp of the sample before.
        arm: Whose joints these are; ``None`` where it is not known: then units are not known.
        notes: Other findings of the reader.
        effort_limit: By joint, where its efforts are known to be clipped, N·m or N.
    """

    joints: tuple[str, ...]
    time: Array | None
    position: Array
    velocity: Array | None = None
    effort: Array | None = None
    direction: Array | None = None
    coordinates: Coordinates = "joint"
    source: str = "recording"
    start_ns: int = 0
    invalid: int = 0
    repeated: int = 0
    arm: Arm | None = None
    notes: tuple[Note, ...] = ()
    effort_limit: Mapping[str, float] = field(default_factory=dict)

    def __len__(self) -> int:
        """Return the number of samples N."""
        return self.position.shape[0]

    @property
    def rate(self) -> float | None:
        """Sampling rate from the median interval, Hz; ``None`` for static poses or one sample."""
        if self.time is None or len(self) < 2:
            return None
        return float(1.0 / np.median(np.diff(self.time)))

    @property
    def scale(self) -> Array:
        """(n,) rad or m that count as much as a rad; see ``Arm.scale``."""
        if self.arm is None:
            return np.ones(len(self.joints))
        return self.arm.scale[[self.arm.joint_names.index(joint) for joint in self.joints]]

    def rows(self, selection: slice | Sequence[int] | NDArray[np.bool_ | np.integer]) -> Self:
        """Return the samples that a slice, index array or mask of length N selects."""
        arrays: dict[str, Any] = {name: a[selection] for name, a in self.arrays().items()}
        return replace(self, **arrays)

    def arrays(self) -> dict[str, Array]:
        """Return the arrays of the samples by name, without those that were not recorded."""
        named = ((name, getattr(self, name)) for name in ("time", *QUANTITIES, "direction"))
        return {name: array for name, array in named if array is not None}

    @property
    def found(self) -> tuple[Note, ...]:
        """All findings of the reader."""
        counted: tuple[tuple[Kind, int, str], ...] = (
            ("invalid_stamps", self.invalid, "with stamp 0 (marked invalid)"),
            ("repeated_stamps", self.repeated, "with the time of the sample before"),
        )
        notes = (note(kind, text, left_out=count) for kind, count, text in counted if count)
        return (*notes, *self.notes)

    def with_found(self, others: Iterable[Samples]) -> Self:
        """Return the same samples with the findings about others added."""
        parts: tuple[Samples, ...] = (*others, self)
        return replace(
            self,
            invalid=sum(part.invalid for part in parts),
            repeated=sum(part.repeated for part in parts),
            notes=merged(note for part in parts for note in part.notes),
        )

    def counted(self) -> Self:
        """Return the same samples without findings, which are counted elsewhere."""
        return replace(self, invalid=0, repeated=0, notes=())


SamplesT = TypeVar("SamplesT", bound=Samples)


def not_recorded(values: Array | None) -> NDArray[np.bool_]:
    """Return (n,): the columns of (N, n) values that were not recorded, NaN throughout."""
    if values is None or not np.isnan(values[:1]).any():
        return np.zeros(0 if values is None else values.shape[1], dtype=bool)
    return np.asarray(np.isnan(values).all(axis=0))


def check_joints(source: str, names: Collection[str], arm: Arm | None) -> None:
    """Raise ``RecordingError`` if a file's joints are those of another arm than the expected."""
    other = other_arm(arm.name, names) if arm else ""
    if arm and other:
        raise RecordingError(
            source,
            f"has the joints of arm {other}, expected those of {arm.name} alone: --arm {other}, or "
            f"a --model of {other}",
        )


def join(parts: Sequence[SamplesT]) -> SamplesT:
    """Return consecutive parts of one recording as one."""
    if len(parts) == 1:
        return parts[0]

    arrays: dict[str, Any] = {}
    for name in parts[0].arrays():
        arrays[name] = np.concatenate([getattr(part, name) for part in parts])
        arrays[name].flags.writeable = False
    return replace(parts[0], **arrays).counted().with_found(parts)


def converted(
    effort: Array | None, position: Array, joints: Sequence[str],
    before: Arm | None, after: Arm | None,
) -> Array | None:  # fmt: skip
    """Return (N, k) efforts in one arm's terms in another's: drive gains, weight in the reading.

    Efforts that an arm reads without its weight are completed by the masses in its file; if the
    file states none, or a joint was not recorded, they stay.

    Args:
        effort: (N, k), ``None`` where not recorded.
        position: (N, k) rad or m.
        joints: Names of the k joints.
        before: The arm in whose terms they are; ``None``: as they were read.
        after: The arm in whose terms they are to be; ``None``: as they were read.
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
    if unread[1] is not None:  # what was never measured stays zero
        result = np.where(result.any(axis=0), result + unread[1], 0.0)
    result.flags.writeable = False
    return result


def _unread(position: Array, joints: Sequence[str], arm: Arm | None) -> Array | None:
    """Return the (N, k) weight that an arm's readings lack, if they do and its file states it."""
    if arm is None or arm.gravity_in_reading or tuple(joints) != arm.joint_names:
        return None
    return stated_weight(arm, position)
