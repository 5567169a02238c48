"""Static poses of some recordings as arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.identification.hand import beyond_limits
from dvrk_gravity.identification.motion import require_all, require_measured
from dvrk_gravity.identification.static_gravity import gravity_of
from dvrk_gravity.recording import Coordinates, DataWarning, Recording, about, prepare


@dataclass(frozen=True)
class PosedSettings:
    """What some static poses must hold.

    Attributes:
        least: Poses for each of gravity's parameters, of which an MTM has ten. Chosen.
        fewest: Poses in any case. Chosen: four in each of the five blocks that are held out.
        posed: Way below which a joint was not posed, rad (10 mm where it slides). Chosen: 6 deg;
            one that was asked to stay is off by less.
        rarer: Part of the poses that must have come from the rarer direction. Chosen.
        blocks: Held out one after the other where no joint has three positions (Kohavi 1995: five
            to ten).
        driven: Part of the error that a model leaves, of which less than no friction may be
            chance. Chosen.
    """

    least: int = 2
    fewest: int = 20
    posed: float = 0.1
    rarer: float = 0.1
    blocks: int = 5
    driven: float = 0.3


@dataclass(frozen=True, eq=False)
class Poses:
    """Static poses in joint coordinates.

    Attributes:
        q: (N, n) rad or m.
        effort: (N, n) N·m or N.
        direction: (N, n) +1/-1; 0 where it is not known.
        part: (N,) index of the recording.
        scale: (n,) what counts as much as a rad, by joint (``Arm.scale``).
        settings: What they must hold.
    """

    q: Array
    effort: Array
    direction: Array
    part: NDArray[np.int64]
    scale: Array
    settings: PosedSettings = field(default_factory=PosedSettings)

    def __len__(self) -> int:
        """Return the number of poses."""
        return len(self.q)

    def rows(self, selection: NDArray[np.bool_]) -> Poses:
        """Return the poses that a mask selects."""
        return Poses(
            self.q[selection],
            self.effort[selection],
            self.direction[selection],
            self.part[selection],
            self.scale,
            self.settings,
        )

    @cached_property
    def lower(self) -> Array:
        """(n,) least position of each joint, rad or m."""
        return self.q.min(axis=0)

    @cached_property
    def upper(self) -> Array:
        """(n,) greatest position of each joint, rad or m."""
        return self.q.max(axis=0)

    @cached_property
    def moving(self) -> tuple[int, ...]:
        """Joints that were posed differently."""
        least = self.settings.posed * self.scale
        return tuple(np.flatnonzero(self.upper - self.lower > least).tolist())

    @property
    def undirected(self) -> tuple[int, ...]:
        """Joints whose friction the poses do not tell apart."""
        return tuple(joint for joint, told in enumerate(self.directed) if not told)

    @cached_property
    def directed(self) -> tuple[bool, ...]:
        """(n,) whether friction can be told from cable: both directions occur often enough."""
        up, down = (self.direction > 0).mean(axis=0), (self.direction < 0).mean(axis=0)
        return tuple((np.minimum(up, down) >= self.settings.rarer).tolist())


def _require_measured(poses: Recording) -> None:
    """Refuse efforts that were not measured: of a joint that was posed."""
    assert poses.effort is not None
    posed = np.ptp(poses.position, axis=0) > PosedSettings().posed * poses.scale
    moved = [joint for joint, moves in zip(poses.joints, posed, strict=True) if moves]
    require_measured(poses.source, moved, poses.effort[:, posed])


def read_poses(
    recordings: Sequence[Recording], arm: Arm, coordinates: Coordinates
) -> tuple[Poses, tuple[DataWarning, ...]]:
    """Return the poses of some recordings, and what was found in these.

    Raises:
        RecordingError: A joint or the efforts missing, too few poses, or nothing that moves.
    """
    q, effort, direction, part = [], [], [], []
    warnings: list[DataWarning] = []
    sources = [recording.source for recording in recordings]
    for index, recording in enumerate(recordings):
        require_all(recording, arm)
        warnings += about(index, sources, prepare(recording).warnings)
        position, torque = recording.position, recording.effort
        assert torque is not None
        _require_measured(recording)
        if coordinates == "actuator":
            position, torque = arm.joint_position(position), arm.joint_effort(torque)
        warnings += about(index, sources, beyond_limits(position, arm))
        q.append(position)
        effort.append(torque)
        given = recording.direction
        direction.append(np.zeros(position.shape) if given is None else given)
        part.append(np.full(len(position), index))
    poses = Poses(
        np.concatenate(q), np.concatenate(effort), np.concatenate(direction),
        np.concatenate(part), arm.scale,
    )  # fmt: skip
    settings = poses.settings
    least = max(settings.fewest, settings.least * gravity_of(arm).count)
    if len(poses) < least:
        raise RecordingError(
            recordings[0].source, f"holds {len(poses)} static poses, expected at least {least}"
        )
    return poses, tuple(warnings)
