"""A speed that the compensator itself causes: beyond a joint's limit, it is a fault."""

from __future__ import annotations

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array

# All signs must point at the compensator for so long, s. A flick of a hand is beyond the limit for
# less; an arm that runs away stays there.
WINDOW = 0.1


class SpeedGuard:
    """Distinguishes a joint that runs away from one that a hand throws.

    A joint runs away if, beyond its speed limit, for ``WINDOW`` without a break, the command pushes
    along the motion (its power into the joint is positive) and the joint does not slow down.
    A thrown joint slows down as soon as the hand lets go, since only part of its friction is
    compensated; and the command pushes against a joint that falls. A hand that pushes a joint
    beyond its limit for as long, along with the command, is stopped as well.
    """

    def __init__(self, arm: Arm, speed_limit: Array) -> None:
        """Watch an arm's joints, with (n,) limits, rad/s or m/s."""
        self._joints = arm.joints
        self._since: dict[int, tuple[float, float]] = {}  # by joint: time and speed at first
        self.limit(speed_limit)

    def limit(self, speed_limit: Array) -> None:
        """Replace the (n,) limits, rad/s or m/s; a joint beyond the former ones stays noted."""
        self._limit = np.array(speed_limit)
        self._least = float(np.min(self._limit)) ** 2

    def check(self, velocity: Array, command: Array, now: float) -> str:
        """Return why the arm must be held, ``""``: all is well.

        Args:
            velocity: (n,) rad/s or m/s.
            command: (n,) last command, N·m or N.
            now: Monotonic time, s.
        """
        if not self._since and velocity.dot(velocity) <= self._least:
            return ""
        beyond = np.abs(velocity) > self._limit
        if not np.count_nonzero(beyond):
            self._since.clear()
            return ""
        driven = beyond & (velocity * command > 0.0)
        for index, runs in enumerate(driven.tolist()):
            if not runs:
                self._since.pop(index, None)
                continue
            speed = abs(float(velocity[index]))
            start, first = self._since.setdefault(index, (now, speed))
            if now - start < WINDOW:
                continue
            if speed >= first:
                joint = self._joints[index]
                return (
                    f"{joint.name} runs away: {speed:.3g} {joint.unit}/s, at most "
                    f"{self._limit[index]:g}, and the command pushed along for {WINDOW:g} s: is "
                    "the model's gravity or friction too large, is it another arm, or does a hand "
                    "drive the joint?"
                )
            self._since[index] = (now, speed)  # it slows down: watch on from here
        return ""
