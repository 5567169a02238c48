"""What is held out together: blocks of time, phases of a motion that repeats, slabs of poses.

Samples that follow each other share their noise, and a motion that repeats shows every fit the same
states again. So what is held out is contiguous, and of equal phase where motion repeats; samples
are never shuffled.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.estimation import Array

Labels = NDArray[np.int64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class RepetitionSettings:
    """When a motion counts as repeated.

    Attributes:
        tolerance: Part of its spread by which a motion that repeats may differ from itself. Chosen;
            see `make sensitivity`.
        shortest: Period from which on one is looked for, s. Chosen; see `make sensitivity`.
    """

    tolerance: float = 0.05
    shortest: float = 2.0


@dataclass(frozen=True)
class FoldSettings:
    """How time is cut for cross-validation.

    Attributes:
        count: Number of folds. Five to ten are usual (Kohavi 1995); chosen a little higher, so
            that each fit to half a minute lacks no more than 2.5 s; see `make sensitivity`.
        gap: s on either side of a held-out block that no fit sees: ten time constants of the
            5.65 Hz low-pass, 1 / (2 pi 5.65 Hz) = 28 ms.
        repetition: When a motion counts as repeated.
    """

    count: int = 12
    gap: float = 0.3
    repetition: RepetitionSettings = field(default_factory=RepetitionSettings)


@dataclass(frozen=True)
class BlockSettings:
    """How samples are cut into blocks, some of them held out of everything.

    Attributes:
        duration: s. Chosen; see `make sensitivity`.
        fewest: Number of blocks at least. Student's 95 % point for 30 blocks is within 4 % of the
            normal one.
        most: Number of blocks at most. Chosen; see `make sensitivity`.
        poses: Poses in a block. Chosen; see `make sensitivity`.
        guard: Samples left out on either side of an edge. Chosen: one, 25 ms at 40 Hz, is longer
            than the time constant of the 8 Hz low-pass (20 ms).
        phase_samples: Fewest samples in a block that is a phase of a short period. Chosen.
        held_out: Every so-maniest block is held out, a third of the data. Chosen.
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


@dataclass(frozen=True)
class GridSettings:
    """When positions form a grid.

    All are chosen: the published grid has five levels, a fifth of the range apart.

    Attributes:
        levels: Fewest and most positions that make one.
        apart: Part of the range that lies between two levels at least.
        width: Part of the range that a level may be wide.
        slabs: Number of slabs of positions that form none.
    """

    levels: tuple[int, int] = (3, 12)
    apart: float = 0.05
    width: float = 0.1
    slabs: int = 5


@dataclass(frozen=True, eq=False)
class Folds:
    """Which samples are predicted together by a fit that saw neither them nor their neighbours.

    Attributes:
        tested: (folds, n) samples that are predicted.
        excluded: (folds, n) samples that the fold's fit may not see: those, and a gap.
        periods: Periods of the motions that repeat, s.
    """

    tested: Mask
    excluded: Mask
    periods: tuple[float, ...] = ()

    @classmethod
    def of_masks(cls, masks: Sequence[Mask]) -> Folds:
        """Return folds without a gap, from (n,) masks that may overlap."""
        tested = np.array(masks, dtype=bool)
        return cls(tested, tested)

    @cached_property
    def label(self) -> Labels:
        """(n,) number of the fold that a sample is tested in, the first one if several."""
        return np.argmax(self.tested, axis=0)


@dataclass(frozen=True, eq=False)
class Blocks:
    """Blocks, some of which neither fit nor choice sees, and folds of the others.

    Attributes:
        label: (n,) number of the block; -1 between blocks.
        count: Number of blocks.
        settings: How they were cut.
    """

    label: Labels
    count: int
    settings: BlockSettings

    @cached_property
    def held_out(self) -> Mask:
        """(n,) samples that neither fit nor choice sees."""
        every = self.settings.held_out
        return (self.label >= 0) & (self.label % every == every - 1)

    @cached_property
    def fold(self) -> Labels:
        """(n,) fold of the samples that choice may see, -1 of the others."""
        rank = self.label - (self.label + 1) // self.settings.held_out  # among those not held out
        fold = rank % self.settings.folds
        fold[(self.label < 0) | self.held_out] = -1
        return fold


@dataclass(frozen=True)
class Repetition:
    """A motion that comes back to itself.

    Attributes:
        period: s.
        copies: How often a phase is seen, in the mean.
    """

    period: float
    copies: float

    def phase(self, time: Array) -> Array:
        """Return (n,) phases in [0, 1) of times in s."""
        return np.asarray(time % self.period / self.period)


def sequential(total: int, count: int) -> Labels:
    """Return (n,) numbers of ``count`` blocks of samples that follow each other."""
    return np.arange(total, dtype=np.int64) * count // total


def make_folds(
    time: Array, part: Labels, position: Array, rate: float, settings: FoldSettings | None = None
) -> Folds:
    """Cut samples into folds: blocks of time, or of phase where the motion repeats.

    Args:
        time: (n,) s, increasing within each part.
        part: (n,) number of the recording that a sample came from.
        position: (n, m) what repeats or does not.
        rate: Hz.
        settings: How; default: :class:`FoldSettings`.
    """
    settings = settings or FoldSettings()
    count = settings.count
    label = np.zeros(len(time), dtype=np.int64)
    excluded = np.zeros((count, len(time)), dtype=bool)
    periods = []
    for index in np.unique(part):
        rows = np.flatnonzero(part == index)
        since = time[rows] - time[rows[0]]
        period = find_period(position[rows], rate, settings.repetition)
        length = period or float(since[-1]) + 1.0 / rate
        if period:
            periods.append(period)
        phase = (since % length) / length * count
        label[rows] = np.minimum(phase.astype(int), count - 1)
        gap = settings.gap * count / length
        for fold in range(count):
            distance = np.abs(phase - (fold + 0.5))
            if period:
                distance = np.abs((phase - (fold + 0.5) + count / 2) % count - count / 2)
            excluded[fold, rows] = distance < 0.5 + gap
    return Folds(label == np.arange(count)[:, None], excluded, tuple(periods))


