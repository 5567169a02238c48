"""Friction and cables of the worlds, written apart from the effects that they test.

The formulas are the textbook's; what is shared with the package is how its plant wants them told.
"""

from __future__ import annotations

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import PlantPart


def coulomb(levels: Array) -> PlantPart:
    """Return constant friction from (4, n) N·m: joint up, joint down, motor up, motor down."""
    joint_up, joint_down, motor_up, motor_down = levels
    return PlantPart(dry=np.array([np.r_[joint_up, motor_up], np.r_[joint_down, motor_down]]))


def stribeck(levels: Array, velocities: Array) -> PlantPart:
    """Return friction level exp(-(v / velocity)^2) at the joints, (n,) N·m and (n,) rad/s."""
    nothing = np.zeros(len(levels))
    width = np.where(levels > 0.0, velocities, np.inf)

    def remaining(v: Array) -> Array:
        return np.concatenate([np.exp(-((v / width) ** 2)), nothing])

    both_ways = np.r_[levels, nothing]
    return PlantPart(dry=np.array([both_ways, both_ways]), fade=remaining)


def viscous(coefficients: Array) -> PlantPart:
    """Return friction proportional to the joints' velocities, (n,) N·m·s/rad."""
    return PlantPart(damping=np.diag(coefficients))


def cable(coefficients: Array) -> PlantPart:
    """Return the elastic torque of each joint's position, (k, n) N·m/rad^power."""

    def at(q: Array, v: Array) -> tuple[Array, None]:
        torque = np.zeros(len(q))
        for row in coefficients[::-1]:
            torque = torque * q + row
        return torque, None

    return PlantPart(at=at)
