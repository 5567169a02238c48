"""A smooth way from one position to another within velocity and acceleration limits."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# What a careful operator would ask of an MTM: rad/s and rad/s^2 of each joint.
VELOCITY_LIMIT = np.array([0.8, 0.8, 0.8, 1.5, 2.0, 2.0, 4.0])
ACCELERATION_LIMIT = np.array([4.0, 4.0, 4.0, 8.0, 10.0, 10.0, 20.0])

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
        time: float = 0.0,
        velocity: Array = VELOCITY_LIMIT,
        acceleration: Array = ACCELERATION_LIMIT,
    ) -> None:
        """Plan.

        Args:
            start: (7,) rad.
            goal: (7,) rad.
            time: When it leaves, s.
            velocity: (7,) greatest velocities, rad/s.
            acceleration: (7,) greatest accelerations, rad/s^2.
        """
        self._start, self._way, self._time = start, goal - start, time
        way = np.abs(self._way)
        by_velocity = _SLOPE * way / velocity
        by_acceleration = np.sqrt(_CURVATURE * way / acceleration)
        self.duration = float(max(by_velocity.max(), by_acceleration.max()))

    def at(self, time: float) -> tuple[Array, Array]:
        """Return (7,) position, rad, and (7,) velocity, rad/s."""
        if time >= self._time + self.duration:
            return self._start + self._way, np.zeros_like(self._way)
        s = max(0.0, (time - self._time) / self.duration)
        path = s**3 * (10.0 + s * (6.0 * s - 15.0))
        slope = 30.0 * s**2 * (1.0 - s) ** 2 / self.duration
        return self._start + path * self._way, slope * self._way