def find_period(
    position: Array, rate: float, settings: RepetitionSettings | None = None
) -> float | None:
    """Return the period of (n, m) positions, s; ``None`` if they do not repeat.

    The least lag, up to two thirds of the length, at which the motion comes back to itself, every
    channel in units of its own spread.
    """
    settings = settings or RepetitionSettings()
    spread = np.maximum(position.std(axis=0), 1e-3)
    scaled = (position - position.mean(axis=0)) / spread
    first, last = int(settings.shortest * rate), int(len(position) * 2 / 3)
    if last <= first:
        return None
    # |x(t) - x(t + lag)|^2 over all lags at once, through the autocorrelation.
    size = 2 * len(scaled)
    spectrum = np.fft.rfft(scaled, size, axis=0)
    product = np.fft.irfft(np.abs(spectrum) ** 2, size, axis=0)[: len(scaled)].sum(axis=1)
    power = np.cumsum(np.sum(scaled**2, axis=1))
    lags = np.arange(first, last)
    pairs = len(scaled) - lags
    both = power[pairs - 1] + power[-1] - power[lags - 1]
    difference = np.sqrt(np.maximum(both - 2.0 * product[lags], 0.0) / (pairs * scaled.shape[1]))
    good = difference < settings.tolerance * np.sqrt(2.0)
    if not good.any():
        return None
    start = int(np.argmax(good))
    stop = start + int(np.argmin(good[start:])) if not good[start:].all() else len(good)
    best = start + int(np.argmin(difference[start:stop]))
    return float(lags[best] / rate)


def find_repetition(
    position: Array, time: Array, parts: Sequence[slice], rate: float,
    settings: RepetitionSettings | None = None,
) -> Repetition | None:  # fmt: skip
    """Return how a motion repeats; ``None`` if it does not.

    Parts share their phase, as those of one recording with gaps do; recordings that begin at
    different phases of one motion do not repeat in this sense.

    Args:
        position: (n, m).
        time: (n,) s.
        parts: Contiguous parts, uniformly sampled.
        rate: Hz.
        settings: When a motion counts as repeated.
    """
    from scipy.interpolate import CubicSpline

    settings = settings or RepetitionSettings()
    longest = max(parts, key=lambda part: part.stop - part.start)
    period = find_period(position[longest], rate, settings)
    if period is None:
        return None
    start = time[longest][0]
    first = CubicSpline(time[longest], position[longest])(start + (time - start) % period)
    apart = (position - first) / np.maximum(position.std(axis=0), 1e-3)
    if np.sqrt(np.mean(apart**2)) > np.sqrt(2.0) * settings.tolerance:
        return None
    return Repetition(period, max(1.0, len(position) / rate / period))


def make_blocks(
    time: Array, rate: float | None, repetition: Repetition | None = None,
    settings: BlockSettings | None = None,
) -> Blocks:  # fmt: skip
    """Cut samples into blocks of time, or of phase where the motion repeats; or poses.

    Args:
        time: (n,) s, of the samples in their order.
        rate: Hz; ``None`` for poses, that follow each other without time.
        repetition: How the motion repeats, if it does.
        settings: How; default: :class:`BlockSettings`.
    """
    settings = settings or BlockSettings()
    total, bounds = len(time), (settings.fewest, settings.most)
    if rate is None:
        count = int(np.clip(total // settings.poses, *bounds))
        return Blocks(sequential(total, count), count, settings)
    if repetition is None:
        count = int(np.clip(total / rate / settings.duration, *bounds))
        label = sequential(total, count)
    else:
        count = int(np.clip(repetition.period / settings.duration, *bounds))
        fitting = int(repetition.period * rate / settings.phase_samples)
        count = max(2 * settings.folds, min(count, fitting))
        label = (repetition.phase(time) * count).astype(np.int64) % count
    inside = np.ones(total, dtype=bool)
    edges = np.flatnonzero(np.diff(label)) + 1
    for shift in range(-settings.guard, settings.guard):
        inside[edges + shift] = False
    return Blocks(np.where(inside, label, -1), count, settings)


def slabs(position: Array, settings: GridSettings | None = None) -> Labels:
    """Return (n,) numbers of the slab in which each of (n,) positions of one joint lies.

    The levels of a grid, where the positions form one; else as many poses in each of five.
    """
    settings = settings or GridSettings()
    order = np.argsort(position, kind="stable")
    sorted_ = position[order]
    span = float(sorted_[-1] - sorted_[0])
    level = np.concatenate([[0], np.cumsum(np.diff(sorted_) > settings.apart * span)])
    count = int(level[-1]) + 1
    starts = np.searchsorted(level, np.arange(count))
    ends = np.searchsorted(level, np.arange(count), side="right") - 1
    width = (sorted_[ends] - sorted_[starts]).max()
    fewest, most = settings.levels
    if not fewest <= count <= most or width > settings.width * span:
        level = sequential(len(position), settings.slabs)
    number = np.empty(len(position), dtype=np.int64)
    number[order] = level
    return number


def inner_slabs(position: Array, moving: Iterable[int]) -> list[Mask]:
    """Return the (n,) masks of slabs that lie between two others of the same joint.

    A fit to the rest has to say what happens at positions of that joint which it never saw,
    between some that it did. Past the outermost ones no fit is asked for anything: positions
    are held there.

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
