"""Limits on a command: joint space, actuator space, and how fast it may change."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arm import Arm

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class EffortLimits:
    """Boxes in joint space and in actuator space that a command stays within.

    Both boxes contain zero and are convex, so that scaling towards zero, or
    moving along the segment between two commands that satisfy them, never
    leaves them.

    Attributes:
        arm: The arm, for its transmission.
        joint: (7,) largest joint torques, N·m.
        actuator: (7,) largest actuator torques, N·m.
    """

    arm: Arm
    joint: Array
    actuator: Array

    def clip(self, torque: Array) -> Array:
        """Return (7,) joint torques as near as simple clipping gets, within both boxes."""
        within = np.minimum(np.maximum(torque, -self.joint), self.joint)
        motor = self.arm.actuator_effort(within)
        if (np.abs(motor) <= self.actuator).all():
            return within
        motor = np.minimum(np.maximum(motor, -self.actuator), self.actuator)
        return self.shrink(self.arm.joint_effort(motor))

    def shrink(self, torque: Array) -> Array:
        """Return ``torque`` scaled towards zero, all joints alike, until within both boxes."""
        motor = self.arm.actuator_effort(torque)
        excess = max(_largest(torque, self.joint), _largest(motor, self.actuator))
        return torque if excess <= 1.0 else torque / excess

    def contains(self, torque: Array, tolerance: float = 1e-9) -> bool:
        """Tell whether (7,) joint torques are within both boxes."""
        motor = self.arm.actuator_effort(torque)
        return bool(
            (np.abs(torque) <= self.joint + tolerance).all()
            and (np.abs(motor) <= self.actuator + tolerance).all()
        )


def slew(previous: Array, target: Array, step: Array, limits: EffortLimits) -> Array:
    """Return the command that follows ``previous`` on the way to ``target``.

    Args:
        previous: (7,) last command, N·m.
        target: (7,) wanted command, within ``limits``.
        step: (7,) largest change of each joint, N·m; ``inf`` where it is not limited.
        limits: Boxes that hold for the result as soon as they hold for ``previous``.
    """
    change = target - previous
    if (np.abs(change) <= step).all():
        return target
    command = previous + np.minimum(np.maximum(change, -step), step)
    if limits.contains(command) or not limits.contains(previous):
        return command
    # Joint by joint it would leave the actuators' box: go along the segment instead.
    moving = change != 0.0
    return previous + min(1.0, float((step[moving] / np.abs(change[moving])).min())) * change


def _largest(values: Array, limits: Array) -> float:
    """Return the largest |value| / limit; a zero limit allows only zero."""
    magnitude = np.abs(values)
    if (magnitude[limits == 0.0] > 0.0).any():
        return np.inf
    allowed = limits > 0.0
    return float((magnitude[allowed] / limits[allowed]).max(initial=0.0))
