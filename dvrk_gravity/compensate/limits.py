"""Limits on a command: joint space, actuator space, and how fast it may change."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array

# Part of a joint's effort limit from which on a torque counts as support that an arm misses. Real
# dry friction holds about that: efforts of MTMR-28002's static poses differ from its calibrated
# model by 0.004 to 0.19 of the limits, RMS (DVRK_GRAVITY_DATA's poses).
CONSIDERABLE = 0.1
# Considerable changes take at least so long, s: a person's reaction to a touch takes 0.15 to 0.2 s.
LEAST_RAMP = 0.2

# N·m; less than these is rounding: of a difference, and of a limit of zero in the other space.
_NO_DIFFERENCE, _NO_LIMIT = 1e-9, 1e-12


@dataclass(frozen=True, eq=False)
class EffortLimits:
    """Boxes in joint space and in actuator space that a command stays within.

    Both are convex and contain zero: scaling towards zero never leaves them, nor does the segment
    between two commands within them.

    Attributes:
        arm: The arm, for its transmission.
        joint: (n,) largest joint torques, N·m.
        actuator: (n,) largest actuator torques, N·m.
    """

    arm: Arm
    joint: Array
    actuator: Array

    def clip(self, torque: Array) -> Array:
        """Return (n,) joint torques as near as simple clipping gets, within both boxes.

        Torques near the largest float are clipped like others; numpy warns of the overflow unless
        ``np.errstate`` is set.
        """
        if np.count_nonzero(self._to_bounds.dot(torque) <= self._bounds) == len(self._bounds):
            return torque
        within = np.minimum(np.maximum(torque, -self.joint), self.joint)
        motor = self.arm.actuator_effort(within)
        if (np.abs(motor) <= self.actuator).all():
            return within
        motor = np.minimum(np.maximum(motor, -self.actuator), self.actuator)
        return self._shrink(self.arm.joint_effort(motor))

    def _shrink(self, torque: Array) -> Array:
        """Return ``torque``, coupled joints scaled by one factor until within both boxes."""
        joint = np.abs(torque) / np.maximum(self.joint, _NO_LIMIT)
        motor = np.abs(self.arm.actuator_effort(torque)) / np.maximum(self.actuator, _NO_LIMIT)
        excess = np.maximum(joint, motor)[self.coupled].max(initial=1.0)
        return np.where(self.coupled, torque / excess, torque)

    def widened(self, joint: Array, actuator: Array) -> EffortLimits:
        """Return boxes that reach at least to (n,) torques of joints and of actuators, N·m."""
        return replace(
            self,
            joint=np.maximum(self.joint, joint),
            actuator=np.maximum(self.actuator, actuator),
        )

    @cached_property
    def _bounds(self) -> Array:
        """(4n,) upper bounds of joint and actuator torques and of their negatives, N·m."""
        return np.tile(np.concatenate([self.joint, self.actuator]), 2)

    @cached_property
    def _to_bounds(self) -> Array:
        """(4n, n) from joint torques to what :attr:`_bounds` bounds."""
        both = np.vstack([np.eye(len(self.joint)), self.arm.actuator_to_joint.T])
        return np.vstack([both, -both])

    @cached_property
    def coupled(self) -> NDArray[np.bool_]:
        """(n,) whether a joint shares a motor; the others' boxes are independent."""
        mixed = self.arm.actuator_to_joint != np.diag(np.diag(self.arm.actuator_to_joint))
        return mixed.any(axis=0) | mixed.any(axis=1)

    def contains(self, torque: Array) -> bool:
        """Return whether (n,) joint torques are within both boxes."""
        return bool((self._to_bounds @ torque <= self._bounds + _NO_DIFFERENCE).all())


def slew(previous: Array, target: Array, step: Array, limits: EffortLimits) -> Array:
    """Return the command that follows ``previous`` on the way to ``target``.

    No joint takes longer than the slowest alone would: ``target`` is reached in as many
    steps as the joint with the longest way needs.

    Args:
        previous: (n,) last command, N·m.
        target: (n,) wanted command, within ``limits``.
        step: (n,) largest change of each joint, N·m; ``inf`` where it is not limited.
        limits: Boxes that hold for the result as soon as they hold for ``previous``; outside
            them (they have been lowered) no coupled joint gets further out.
    """
    change = target - previous
    if np.count_nonzero(np.abs(change) <= step) == len(change):
        return target
    command = previous + np.minimum(np.maximum(change, -step), step)
    if limits.contains(command):
        return command
    # Joint by joint it would leave the actuators' box: coupled joints go along the segment.
    held_back = limits.coupled & (np.abs(change) > step)
    part = (step[held_back] / np.abs(change[held_back])).min(initial=1.0)
    return np.where(limits.coupled, previous + part * change, command)


class Ramp:
    """Fades out the difference between a first command and the wanted torque, without a jump.

    Only the difference fades: the command follows the wanted torque from the beginning where the
    arm is moved meanwhile, however often ramps begin. Limits that were lowered below the first
    command come down with it; the torque under a person's hand does not jump into them.

    Attributes:
        over: The wanted torque has been reached.
    """

    def __init__(self, first: Array, wanted: Array, now: float, duration: float, arm: Arm) -> None:
        """Begin at monotonic time ``now`` between (n,) commands at the same measurement, N·m.

        The ``duration``, s, is longer if their difference is considerable, zero if it is rounding.
        """
        self.over = False
        self._joint, self._actuator = np.abs(first), np.abs(arm.actuator_effort(first))
        self._start = now
        self._difference = first - wanted
        size = np.abs(self._difference)
        considerable = (size > CONSIDERABLE * arm.effort_limit).any()
        self._duration = max(duration, LEAST_RAMP if considerable else 0.0)
        if (size <= _NO_DIFFERENCE).all():
            self._duration = 0.0

    def blend(self, wanted: Array, now: float, limits: EffortLimits) -> Array:
        """Return the (n,) torque on the way to ``wanted``, within the limits, N·m."""
        elapsed = now - self._start
        if elapsed >= self._duration:
            self.over = True
            return wanted
        part = 1.0 - elapsed / self._duration
        widened = limits.widened(part * self._joint, part * self._actuator)
        return widened.clip(wanted + part * self._difference)
