"""A speed that the compensator itself causes: beyond a joint's limit, it is a fault."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arrays import Array


@dataclass(frozen=True)
class GuardSettings:
    """What tells an arm that runs away from one that is thrown.

    Attributes:
        window: All signs must point at the compensator for so long, s. A flick of a hand is beyond
            the limit for less; an arm that runs away stays there.
    """

    window: float = 0.1


SETTINGS = GuardSettings()


class SpeedGuard:
    """Tells a joint that runs away from one that a hand throws.

    A joint runs away if, beyond its speed limit, for ``window`` without a break, the command
    pushes along the motion (its power into the joint is positive) and the joint does not slow down.
    What is thrown slows down as soon as the hand lets go, since only part of its friction is
    compensated; and what falls is pushed against by the command that bears it. A hand that pushes
    a joint beyond its limit for as long, along with the command, is stopped as well.
    """

    def __init__(
        self, joint_names: Sequence[str], speed_limit: Array, units: Sequence[str] = ()
    ) -> None:
        """Begin to watch.

        Args:
            joint_names: Names of the joints, for the reason.
            speed_limit: (n,) rad/s or m/s.
            units: Of the joints' positions, for the reason; rad where they are not given.
        """
        self._names = tuple(joint_names)
        self._units = tuple(units) or ("rad",) * len(self._names)
        self._since: dict[int, tuple[float, float]] = {}  # by joint: time and speed at first
        self.limit(speed_limit)

    def limit(self, speed_limit: Array) -> None:
        """Take other (n,) limits, rad/s or m/s; a joint that is beyond them already stays noted."""
        self._limit = np.array(speed_limit)
        self._least = float(np.min(self._limit)) ** 2

    def check(self, velocity: Array, command: Array, now: float) -> str | None:
        """Take a sample; return why the arm must be held, ``None`` if all is well.

        Args:
            velocity: (n,) rad/s or m/s.
            command: (n,) the last command sent, N·m or N.
            now: Monotonic time, s.
        """
        if not self._since and velocity.dot(velocity) <= self._least:
            return None
        beyond = np.abs(velocity) > self._limit
        if not np.count_nonzero(beyond):
            if self._since:
                self._since.clear()
            return None
        driven = beyond & (velocity * command > 0.0)
        for joint, runs in enumerate(driven.tolist()):
            if not runs:
                self._since.pop(joint, None)
                continue
            speed = abs(float(velocity[joint]))
            start, first = self._since.setdefault(joint, (now, speed))
            if now - start < SETTINGS.window:
                continue
            if speed >= first:
                return (
                    f"{self._names[joint]} runs away: {speed:.3g} {self._units[joint]}/s, at most "
                    f"{self._limit[joint]:g}, and for {SETTINGS.window:g} s the command has pushed "
                    "along; is the model's gravity or friction too large, the arm another one, or "
                    "does a hand drive it?"
                )
            self._since[joint] = (now, speed)  # it slows down: look on from here
        return None
