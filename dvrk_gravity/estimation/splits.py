"""Splits for cross-validation: blocks of time, phases of a repeated motion, slabs of poses.

Consecutive samples share their noise, and a repeated motion shows every fit the same states again.
So held-out samples are contiguous, and of equal phase where motion repeats; never shuffled.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.estimation.repetition import CommonTime, Labels, find_common_time

# Positions form a grid if they have so many levels, fewest and most, so far apart and so wide, in
# parts of the range; else they are cut into slabs. Chosen: the published grid has five levels, a
# fifth of the range apart.
_LEVELS, _APART, _WIDTH, _SLABS = (3, 12), 0.05, 0.1, 5


@dataclass(frozen=True)
class FoldSettings:
    """Folds of time for cross-validation.

    Attributes:
        count: Number of folds. Five to ten are usual (Kohavi 1995); chosen a little higher, so
            that each fit to half a minute lacks no more than 2.5 s; see `make sensitivity`.
        gap: s on either side of a held-out block that no fit sees: ten time constants of the
            5.65 Hz low-pass, 1 / (2 pi 5.65 Hz) = 28 ms.
    """

    count: int = 12
    gap: float = 0.3


@dataclass(frozen=True)
class BlockSettings:
    """Blocks of samples, some of them held out of everything.

    Attributes:
        duration: s. Chosen; see `make sensitivity`.
        fewest: Number of blocks at least. Student's 95 % point for 30 blocks is within 4 % of the
            normal one.
        most: Number of blocks at most. Chosen; see `make sensitivity`.
        poses: Poses in a block. Chosen; see `make sensitivity`.
        guard: Samples left out on either side of an edge. Chosen: one, 25 ms at 40 Hz, is longer
            than the time constant of the 8 Hz low-pass (20 ms). No filter mixes poses: none there.
        phase_samples: Fewest samples in a block that is a phase of a short period. Chosen.
        held_out: One in so many blocks is held out, a third of the data. Chosen.
        folds: Into which the others are dealt for cross-validation (Kohavi 1995: five to ten).
    """

    duration: float = 0.5
    fewest: int = 30
    most: int = 120
    poses: int = 6
    guard: int = 1
    phase_samples: int = 6
    held_out: int = 3
    folds: int = 5


@dataclass(frozen=True, eq=False)
class Folds:
    """Samples that are predicted together by a fit that saw neither them nor their neighbours.

    Attributes:
        tested: (folds, n) samples that are predicted.
        excluded: (folds, n) samples that the fold's fit may not see: those, and a gap.
        periods: Periods of the motions that repeat, s.
        shared: Whether several recordings share some motion.
    """

    tested: Mask
    excluded: Mask
    periods: tuple[float, ...] = ()
    shared: bool = False


@dataclass(frozen=True, eq=False)
class Blocks:
    """Blocks, some of them held out of fit and selection, and folds of the others.

    Attributes:
        label: (n,) number of the block; -1 between blocks.
        count: Number of blocks.
        settings: Of the cut.
    """

    label: Labels
    count: int
    settings: BlockSettings

    @cached_property
    def held_out(self) -> Mask:
        """(n,) mask of the samples held out of fit and selection."""
        spacing = self.settings.held_out
        return (self.label >= 0) & (self.label % spacing == spacing - 1)

    @cached_property
    def fold(self) -> Labels:
        """(n,) fold of the other samples, -1 of those held out."""
        rank = self.label - (self.label + 1) // self.settings.held_out  # among those not held out
        fold = rank % self.settings.folds
        fold[(self.label < 0) | self.held_out] = -1
        return fold


def sequential(total: int, count: int) -> Labels:
    """Return (n,) numbers of ``count`` blocks of samples that follow each other."""
    return np.arange(total, dtype=np.int64) * count // total


def make_folds(
    time: Array, part: Labels, position: Array, rate: float, settings: FoldSettings | None = None,
    clock: Sequence[int] | None = None,
) -> Folds:  # fmt: skip
    """Cut samples into folds: blocks of time, or of phase where the motion repeats.

    Equal states of one motion are held out of all parts together.

    Args:
        time: (n,) s, increasing within each part.
        part: (n,) number of the contiguous part that a sample is in.
        position: (n, m).
        rate: Hz.
        settings: By default :class:`FoldSettings`.
        clock: By number of the part, the recording of its times; default: each its own.
    """
    settings = settings or FoldSettings()
    seen = find_common_time(time, part, position, rate, clock)
    count = settings.count
    label = np.zeros(len(time), dtype=np.int64)
    excluded = np.zeros((count, len(time)), dtype=bool)
    for index, period in enumerate(seen.periods):
        rows = np.flatnonzero(seen.group == index)
        since = seen.time[rows] - seen.time[rows].min()
        length = period or float(since.max()) + 1.0 / rate
        phase = (since % length) / length * count
        label[rows] = np.minimum(phase.astype(int), count - 1)
        gap = settings.gap * count / length
        for fold in range(count):
            distance = np.abs(phase - (fold + 0.5))
            if period:
                distance = np.abs((phase - (fold + 0.5) + count / 2) % count - count / 2)
            excluded[fold, rows] = distance < 0.5 + gap
    periods = tuple(period for period in seen.periods if period)
    recording = part if clock is None else np.asarray(clock)[part]
    pairs = np.unique(np.column_stack([seen.group, recording]), axis=0)
    shared = len(pairs) > len(np.unique(pairs[:, 0]))
    return Folds(label == np.arange(count)[:, None], excluded, periods, shared)


def make_blocks(
    seen: CommonTime, rate: float | None, settings: BlockSettings | None = None
) -> Blocks:
    """Cut samples into blocks of time, or of phase where the motion repeats; or poses.

    Args:
        seen: Times of the samples; of poses, their numbers in order.
        rate: Hz; ``None`` for poses.
        settings: By default :class:`BlockSettings`.
    """
    settings = settings or BlockSettings()
    bounds = (settings.fewest, settings.most)
    turns: list[float] = []
    if rate is None:
        total = len(seen.time)
        count = int(np.clip(total // settings.poses, *bounds))
        coordinate, length = np.arange(total, dtype=float), float(total)
    else:
        coordinate, length, turns = _laid_out(seen, rate)
        count = int(np.clip(length / rate / settings.duration, *bounds))
        if any(seen.periods):
            count = max(2 * settings.folds, min(count, int(length / settings.phase_samples)))
    label = np.minimum((coordinate * count / length).astype(np.int64), count - 1)
    # A guard on either side, in whatever part.
    edges = np.unique([*(np.arange(1, count) * length / count), *turns])
    following = np.searchsorted(edges, coordinate, "right")
    before = coordinate[:, None] - edges[np.maximum(following - 1, 0), None]
    after = np.append(edges, np.inf)[following] - coordinate
    guard = 0 if rate is None else settings.guard
    near = (before[:, 0] >= 0.0) & (before[:, 0] < guard)
    near |= after <= guard
    return Blocks(np.where(near, -1, label), count, settings)


def _laid_out(seen: CommonTime, rate: float) -> tuple[Array, float, list[float]]:
    """Return (n,) coordinates in samples, equal for equal states, groups in a row.

    Also their number, and where periods begin or end.
    """
    coordinate, total = np.zeros(len(seen.time)), 0.0
    turns: list[float] = []
    for index, period in enumerate(seen.periods):
        rows = np.flatnonzero(seen.group == index)
        if not len(rows):  # the filter has left nothing of it
            continue
        if period is None:
            since = np.round((seen.time[rows] - seen.time[rows].min()) * rate)
            there, rank = np.unique(since, return_inverse=True)
            coordinate[rows], length = total + rank, float(len(there))
        else:
            coordinate[rows], length = total + seen.time[rows] % period * rate, period * rate
            turns += [total, total + length]
        total += length
    return coordinate, total, turns


def slabs(position: Array) -> Labels:
    """Return (n,) numbers of the slab in which each of (n,) positions of one joint lies.

    The levels of a grid if the positions form one; else five slabs of as many poses.
    """
    order = np.argsort(position, kind="stable")
    sorted_ = position[order]
    span = float(sorted_[-1] - sorted_[0])
    level = np.concatenate([[0], np.cumsum(np.diff(sorted_) > _APART * span)])
    count = int(level[-1]) + 1
    starts = np.searchsorted(level, np.arange(count))
    ends = np.searchsorted(level, np.arange(count), side="right") - 1
    width = (sorted_[ends] - sorted_[starts]).max()
    fewest, most = _LEVELS
    if not fewest <= count <= most or width > _WIDTH * span:
        level = sequential(len(position), _SLABS)
    number = np.empty(len(position), dtype=np.int64)
    number[order] = level
    return number


def inner_slabs(position: Array, moving: Iterable[int]) -> list[Mask]:
    """Return the (n,) masks of slabs that lie between two others of the same joint.

    A fit to the rest has to interpolate in that joint. It need not extrapolate: models hold
    positions at the edge of their range.

    Args:
        position: (n, m).
        moving: Indices of the joints that were posed differently.
    """
    found = []
    for joint in moving:
        number = slabs(position[:, joint])
        found += [number == k for k in range(1, int(number.max()))]
    return found


def masks(label: Labels) -> list[Mask]:
    """Return the (n,) mask of each label from 0 on."""
    return [label == k for k in range(int(label.max()) + 1)]
