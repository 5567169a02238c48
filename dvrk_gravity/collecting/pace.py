"""A planned motion at another pace: slowly, or from rest in its middle up to its own speed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.collecting.driver import States
from dvrk_gravity.planning import (
    RISE,
    RISE_BOUNDS,
    FourierMotion,
    PlanLimits,
    PosePath,
    worst_violation,
)

# Covered within a ramp of length 1: the integral of 10 s^3 - 15 s^4 + 6 s^5, half of it in the end.
_WAY = RISE.integ()
RAMPS = (1.0, 2.0, 4.0, 8.0)  # s, the shortest one first: longer ones accelerate less. Chosen
_STEP = 1e-3  # s, of the grid within a ramp


@dataclass(frozen=True, eq=False)
class PacedMotion:
    """q(s(t)): the path of a motion, of which s(t) seconds have passed after t.

    s begins at ``begin - speed ramp / 2``, and its rate rises smoothly from 0 to ``speed`` within
    the ramp: an arm at rest beside the path's point takes up the motion, and is at its speed when s
    is ``begin``. So s' <= speed: with a speed of at most 1, positions and velocities are no other
    than the motion's, and accelerations q'' s'^2 + q' s'' only within the ramp.

    Attributes:
        motion: The motion.
        speed: Rate of s.
        begin: Where the speed is reached, s of the motion.
        ramp: Duration of the ramp, s; 0: none.
    """

    motion: FourierMotion | PosePath
    speed: float = 1.0
    begin: float = 0.0
    ramp: float = 0.0

    @property
    def duration(self) -> float:
        """From its beginning to the motion's end, s."""
        return self.ramp + (self.motion.duration - self.begin) / self.speed

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

    @property
    def whole(self) -> bool:
        """Whether it is nothing but the motion."""
        return self.speed == 1.0 and not self.ramp and not self.begin

    def at(self, time: float | Array) -> States:
        """Return position, velocity, acceleration: (n,) each, or (N, n) for (N,) times, s."""
        moment, rate, slope = self._pace(np.asarray(time, dtype=float))
        q, qd, qdd = self.motion.at(moment if np.ndim(time) else float(moment))
        rate, slope = rate[..., None], slope[..., None]
        return q, qd * rate, qdd * rate**2 + qd * slope

    def grid(self, step: float, rows: Array) -> tuple[Array, Array]:
        """Return times and how much may be exceeded beside each: :meth:`FourierMotion.grid`.

        Within the ramp bounds of the derivatives of q(s(t)) are those of q and of s, by the chain
        rule; after it, those of q times powers of the speed.
        """
        moments, extra = self.motion.grid(step, rows)
        first = int(np.searchsorted(moments, self.begin))
        after = np.concatenate([[self.begin], moments[first:]])
        allowance = np.concatenate([extra[:, first : first + 1], extra[:, first:]], axis=1)
        allowance = allowance * self.speed ** np.arange(3.0)[:, None, None]
        times = self.ramp + (after - self.begin) / self.speed
        if not self.ramp:
            return times, allowance
        second, third, fourth = extra.max(axis=1) * 8.0 / step**2
        speeds = np.abs(self.motion.at(moments)[1] @ rows.T) + extra[1]
        rate, slope, curve, change = (  # of s by time, and of its derivatives
            self.speed * bound / self.ramp**order for order, bound in enumerate(RISE_BOUNDS[:4])
        )
        fastest = speeds.max(axis=0)
        bounds = [
            second * rate**2 + fastest * slope,
            third * rate**3 + 3.0 * second * rate * slope + fastest * curve,
            fourth * rate**4
            + 6.0 * third * rate**2 * slope
            + second * (3.0 * slope**2 + 4.0 * rate * curve)
            + fastest * change,
        ]
        count = int(np.ceil(self.ramp / _STEP))
        within = np.tile(np.array(bounds)[:, None], (1, count, 1)) * _STEP**2 / 8.0
        # The point at the end of the ramp has an interval on either side.
        allowance[:, 0] = np.maximum(allowance[:, 0], within[:, 0])
        ramp = self.ramp * np.arange(count) / count
        return np.concatenate([ramp, times]), np.concatenate([within, allowance], axis=1)


def resume_motion(
    motion: FourierMotion | PosePath,
    begins: list[float],
    limits: PlanLimits,
    arm: Arm,
    speed: float = 1.0,
) -> PacedMotion:
    """Return the rest of a motion from rest, within limits of acceleration.

    The latest beginning and the shortest ramp that keep them are taken; where none does, it is
    the whole motion.

    Args:
        motion: A motion that keeps the limits.
        begins: Where its speed may be reached, s of the motion, ascending.
        limits: What to keep.
        arm: The arm.
        speed: Rate of the motion.
    """
    of_joints = replace(limits, boxes=())  # places are the motion's
    for begin in reversed(begins):
        for ramp in RAMPS:
            if begin - 0.5 * speed * ramp < 0.0:
                break
            paced = PacedMotion(motion, speed, begin, ramp)
            if worst_violation(paced, of_joints, arm) is None:
                return paced
    return PacedMotion(motion, speed)
