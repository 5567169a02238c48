"""Motions with pauses: a drawn motion whose own time stands still, slows down and goes on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicHermiteSpline, PPoly

from dvrk_gravity.arrays import Array
from testing.lab_motion import Sines

EASE = 1.0  # s, from motion to rest and back
MOVING = 0.2  # of the motion's speed: what is slower counts as rest


@dataclass(frozen=True, eq=False)
class PausedMotion:
    """q(t) = motion(s(t)): the same path at a pace ds/dt that goes smoothly from 1 to 0 and back.

    Attributes:
        motion: Where it goes.
        pauses: (start, end) of each rest, s, in order, at least 2 ``EASE`` apart; the arm slows
            down before a rest and goes on after it.
    """

    motion: Sines
    pauses: tuple[tuple[float, float], ...] = ()

    def at(self, time: Array) -> tuple[Array, Array, Array]:
        """Return (T, n) positions, velocities and accelerations at (T,) times, s."""
        pace = self._pace(time)[:, None]
        q, slope, bend = self.motion.at(self._own_time(time))
        return q, pace * slope, pace**2 * bend + self._change(time)[:, None] * slope

    def moved(self, start: float, end: float) -> float:
        """Return for how long it moves between two times, s."""
        grid = np.arange(start, end, 0.01)
        return 0.01 * float(np.count_nonzero(self._pace(grid) > MOVING))

    @cached_property
    def _pace(self) -> PPoly:
        knots, paces = [-1e6], [1.0]
        for start, end in self.pauses:
            knots += [start - EASE, start, end, end + EASE]
            paces += [1.0, 0.0, 0.0, 1.0]
        knots, paces = [*knots, 1e6], [*paces, 1.0]
        return CubicHermiteSpline(knots, paces, np.zeros(len(knots)))

    @cached_property
    def _change(self) -> PPoly:
        return self._pace.derivative()

    @cached_property
    def _own_time(self) -> PPoly:
        whole = self._pace.antiderivative()
        whole.c[-1] -= whole(0.0)
        return whole


def back_and_forth(motion: Sines) -> Sines:
    """Return one sine a joint of a motion, the one that is fastest: reversals, and nothing else.

    Joints that a motor drives together keep the sines that belong together.
    """
    count = len(motion.frequency)
    half = count // 2
    # Where a motor drives a sum, the second half of the rows is what its joint goes against it.
    paired = bool((motion.amplitude == 0.0).any())
    speed = (motion.amplitude * motion.frequency).sum(axis=1)
    row = int(np.argmax(speed[:half] if paired else speed))
    kept = np.zeros(count, dtype=bool)
    kept[[row, row + half] if paired else [row]] = True
    return replace(motion, amplitude=np.where(kept[:, None], motion.amplitude, 0.0))


def pauses_within(
    random: np.random.Generator, duration: float, rest: tuple[float, float],
    between: tuple[float, float], start: float = 0.0,
) -> tuple[tuple[float, float], ...]:  # fmt: skip
    """Draw rests.

    Args:
        random: Where they come from.
        duration: Until when, s.
        rest: Shortest and longest rest, s.
        between: Shortest and longest motion between two, s, more than 2 ``EASE``.
        start: From when on, s.
    """
    pauses: list[tuple[float, float]] = []
    time = start
    while True:
        begin = time + float(random.uniform(*between))
        end = begin + float(random.uniform(*rest))
        if begin > duration:
            return tuple(pauses)
        pauses.append((begin, end))
        time = end


def rests(pauses: Sequence[tuple[float, float]], time: float) -> bool:
    """Whether some time, s, is within a rest."""
    return any(start <= time < end for start, end in pauses)
