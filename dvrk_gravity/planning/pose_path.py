"""Slow poses from both sides: straight moves from rest to rest, with a stand at every pose."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.planning.fourier import RISE, RISE_BOUNDS
from dvrk_gravity.planning.limits import PlanLimits

SHORTEST = 1e-3  # s, of a move, however short


def least_times(ways: Array, limits: PlanLimits, part: float) -> Array:
    """Return (k,) s that straight moves take with a part of the greatest speeds.

    Args:
        ways: (k, n) of the joints, each along 10 s^3 - 15 s^4 + 6 s^5, rad or m.
        limits: Speeds and accelerations of joints and combinations.
        part: Of both.
    """
    along = np.abs(ways @ limits.rows.T)
    velocity, acceleration = (part * rate for rate in limits.rates)
    by_velocity = (RISE_BOUNDS[1] * along / velocity).max(axis=1)
    by_acceleration = np.sqrt((RISE_BOUNDS[2] * along / acceleration).max(axis=1))
    return np.maximum(np.maximum(by_velocity, by_acceleration), SHORTEST)


@dataclass(frozen=True, eq=False)
class Straight:
    """A straight move in joint space from rest to rest, along 10 s^3 - 15 s^4 + 6 s^5.

    Where both ends are within limits that are linear in the joints, all of it is; from outside of
    one it only goes inwards.

    Attributes:
        start: (n,) rad or m.
        goal: (n,) rad or m.
        duration: s.
    """

    start: Array
    goal: Array
    duration: float

    @classmethod
    def within(cls, start: Array, goal: Array, limits: PlanLimits, part: float) -> Straight:
        """Return the move that takes a part of the greatest speeds and accelerations."""
        return cls(start, goal, float(least_times((goal - start)[None], limits, part)[0]))

    def at(self, time: float | Array) -> tuple[Array, Array, Array]:
        """Return position, velocity and acceleration, (n,) each, or (N, n) for (N,) times, s."""
        s = np.clip(np.asarray(time, dtype=float) / self.duration, 0.0, 1.0)[..., None]
        way = self.goal - self.start
        position, velocity, acceleration = (
            way * (RISE.deriv(order)(s) if order else RISE(s)) / self.duration**order
            for order in range(3)
        )
        return self.start + position, velocity, acceleration

    def grid(self, step: float, rows: Array) -> tuple[Array, Array]:
        """Return times and how much may be exceeded beside each: :meth:`FourierMotion.grid`."""
        count = int(np.ceil(self.duration / step - 1e-9))
        along = np.abs(rows @ (self.goal - self.start))
        bounds = [RISE_BOUNDS[order] * along / self.duration**order for order in (2, 3, 4)]
        extra = np.tile(np.array(bounds)[:, None], (1, count + 1, 1))
        return self.duration * np.arange(count + 1) / count, extra * step**2 / 8.0


@dataclass(frozen=True, eq=False)
class PosePath:
    """Every pose is reached from below in all joints, stood at, left upwards, and reached again.

    A move is straight in joint space, along 10 s^3 - 15 s^4 + 6 s^5. So between two poses joints
    stay within any limits that are linear in them.

    Attributes:
        poses: (k, n) rad or m, in their order.
        approach: (n,) way that every joint goes to a pose in the direction of approach.
        stand: At a pose, from each side, s.
        part: Part of the greatest speeds and accelerations that moves use.
        limits: Of those.
    """

    poses: Array
    approach: Array
    stand: float
    part: float
    limits: PlanLimits

    @cached_property
    def _corners(self) -> Array:
        """(4 k + 1, n) ends of the moves, of which each second one is a pose."""
        below, above = self.poses - self.approach, self.poses + self.approach
        return np.vstack(
            [
                self.poses[:1],
                np.stack([below, self.poses, above, self.poses], 1).reshape(-1, self.n),
            ]
        )

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.poses.shape[1]

    @cached_property
    def _moves(self) -> tuple[Array, Array, Array]:
        """(4 k,) when moves begin and how long they last, s, and (4 k, n) their ways."""
        ways = np.diff(self._corners, axis=0)
        lasts = least_times(ways, self.limits, self.part)
        whole = lasts + np.where(np.arange(len(lasts)) % 2 == 1, self.stand, 0.0)
        return np.concatenate([[0.0], np.cumsum(whole)[:-1]]), lasts, ways

    @property
    def duration(self) -> float:
        """When the last stand ends, s."""
        begin, lasts, _ = self._moves
        return float(begin[-1] + lasts[-1] + self.stand)

    @property
    def stands(self) -> Array:
        """(2 k, 4) when each stand begins and ends, s, its pose's index, and its direction.

        The direction is +1 where the joints came up to the pose, and -1 where they came down.
        """
        begin, lasts, _ = self._moves
        arrival = (begin + lasts)[1::2]
        count = np.arange(len(arrival))
        return np.stack(
            [arrival, arrival + self.stand, count // 2, np.where(count % 2, -1.0, 1.0)], axis=1
        )

    def at(self, time: float | Array) -> tuple[Array, Array, Array]:
        """Return position, velocity and acceleration, (n,) each, or (N, n) for (N,) times."""
        moment = np.clip(np.atleast_1d(np.asarray(time, dtype=float)), 0.0, self.duration)
        begin, lasts, ways = self._moves
        which = np.searchsorted(begin, moment, side="right") - 1
        s = np.minimum((moment - begin[which]) / lasts[which], 1.0)
        found = [
            RISE.deriv(order)(s)[:, None] * ways[which] / lasts[which][:, None] ** order
            if order
            else self._corners[which] + RISE(s)[:, None] * ways[which]
            for order in range(3)
        ]
        q, qd, qdd = found
        return (q, qd, qdd) if np.ndim(time) else (q[0], qd[0], qdd[0])

    def grid(self, step: float, rows: Array) -> tuple[Array, Array]:
        """Return times at most ``step`` apart, and how much may be exceeded beside each.

        See :meth:`FourierMotion.grid`.
        """
        begin, lasts, _ = self._moves
        ends = zip(self._corners, self._corners[1:], lasts.tolist(), strict=False)
        found = [Straight(*end).grid(step, rows) for end in ends]
        times = [start + time for start, (time, _) in zip(begin.tolist(), found, strict=True)]
        return np.concatenate(times), np.concatenate([extra for _, extra in found], axis=1)
