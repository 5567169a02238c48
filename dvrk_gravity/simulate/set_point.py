"""What a stream of commanded positions becomes before the simulated servo follows it."""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

from dvrk_gravity.arrays import Array

# Four equal lags: positions that come as steps, 1 rad/s at 100 Hz, leave the servo accelerations of
# 0.02 rad/s^2 at that frequency, a hundredth of an exciting motion's; two lags leave 10 rad/s^2.
LAGS = 4
# Time constant of each, s. Together 80 ms behind the commands: industrial controllers that take
# streamed positions look ahead by 30 to 200 ms for the same purpose (UR's `servoj`).
TIME_CONSTANT = 0.02


class SetPointFilter:
    """A low-pass of equal lags, exact for commands that stay until the next one comes.

    The simulated servo is far stiffer than a real MTM's. Given steps as they come it would answer
    each with a blow of torque, which a recording samples too rarely to tell from the motion's own.
    Behind this filter the set point is smooth at any rate of the commands, and however unevenly
    they come.
    """

    def __init__(self, start: Array, dt: float) -> None:
        """Begin at rest.

        Args:
            start: (n,) position, rad.
            dt: Time between two calls of :meth:`step`, s.
        """
        rates = (np.eye(LAGS, k=-1) - np.eye(LAGS)) / TIME_CONSTANT
        self._carry = expm(rates * dt)
        self._take = (1.0 - self._carry.sum(axis=1))[:, None]
        self._state = np.tile(start, (LAGS, 1))

    @property
    def position(self) -> Array:
        """(n,) position that it is at, rad."""
        return self._state[-1]

    def step(self, command: Array) -> tuple[Array, Array]:
        """Go one step on; return (n,) position, rad, and (n,) velocity, rad/s."""
        self._state = self._carry.dot(self._state) + self._take * command
        position = self._state[-1]
        return position, (self._state[-2] - position) / TIME_CONSTANT
