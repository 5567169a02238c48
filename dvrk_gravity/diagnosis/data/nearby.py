"""What a motion that is nearly the same changes of the efforts: roughly, by masses and friction.

No model of the arm that is worth a name: links' inertial parameters that the motion does not tell
apart are shared out anyhow. Only its change from one motion to another one close by is used.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.motion import MeasuredMotion
from dvrk_gravity.effects.base import rigid_body
from dvrk_gravity.estimation import solve


@dataclass(frozen=True)
class NearbySettings:
    """How a torque is fitted that serves only close by.

    Attributes:
        ridge: Added to normal equations of unit diagonal, of links' parameters that the motion does
            not tell apart: ten times the square root of a double's precision.
    """

    ridge: float = 1e-7


@dataclass(frozen=True, eq=False)
class NearbyTorque:
    """Torque of links' masses, and of each joint's Coulomb and viscous friction.

    Attributes:
        links: (10 bodies,) the links' inertial parameters, in the order of ``rigid_body``.
        friction: (2, n) N·m and N·m·s/rad.
    """

    links: Array
    friction: Array

    @classmethod
    def fit(
        cls,
        motion: MeasuredMotion,
        target: Array | None = None,
        settings: NearbySettings | None = None,
    ) -> NearbyTorque:
        """Fit to a motion, every joint by its own scale.

        Args:
            motion: N samples.
            target: (N, n) torques, N·m; by default the measured efforts.
            settings: How.
        """
        settings = settings or NearbySettings()
        target = motion.effort if target is None else target
        weight = 1.0 / np.maximum(target.std(axis=0), 1e-9) * motion.present
        links, n = rigid_body.PER_LINK * len(motion.arm.bodies), motion.arm.n
        gram, right = np.zeros((links + 2 * n,) * 2), np.zeros(links + 2 * n)
        ways = _ways(motion)
        for rows in motion.pieces():
            inertial = motion.regressor(rows, motion.gravity)
            friction = [way[rows, :, None] * np.eye(n) for way in ways]
            columns = np.concatenate([inertial, *friction], axis=2) * weight[:, None]
            columns = columns.reshape(-1, len(right))
            gram += columns.T @ columns
            right += columns.T @ (target[rows] * weight).ravel()
        found = solve(gram, right, settings.ridge)
        return cls(found[:links], found[links:].reshape(2, n))

    def torque(self, motion: MeasuredMotion) -> Array:
        """Return (N, n) torques in a motion, N·m."""
        return np.asarray(self.inertial_torque(motion) + self.friction_torque(motion))

    def friction_torque(self, motion: MeasuredMotion) -> Array:
        """Return (N, n) torques of the joints' friction alone, N·m."""
        sign, speed = _ways(motion)
        return np.asarray(self.friction[0] * sign + self.friction[1] * speed)

    def inertial_torque(self, motion: MeasuredMotion, gravity: Array | None = None) -> Array:
        """Return (N, n) torques of the links alone, N·m; by default in the motion's gravity."""
        return rigid_body.torque(
            motion.arm, self.links, motion.true_q, motion.qd, motion.qdd,
            motion.gravity if gravity is None else gravity,
        )  # fmt: skip


def _ways(motion: MeasuredMotion) -> tuple[Array, Array]:
    """Return (N, n) direction and speed of the joints."""
    sign = np.column_stack([motion.sign(row) for row in np.eye(motion.arm.n)])
    return sign, motion.qd
