"""A planned motion at another pace: slowly, or from rest in its middle up to its own speed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.collecting.driver import Path, States
from dvrk_gravity.planning import RISE, PlanLimits

# Covered within a ramp of length 1: the integral of 10 s^3 - 15 s^4 + 6 s^5, half of it in the end.
_WAY = RISE.integ()


RAMPS = (1.0, 2.0, 4.0, 8.0)  # s, the shortest one first: longer ones accelerate less
STEP = 1e-3  # s, at which accelerations are looked at: what an arm may be commanded at


@dataclass(frozen=True, eq=False)
class Paced:
    """q(s(t)): the path of a motion, of which s(t) seconds have passed after t.

    s begins at ``begin - speed ramp / 2``, and its rate rises smoothly from 0 to ``speed`` within
    the ramp: an arm at rest beside the path's point takes up the motion, and is at its speed when s
    is ``begin``. So s' <= speed: with a speed of at most 1, positions and velocities are no other
    than the motion's, and accelerations q'' s'^2 + q' s'' only within the ramp.

    Attributes:
        motion: Of it, a path.
        length: Of it, s.
        speed: Rate of s.
        begin: Where the speed is reached, s of the motion.
        ramp: Duration of the ramp, s; 0: none.
    """

    motion: Path
    length: float
    speed: float = 1.0
    begin: float = 0.0
    ramp: float = 0.0

    @property
    def duration(self) -> float:
        """From its beginning to the motion's end, s."""
        return self.ramp + (self.length - self.begin) / self.speed

    def _pace(self, time: Array) -> tuple[Array, Array, Array]:
        if not self.ramp:
            still = np.zeros_like(time)
            return self.begin + self.speed * time, still + self.speed, still
        x = np.clip(time / self.ramp, 0.0, 1.0)
        after = np.maximum(time - self.ramp, 0.0)
        way = self.ramp * (_WAY(x) - _WAY(1.0)) + after
        rate, slope = RISE(x), RISE.deriv()(x) / self.ramp
        return self.begin + self.speed * way, self.speed * rate, self.speed * slope

    def moment(self, time: float) -> float:
        """Return how many seconds of the motion have passed after a time, s."""
        return float(self._pace(np.asarray(time, dtype=float))[0])

    def __call__(self, time: float | Array) -> States:
        """Return position, velocity, acceleration: (n,) each, or (N, n) for (N,) times, s."""
        moment, rate, slope = self._pace(np.asarray(time, dtype=float))
        q, qd, qdd = self.motion(moment if np.ndim(time) else float(moment))
        rate, slope = rate[..., None], slope[..., None]
        return q, qd * rate, qdd * rate**2 + qd * slope


def resumed(
    motion: Path, length: float, begins: list[float], limits: PlanLimits, speed: float = 1.0
) -> Paced:
    """Return the rest of a motion from rest, within limits of acceleration.

    The latest beginning and the shortest ramp that keep them are taken; where none does, it is
    the whole motion.

    Args:
        motion: A path that keeps the limits.
        length: Its duration, s.
        begins: Where its speed may be reached, s of the motion, ascending.
        limits: What to keep.
        speed: Rate of the motion.
    """
    greatest = limits.rates[1]
    for begin in reversed(begins):
        for ramp in RAMPS:
            if begin - 0.5 * speed * ramp < 0.0:
                break
            paced = Paced(motion, length, speed, begin, ramp)
            acceleration = paced(np.arange(0.0, ramp + STEP, STEP))[2]
            if (np.abs(acceleration @ limits.rows.T) <= greatest).all():
                return paced
    return Paced(motion, length, speed)
