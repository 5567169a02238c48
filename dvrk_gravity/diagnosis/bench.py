"""Where hypotheses compete: filtered residuals in blocks, some of them held out."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arm import N_JOINTS
from dvrk_gravity.diagnosis.findings import FloorFrom
from dvrk_gravity.diagnosis.motion import Motion
from dvrk_gravity.diagnosis.repetition import Repetition, find_repetition
from dvrk_gravity.recording import LowPass

Array = NDArray[np.float64]

BAND = 8.0  # Hz: torques are compared below this
BLOCK = 0.5  # s
BLOCKS = (30, 120)
FOLDS = 5
_OVERSAMPLING = 5.0  # samples kept a second, in bands
_STUCK = 0.05  # part of a stuck sample that the low-pass may leave in a usable one
_GUARD = 1  # samples left out at either end of a block
_NEAR = 0.03  # s, about one kept sample
_TOGETHER = 32  # signals filtered at a time: the filter makes copies
_SHORTEST_PHASE = 6  # samples of a block, where blocks are phases of a short period


@dataclass(frozen=True, eq=False)
class Bench:
    """The reduced problem: T samples of 7 joints, each in a block.

    Every third block is held out: neither fit nor choice sees it. The others make folds for
    cross-validation. Where the motion repeats, a block is one phase of every period: what one
    period shows is no news in the next.

    Attributes:
        motion: Where it comes from.
        band: Low-pass over residual and columns, Hz; ``None`` for static poses.
        every: One of so many samples is kept.
        residual: (T, 7) measured minus modelled torque, N·m.
        block: (T,) number of the block; -1 for samples between blocks.
        count: Number of blocks.
        repetition: How the motion repeats, if it does.
    """

    motion: Motion
    band: float | None
    every: int
    residual: Array
    block: NDArray[np.int64]
    count: int
    repetition: Repetition | None = None

    @classmethod
    def of(cls, motion: Motion) -> Bench:
        """Reduce a motion."""
        rate = motion.rate
        band = None if rate is None else min(BAND, rate / 6.0)
        every = 1 if rate is None or band is None else max(1, int(rate / (_OVERSAMPLING * band)))
        bench = cls(motion, band, every, np.zeros((0, N_JOINTS)), np.zeros(0, dtype=int), 0)
        residual = bench.reduce(motion.residual)
        again = None if rate is None else find_repetition(motion.q, motion.time, motion.parts, rate)
        block, count = _blocks(bench, len(residual), again)
        return cls(motion, band, every, residual, block, count, again)

    def reduce(self, columns: Array) -> Array:
        """Low-pass and thin out (N, …) signals to (T, …)."""
        if self.band is None or self.motion.rate is None:
            return columns
        low = LowPass(self.band, self.motion.rate)
        flat = columns.reshape(len(columns), -1)
        live = np.flatnonzero(np.any(flat != 0.0, axis=0))
        pieces = []
        for part in self.motion.parts:
            if part.stop - part.start <= 3 * low.edge:
                continue
            kept = range(part.stop - part.start)[low.edge : -low.edge : self.every]
            piece = np.zeros((len(kept), flat.shape[1]))
            for first in range(0, len(live), _TOGETHER):
                some = live[first : first + _TOGETHER]
                piece[:, some] = low(flat[part, some])[low.edge : -low.edge : self.every]
            pieces.append(piece)
        reduced = np.concatenate(pieces)
        return reduced.reshape(len(reduced), *columns.shape[1:])

    @cached_property
    def usable(self) -> NDArray[np.bool_]:
        """(T, 7) samples that say something: recorded, and not of a joint that is stuck.

        A joint that friction holds is held by anything between the two levels: no model can
        tell which, and neither can its error.
        """
        stuck = self.reduce(self.motion.stuck.astype(float))
        return (stuck < _STUCK) & self.motion.present

    @cached_property
    def held_out(self) -> NDArray[np.bool_]:
        """(T,) samples that neither fit nor choice sees."""
        return (self.block >= 0) & (self.block % 3 == 2)

    @cached_property
    def held_out_spans(self) -> list[tuple[float, float]]:
        """Beginnings and ends of the pieces of time that are held out, s."""
        edges = np.flatnonzero(np.diff(self.held_out, prepend=False, append=False))
        return [
            (float(self.time[first]), float(self.time[last - 1]))
            for first, last in zip(edges[::2], edges[1::2], strict=True)
        ]

    @cached_property
    def fold(self) -> NDArray[np.int64]:
        """(T,) fold of the samples that choice may see, -1 of the others."""
        rank = self.block - (self.block + 1) // 3  # among the blocks that are not held out
        fold = rank % FOLDS
        fold[(self.block < 0) | self.held_out] = -1
        return fold

    @cached_property
    def time(self) -> Array:
        """(T,) s."""
        return self.reduce_state(self.motion.time[:, None])[:, 0]

    def reduce_state(self, values: Array) -> Array:
        """Thin out (N, …) values to (T, …) without filtering."""
        if self.band is None or self.motion.rate is None:
            return values
        low = LowPass(self.band, self.motion.rate)
        pieces = [
            values[part][low.edge : -low.edge : self.every]
            for part in self.motion.parts
            if part.stop - part.start > 3 * low.edge
        ]
        return np.concatenate(pieces)

    @property
    def copies(self) -> float:
        """How often the motion shows the same, at least 1."""
        return 1.0 if self.repetition is None else self.repetition.copies

    def pairs(self, rows: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return (P,) and (P,) which of some samples show the same, a period apart.

        Args:
            rows: (R,) indices of the samples.
        """
        if self.repetition is None:
            nothing = np.zeros(0, dtype=np.int64)
            return nothing, nothing
        time = self.time[rows]
        order = np.argsort(time)
        later = time + self.repetition.period
        found = order[np.minimum(np.searchsorted(time[order], later), len(time) - 1)]
        near = np.abs(time[found] - later) < _NEAR
        return np.flatnonzero(near), found[near]

    def floor_from(self, floor: Array) -> FloorFrom:
        """Return where a (7,) floor comes from."""
        if not np.isfinite(floor).any():
            return "nothing"
        return "high_frequencies" if self.repetition is None else "repetition"

    def floor(self, density: Array, left: Array | None = None) -> Array:
        """Return (7,) noise, N·m: what does not come back with the motion, where that repeats.

        Args:
            density: (7,) effort noise density as high frequencies show it, N·m/sqrt(Hz); for
                motion that does not repeat.
            left: (T, 7) what the best model so far leaves, N·m; by default what the given one does.
        """
        if self.band is None:
            return np.full(N_JOINTS, np.nan)
        frequency = np.linspace(0.0, 10.0 * self.band, 4000)
        bandwidth = np.mean(1.0 / (1.0 + (frequency / self.band) ** 4) ** 2) * frequency[-1]
        noise = density * np.sqrt(bandwidth)
        if self.repetition is None:
            return noise
        differs = self.repetition.noise(
            self.time, self.residual if left is None else left, self.usable
        )
        return np.where(np.isfinite(differs), differs, noise)


def _blocks(bench: Bench, total: int, again: Repetition | None) -> tuple[NDArray[np.int64], int]:
    rate = bench.motion.rate
    if rate is None:
        count = int(np.clip(total // 6, *BLOCKS))
        return np.arange(total) * count // total, count
    rate /= bench.every
    if again is None:
        count = int(np.clip(total / rate / BLOCK, *BLOCKS))
        block = np.arange(total) * count // total
    else:
        count = int(np.clip(again.period / BLOCK, *BLOCKS))
        count = max(2 * FOLDS, min(count, int(again.period * rate / _SHORTEST_PHASE)))
        block = (again.phase(bench.time) * count).astype(int) % count
    inside = np.ones(total, dtype=bool)
    edges = np.flatnonzero(np.diff(block)) + 1
    for shift in range(-_GUARD, _GUARD):
        inside[edges + shift] = False
    return np.where(inside, block, -1), count
