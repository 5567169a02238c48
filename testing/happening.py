"""What befalls an arm in the middle of a recording, and what records it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.recording import Recording
from testing.flight_motion import PausedMotion
from testing.lab_motion import Sines
from testing.mujoco_arms import MujocoArm

What = Literal[
    "payload", "coulomb_friction", "elastic_cable", "joint_offset", "torque_scale", "push",
    "drift", "base_tilt", "link_com", "gripper",
]  # fmt: skip


@dataclass(frozen=True, eq=False)
class Happening:
    """Something that begins at a moment, and stays or goes.

    Attributes:
        what: Its kind.
        joint: Index of the joint, or of the joint whose link it acts on.
        start: From when on, s of the recording's time; ``-inf``: before it.
        size: Of a load kg (of a gripper's moving part, too), of friction N·m or N, of a zero rad
            or m, of a scale the factor on the reading, of a push its impulse in N·s, of a drift its
            height in N·m or N, of a tilt rad; of a link's centre of mass the part of its distance
            from the joint. A cable that snaps needs none.
        where: (3,) of a load its place in the link's frame, m; of a push its direction in the base;
            of a tilt its axis in the base; of a gripper how its part moves, m; of a
            link its centre.
        lasts: Of a push, a drift and a gripper's motion, s.
        even: Of a push: whether it rises, stays and falls instead of being half a sine.
    """

    what: What
    joint: int = 0
    start: float = -np.inf
    size: float = 0.0
    where: Array | None = None
    lasts: float = np.inf
    even: bool = False

    @property
    def place(self) -> Array:
        """(3,) ``where``, which this kind has."""
        assert self.where is not None
        return self.where

    @property
    def end(self) -> float:
        """When it is over, s."""
        return self.start + self.lasts if np.isfinite(self.lasts) else np.inf

    def acts(self, time: Array) -> Mask:
        """Return (T,) whether it acts at (T,) times, s; the ends count."""
        return (time >= self.start) & (time <= self.end)

    def force(self, time: Array) -> Array:
        """Return (T, 3) the force of a push at (T,) times, N; its integral is ``size``."""
        part = np.clip((np.asarray(time) - self.start) / self.lasts, 0.0, 1.0)
        if self.even:  # a quarter of the time to rise, a quarter to fall
            shape = np.minimum(1.0, 4.0 * np.minimum(part, 1.0 - part)) / 0.75
        else:
            shape = 0.5 * np.pi * np.sin(np.pi * part)
        shape = np.where(self.acts(time), self.size / self.lasts * shape, 0.0)
        return shape[:, None] * self.place

    def grown(self, time: Array) -> Array:
        """Return (T,) how much of something slow is there: 0 before, 1 after it, smooth between."""
        part = np.clip((np.asarray(time) - self.start) / self.lasts, 0.0, 1.0)
        return np.asarray(part**2 * (3.0 - 2.0 * part))

    def tilted(self, gravity: Array) -> Array:
        """Return (3,) gravity in a base that is turned about ``where`` by ``size``, m/s^2."""
        return Rotation.from_rotvec(-self.size * self.place).apply(gravity)

    def read(self, time: Array, q: Array, effort: Array) -> tuple[Array, Array]:
        """Return what is read of positions and efforts (T, n) where only the reading changes."""
        after = np.asarray(time) >= self.start
        q, effort = q.copy(), effort.copy()
        if self.what == "joint_offset":
            q[after, self.joint] += self.size
        elif self.what == "torque_scale":
            effort[after, self.joint] *= self.size
        elif self.what == "drift":
            slow = np.clip((np.asarray(time) - self.start) / self.lasts, 0.0, 1.0)
            effort[:, self.joint] += self.size * slow
        return q, effort


class Bench(Protocol):
    """An arm that flights are recorded of."""

    @property
    def arm(self) -> Arm:
        """What the package knows of it."""

    @property
    def calibration(self) -> Sines:
        """The motion that it is identified from."""

    @property
    def engine(self) -> MujocoArm:
        """Its rigid body in MuJoCo."""

    @property
    def friction(self) -> Array:
        """(n,) about the level of its joints' friction, N·m or N."""

    @property
    def noise(self) -> Array:
        """(n,) standard deviation of an effort that is read, N·m or N at the joints."""

    @property
    def cable(self) -> int:
        """Index of the joint that has a cable that can snap."""

    def calibrate(self) -> Recording:
        """Return the recording that the arm is identified from, in joint coordinates."""

    def record(
        self, motion: PausedMotion, duration: float, happening: Happening | None, seed: int
    ) -> Recording:
        """Record a motion in which something happens, or nothing.

        Args:
            motion: What the controller follows.
            duration: s.
            happening: What happens.
            seed: Of the noise.
        """

    def cable_torque(self, q: Array) -> Array:
        """Return (T, n) efforts of the cable that can snap at positions (T, n), N·m or N."""
