"""Slow poses from both sides: straight moves from rest to rest, with a stand at every pose."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.planning.fourier import RISE, RISE_BOUNDS
from dvrk_gravity.planning.plan_limits import PlanLimits


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
        along = np.abs(ways @ self.limits.rows.T)
        velocity, acceleration = (self.part * rate for rate in self.limits.rates)
        least = np.maximum(
            (RISE_BOUNDS[1] * along / velocity).max(axis=1),
            np.sqrt((RISE_BOUNDS[2] * along / acceleration).max(axis=1)),
        )
        lasts = np.maximum(least, 1e-3)
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
        begin, lasts, ways = self._moves
        times, extra = [], []
        for start, last, way in zip(begin.tolist(), lasts.tolist(), ways, strict=True):
            count = int(np.ceil(last / step - 1e-9))
            times.append(start + last * np.arange(count + 1) / count)
            bounds = [RISE_BOUNDS[order] * np.abs(rows @ way) / last**order for order in (2, 3, 4)]
            extra.append(np.tile(np.array(bounds)[:, None], (1, count + 1, 1)))
        return np.concatenate(times), np.concatenate(extra, axis=1) * step**2 / 8.0
