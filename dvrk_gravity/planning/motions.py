"""Smooth motions: from rest to rest within limits, and sums of sines eased in and out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arms import Arm, mtm
from dvrk_gravity.arrays import Array
from dvrk_gravity.planning.fourier import RISE_BOUNDS


@dataclass(frozen=True)
class UsedRangeSettings:
    """How far a simulated arm's motion goes, of which nothing more is known.

    Attributes:
        used: Part of a joint's range. Chosen.
        most: Range that counts at most, rad: a turn, as some joints turn more than they need.
    """

    used: float = 0.7
    most: float = 2.0 * np.pi


def used_range(arm: Arm) -> Array:
    """Return (n,) the part of each joint's range that a simulated arm's motion uses."""
    if mtm.is_mtm(arm):
        return np.array(mtm.defaults.USED_RANGE)
    lowest, highest = arm.range
    settings = UsedRangeSettings()
    part: Array = settings.used * np.minimum(1.0, settings.most / (highest - lowest))
    return part


@dataclass(frozen=True, eq=False)
class Multisine:
    """q(t) = middle + ease(t) sum_k a_k sin(2 pi f_k t + phi_k).

    Attributes:
        middle: (n,) rad.
        amplitude: (k, n) rad.
        frequency: (k, n) Hz.
        phase: (k, n) rad.
        ramp: Time from rest into the motion, and out of it, s.
        duration: When it is at rest again, s.
    """

    middle: Array
    amplitude: Array
    frequency: Array
    phase: Array
    ramp: float = 1.0
    duration: float = np.inf

    @classmethod
    def draw(
        cls,
        arm: Arm,
        seed: int,
        lowest: float = 0.07,
        highest: float = 0.6,
        count: int = 5,
    ) -> Multisine:
        """Draw a motion that stays within the position limits of a simulated arm's joints.

        Args:
            arm: The arm.
            seed: Seed of frequencies, phases, amplitudes and middles.
            lowest: Lowest frequency, Hz.
            highest: Highest frequency, Hz.
            count: Sines a joint.
        """
        random, n = np.random.default_rng(seed), arm.n
        frequency = random.uniform(lowest, highest, (count, n))
        amplitude = random.uniform(0.3, 1.0, (count, n)) / np.sqrt(frequency)
        phase = random.uniform(0.0, 2.0 * np.pi, (count, n))
        lower, upper = arm.range
        used = 0.5 * (upper - lower) * used_range(arm)
        amplitude *= used * random.uniform(0.7, 1.0, n) / amplitude.sum(axis=0)
        slack = 0.5 * (upper - lower) - amplitude.sum(axis=0)
        middle = 0.5 * (lower + upper) + random.uniform(-0.5, 0.5, n) * slack
        return cls(middle, amplitude, frequency, phase)

    def at(self, time: float | Array) -> tuple[Array, Array]:
        """Return position, rad, and velocity, rad/s: (n,), or (N, n) for (N,) times."""
        moment = np.asarray(time, dtype=float)[..., None]
        angle = 2.0 * np.pi * self.frequency * moment[..., None] + self.phase
        way = (self.amplitude * np.sin(angle)).sum(axis=-2)
        speed = (2.0 * np.pi * self.frequency * self.amplitude * np.cos(angle)).sum(axis=-2)
        into, rise = _step(moment / self.ramp)
        out, fall = _step((self.duration - moment) / self.ramp)
        slope = (rise * out - into * fall) / self.ramp
        return self.middle + way * (into * out), way * slope + speed * (into * out)


def _step(s: Array) -> tuple[Array, Array]:
    """Return the smooth step from 0 to 1 between s = 0 and 1, and its slope."""
    s = np.clip(s, 0.0, 1.0)
    return s * s * (3.0 - 2.0 * s), 6.0 * s * (1.0 - s)


class Move:
    """All joints leave and arrive together along 10 s^3 - 15 s^4 + 6 s^5, at rest at either end.

    A :class:`~.pose_path.Straight` at one moment at a time, without its acceleration: a simulator
    asks at every step.

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
        by_velocity = RISE_BOUNDS[1] * way / velocity
        by_acceleration = np.sqrt(RISE_BOUNDS[2] * way / acceleration)
        self.duration = float(max(by_velocity.max(), by_acceleration.max()))

    def at(self, time: float) -> tuple[Array, Array]:
        """Return (n,) position and (n,) velocity."""
        if time >= self._time + self.duration:
            return self._start + self._way, np.zeros_like(self._way)
        s = max(0.0, (time - self._time) / self.duration)
        path = s**3 * (10.0 + s * (6.0 * s - 15.0))
        slope = 30.0 * s**2 * (1.0 - s) ** 2 / self.duration
        return self._start + path * self._way, slope * self._way
