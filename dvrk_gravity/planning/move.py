"""A smooth way from one position to another within velocity and acceleration limits."""

from __future__ import annotations

import numpy as np

from dvrk_gravity.arrays import Array

# Greatest slope and curvature of the path 10 s^3 - 15 s^4 + 6 s^5.
_SLOPE = 1.875
_CURVATURE = 10.0 / np.sqrt(3.0)


class Move:
    """All joints leave and arrive together, without a jerk at either end.

    Attributes:
        duration: s.
    """

    def __init__(
        self,
        start: Array,
        goal: Array,
        velocity: Array,
        acceleration: Array,
        time: float = 0.0,
    ) -> None:
        """Plan.

        Args:
            start: (n,) rad or m.
            goal: (n,) rad or m.
            velocity: (n,) greatest velocities, rad/s or m/s.
            acceleration: (n,) greatest accelerations, rad/s^2 or m/s^2.
            time: When it leaves, s.
        """
        self._start, self._way, self._time = start, goal - start, time
        way = np.abs(self._way)
        by_velocity = _SLOPE * way / velocity
        by_acceleration = np.sqrt(_CURVATURE * way / acceleration)
        self.duration = float(max(by_velocity.max(), by_acceleration.max()))

    def at(self, time: float) -> tuple[Array, Array]:
        """Return (n,) position and (n,) velocity."""
        if time >= self._time + self.duration:
            return self._start + self._way, np.zeros_like(self._way)
        s = max(0.0, (time - self._time) / self.duration)
        path = s**3 * (10.0 + s * (6.0 * s - 15.0))
        slope = 30.0 * s**2 * (1.0 - s) ** 2 / self.duration
        return self._start + path * self._way, slope * self._way
