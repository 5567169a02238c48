"""Measured samples, as they come, in rows of even times: what a monitor works on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from dvrk_gravity.arrays import Array


@dataclass(frozen=True, eq=False)
class Rows:
    """K means of measured samples, an even time apart.

    Attributes:
        time: (K,) s, of each row's middle.
        q: (K, n) positions, rad or m.
        qd: (K, n) velocities, rad/s or m/s.
        effort: (K, n) measured torques, N·m or N.
    """

    time: Array
    q: Array
    qd: Array
    effort: Array

    def __len__(self) -> int:
        """Return the number of rows K."""
        return len(self.time)

    @property
    def arrays(self) -> tuple[Array, ...]:
        """All of them, in the order of the attributes."""
        return tuple(getattr(self, each.name) for each in fields(self))

    def at(self, which: slice) -> Rows:
        """Return some of the rows."""
        return Rows(*(values[which] for values in self.arrays))

    def parts(self, longest: float) -> tuple[slice, ...]:
        """Return the rows between which at most so many seconds pass, part by part."""
        gaps = (np.flatnonzero(np.diff(self.time) > longest) + 1).tolist()
        return tuple(map(slice, [0, *gaps], [*gaps, len(self)]))

    @classmethod
    def of(cls, rate: float, time: Array, q: Array, qd: Array, effort: Array) -> Rows:
        """Return the rows that samples make, but for the last, which may not be complete.

        Args:
            rate: Rows a second.
            time: (N,) s.
            q: (N, n) positions, as qd and effort.
            qd: Velocities.
            effort: Torques.
        """
        maker = RowMaker(rate)
        samples = zip(time.tolist(), q, qd, effort, strict=True)
        made = (maker.add(*sample) for sample in samples)
        return cls.joined([cls.empty(q.shape[1]), *(row for row in made if row is not None)])

    @classmethod
    def joined(cls, each: Sequence[Rows]) -> Rows:
        """Return some rows, one after the other."""
        names = [field.name for field in fields(cls)]
        return cls(*(np.concatenate([getattr(rows, name) for rows in each]) for name in names))

    @classmethod
    def empty(cls, n: int) -> Rows:
        """Return no rows of n joints."""
        empty = np.zeros((0, n))
        return cls(np.zeros(0), empty, empty, empty)


class RowMaker:
    """Averages samples over the intervals of a clock.

    A sample belongs to the interval of its stamp; an interval without samples leaves a gap. Without
    measured velocities, they are the slopes between the rows around each, which then comes a row
    later: a difference to the row before alone would be half a row late.
    """

    def __init__(self, rate: float) -> None:
        """Make rows at a rate, Hz."""
        self.rate = rate
        self._number = 0  # of the row that is not complete
        self._samples: list[Array] = []  # (3, n) positions, velocities, efforts of it
        self._waiting: Rows | None = None  # for the row after it, whose velocities it lacks
        self._before: Rows | None = None  # the row before that

    def add(self, time: float, q: Array, qd: Array | None, effort: Array) -> Rows | None:
        """Add a sample at a time in s, with (n,) values; return the row that is ready then, if any.

        A sample whose row is complete already, since stamps went backwards, is ignored.
        """
        number = math.floor(time * self.rate)
        if self._samples and number < self._number:
            return None
        sample = np.array((q, np.full(len(q), np.nan) if qd is None else qd, effort))
        if self._samples and number == self._number:
            self._samples.append(sample)
            return None
        row = self._row() if self._samples else None
        self._number, self._samples = number, [sample]
        return row

    def _row(self) -> Rows | None:
        q, qd, effort = np.mean(self._samples, axis=0)
        time = (self._number + 0.5) / self.rate
        row = Rows(np.array([time]), q[None], qd[None], effort[None])
        if not np.isnan(qd).any():
            self._waiting = self._before = None
            return row
        waiting, before = self._waiting, self._before
        self._before, self._waiting = waiting, row
        if waiting is None:
            return None
        first = waiting if before is None else before
        slope = (row.q - first.q) / (row.time - first.time)
        return replace(waiting, qd=slope)
