"""Repeated motion: after a period, or in another recording; one common time for equal states.

Whatever is held out of one recording has to be held out of all others that show the same states. So
parts are brought to a common time, in which equal states of a repeated motion have equal times.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arrays import Array

Labels = NDArray[np.int64]
Part = tuple[float, Array]  # s at which it begins, (n, m) positions

# Part of its spread by which a motion that repeats may differ from itself. Chosen.
TOLERANCE = 0.05
_SHORTEST = 2.0  # s; the shortest period that is looked for. Chosen
_OVERLAP = 5.0  # s of equal motion that make two parts one motion. Chosen
_MOVING = 0.1  # part of its spread that the motion must go there. Chosen: at rest all are equal
# Samples a second that are compared for it. Chosen: some ten for each period of the fastest motion
# of an arm, 4 Hz; between them the shift is interpolated.
_SEARCH = 40.0
# Longest parts that are compared; others keep their own time. Chosen, for the time that comparing
# each with each takes.
_MOST = 40
_LARGEST = 400_000  # samples of a common time that may be compared: a bound on memory


@dataclass(frozen=True, eq=False)
class Repetition:
    """A periodic motion.

    Attributes:
        period: s.
        copies: Mean number of times that a phase is seen.
    """

    period: float
    copies: float

    def phase(self, time: Array) -> Array:
        """Return (n,) phases in [0, 1) of common times in s."""
        return np.asarray(time % self.period / self.period)


@dataclass(frozen=True, eq=False)
class CommonTime:
    """Times of samples in which equal states have equal times, or phases.

    Attributes:
        time: (n,) s; comparable within a group.
        group: (n,) numbers from 0 of the groups: parts that share some motion.
        periods: Period of each group, s; ``None`` where it does not repeat.
    """

    time: Array
    group: Labels
    periods: tuple[float | None, ...]

    @classmethod
    def single_clock(cls, time: Array, period: float | None = None) -> CommonTime:
        """Return the common time of samples on one clock."""
        return cls(time, np.zeros(len(time), dtype=np.int64), (period,))

    def at(self, time: Array, group: Array) -> CommonTime:
        """Return the common time of other samples, from their times and groups."""
        return replace(self, time=time, group=group.astype(np.int64))


def find_common_time(
    time: Array, part: Labels, position: Array, rate: float,
    clock: Sequence[int] | None = None,
) -> CommonTime:  # fmt: skip
    """Bring parts of motions to a common time.

    Parts of one recording share their clock: where their union repeats, it is kept. Otherwise, and
    from one recording to the next, two parts are one motion if at some shift in time their
    positions coincide wherever both are (by cross-correlation), for some seconds at least in which
    the arm moves. Every other part is a group by itself.

    Args:
        time: (n,) s, increasing within each part.
        part: (n,) number of the contiguous part that a sample is in, uniformly sampled.
        position: (n, m).
        rate: Hz.
        clock: By number of the part, the clock of its times; default: each its own.
    """
    numbers = np.unique(part).tolist()
    rows = {number: np.flatnonzero(part == number) for number in numbers}
    given = {number: (float(time[rows[number][0]]), position[rows[number]]) for number in numbers}
    clocks: dict[int, list[int]] = {}
    for number in numbers:
        clocks.setdefault(-1 - number if clock is None else clock[number], []).append(number)
    found = [group for same in clocks.values() for group in _of_clock(same, given, rate)]
    common = np.array(time, dtype=float)
    group_index = np.zeros(len(time), dtype=np.int64)
    joined = _joined(found, given, rate)
    for index, group in enumerate(joined):
        for number, shift in group.shift.items():
            common[rows[number]] += shift
            group_index[rows[number]] = index
    return CommonTime(common, group_index, tuple(group.period for group in joined))


def find_repetition(
    seen: CommonTime, part: Labels, position: Array, rate: float
) -> tuple[Repetition, Array] | None:
    """Return the repetition of a whole motion and its (n,) increasing times, or ``None``.

    Of (n, m) positions at ``rate`` Hz, ``part`` (n,) numbers the part of each sample, in order.
    """
    period = seen.periods[0]
    if len(seen.periods) > 1 or period is None:
        return None
    pieces = [np.flatnonzero(part == number) for number in np.unique(part)]
    if not _holds(period, [(float(seen.time[p[0]]), position[p]) for p in pieces], rate):
        return None
    # Whole periods later it is the same, and no two samples are at one time.
    time, last = np.array(seen.time), -np.inf
    for rows in pieces:
        short = last + 0.5 / rate - time[rows[0]]
        time[rows] += period * max(0.0, np.ceil(short / period))
        last = time[rows[-1]]
    return Repetition(period, max(1.0, len(position) / rate / period)), time


@dataclass(frozen=True, eq=False)
class _Group:
    """Parts of one motion: shifts of their times, s, by number."""

    shift: dict[int, float] = field(default_factory=dict)
    period: float | None = None

    def parts(self, given: dict[int, Part]) -> list[Part]:
        """Return the parts at common times."""
        return [(given[number][0] + by, given[number][1]) for number, by in self.shift.items()]


def _period(series: Series) -> float | None:
    """Return the least lag at which a series repeats, for a third of it at least."""
    seen = series.seen
    first, last = int(_SHORTEST * series.rate), int(len(series.there) * 2 / 3)
    if last <= first:
        return None
    scaled = series.scaled(seen.mean(axis=0), _spread_of(seen))
    lags = np.arange(first, last)
    pairs, square, _ = _compare(scaled, scaled, lags)
    good = (3.0 * pairs >= len(seen)) & (np.sqrt(square) < TOLERANCE * np.sqrt(2.0))
    if not good.any():
        return None
    run = _run_around(good, int(np.argmax(good)))
    best, count = run.start + int(np.argmin(square[run])), 1
    # Over twice as many periods, one is known twice as well.
    while (again := 2 * int(lags[best]) - first) + 2 < len(lags):
        near = again - 2 + int(np.argmin(square[again - 2 : again + 3]))
        if not good[near]:
            break
        best, count = near, 2 * count
    return float(lags[best] / count / series.rate)


def _of_clock(numbers: list[int], given: dict[int, Part], rate: float) -> list[_Group]:
    """Return the parts of one recording as a group if they repeat together, else each by itself.

    A part whose phase contradicts its clock is a group by itself, too.
    """
    longest = max(numbers, key=lambda number: len(given[number][1]))
    alone = _period(Series.of([given[longest]], rate))
    if len(numbers) == 1:
        return [_Group({longest: 0.0}, alone)]
    parts = [given[number] for number in numbers]
    period = _common_period(parts, alone, rate)
    same = list(numbers)
    if period is None and alone is not None:
        period, same = alone, [longest]
        for number in numbers:
            trial = [given[member] for member in {*same, number}]
            if number not in same and _holds(period, trial, rate):
                same.append(number)
    elif period is None:
        same = []
    groups = [_Group(_closed_up(sorted(same), given, rate, period), period)] if period else []
    for number in numbers:
        if number not in same:
            alone = _period(Series.of([given[number]], rate))
            groups.append(_Group({number: 0.0}, alone))
    return groups


def _closed_up(
    numbers: Iterable[int], given: dict[int, Part], rate: float, period: float
) -> dict[int, float]:
    """Return shifts by whole periods that make all gaps of one clock shorter than a period."""
    shift: dict[int, float] = {}
    last = None
    for number in numbers:
        start, position = given[number]
        gap = 0.0 if last is None else start - last
        shift[number] = (min(shift.values()) if shift else 0.0) - period * (gap // period)
        last = start + len(position) / rate
    return shift


def _common_period(parts: Sequence[Part], known: float | None, rate: float) -> float | None:
    """Return the period of some parts at common times: the known one, or a more exact one."""
    if known is not None and _holds(known, parts, rate):
        return known
    span = max(start + len(position) / rate for start, position in parts)
    if (span - min(start for start, _ in parts)) * rate > _LARGEST:
        return None
    period = _period(Series.of(parts, rate))
    if known is None or period is None:
        return period
    return period if _holds(period, parts, rate) else None


def _holds(period: float, parts: Sequence[Part], rate: float) -> bool:
    """Return whether the parts coincide at equal phases of a period."""
    spread = _spread_of(np.concatenate([position for _, position in parts]))
    bins = max(1, round(period * rate))
    phase = [
        np.round((start + np.arange(len(position)) / rate) * bins / period).astype(np.int64) % bins
        for start, position in parts
    ]
    total, count = np.zeros((bins, len(spread))), np.zeros(bins)
    for at, (_, position) in zip(phase, parts, strict=True):
        np.add.at(total, at, position / spread)
        np.add.at(count, at, 1.0)
    for at, (_, position) in zip(phase, parts, strict=True):
        again = count[at] > 1.0
        copies = count[at][again, None]
        apart = (position[again] / spread - total[at][again] / copies) ** 2
        # A sample is part of its mean.
        if len(apart) and np.mean(apart * copies / (copies - 1.0)) > TOLERANCE**2:
            return False
    return True


def _joined(groups: list[_Group], given: dict[int, Part], rate: float) -> list[_Group]:
    """Return groups, those of one motion merged."""
    least = _OVERLAP * rate
    length = [sum(len(given[number][1]) for number in group.shift) for group in groups]
    order = sorted(range(len(groups)), key=lambda index: -length[index])
    asked = {index for index in order[:_MOST] if length[index] >= least}
    found: list[_Group] = []
    for index, group in enumerate(groups):
        # It may connect two that are there.
        for other in list(found) if index in asked else ():
            union = _merged(other, group, given, rate)
            if union is not None:
                found[found.index(other)] = union
                if group in found:
                    found.remove(group)
                group = union
        if group not in found:
            found.append(group)
    return found


def _merged(first: _Group, second: _Group, given: dict[int, Part], rate: float) -> _Group | None:
    """Return two groups as one if they are of one motion."""
    shift = _shift(Series.of(first.parts(given), rate), Series.of(second.parts(given), rate))
    if shift is None:
        return None
    moved = {number: by + shift for number, by in second.shift.items()}
    union = _Group({**first.shift, **moved})
    known = first.period or second.period
    period = _common_period(union.parts(given), known, rate)
    return None if known and period is None else replace(union, period=period)


def _shift(first: Series, second: Series) -> float | None:
    """Return the shift, s, that makes the second series the same motion as the first, if any.

    Of several, that of the longest overlap. Differences count in units of the spread within the
    overlap: two arms at rest in one place are not one motion.
    """
    seen = np.concatenate([first.seen, second.seen])
    middle, spread = seen.mean(axis=0), _spread_of(seen)
    a, b = (series.scaled(middle, spread).thinned(_SEARCH) for series in (first, second))
    shifts = np.arange(1 - len(b.there), len(a.there))
    pairs, square, variance = _compare(a, b, shifts)
    good = (pairs >= _OVERLAP * a.rate) & (variance > _MOVING**2)
    good &= square < 2.0 * TOLERANCE**2 * variance
    if not good.any():
        return None
    run = _run_around(good, int(np.argmax(np.where(good, pairs, 0.0))))
    best = run.start + int(np.argmin(square[run]))
    offset = 0.0
    if 0 < best < len(shifts) - 1:
        # The square of a difference is a parabola about its minimum.
        before, here, after = square[best - 1 : best + 2]
        bend = before - 2.0 * here + after
        offset = float(np.clip(0.5 * (before - after) / bend, -0.5, 0.5)) if bend > 0.0 else 0.0
    return float(first.begin + (shifts[best] + offset) / a.rate - second.begin)


@dataclass(frozen=True, eq=False)
class Series:
    """Positions on a uniform grid, the mean of all that are there.

    Attributes:
        begin: Time of the first, s.
        rate: Hz.
        position: (n, m); zero where there is none.
        there: (n,) 1 where there is some, else 0.
    """

    begin: float
    rate: float
    position: Array
    there: Array

    @classmethod
    def of(cls, parts: Iterable[Part], rate: float) -> Series:
        """Return parts at common times on one grid."""
        parts = list(parts)
        begin = min(start for start, _ in parts)
        first = [round((start - begin) * rate) for start, _ in parts]
        length = max(at + len(position) for at, (_, position) in zip(first, parts, strict=True))
        total, count = np.zeros((length, parts[0][1].shape[1])), np.zeros(length)
        for at, (_, position) in zip(first, parts, strict=True):
            total[at : at + len(position)] += position
            count[at : at + len(position)] += 1.0
        return cls(begin, rate, total / np.maximum(count, 1.0)[:, None], np.minimum(count, 1.0))

    def scaled(self, middle: Array, spread: Array) -> Series:
        """Return positions in units of a spread about a middle."""
        scaled = (self.position - middle) / spread * self.there[:, None]
        return replace(self, position=scaled)

    def thinned(self, rate: float) -> Series:
        """Return the series at about a rate, no less."""
        step = max(1, int(self.rate / rate))
        return Series(self.begin, self.rate / step, self.position[::step], self.there[::step])

    @property
    def seen(self) -> Array:
        """(k, m) positions that there are."""
        return np.asarray(self.position[self.there > 0.0])


def _compare(first: Series, second: Series, shifts: NDArray[np.int64]) -> tuple[Array, ...]:
    """Compare two series with the second so many samples later.

    |x(t) - y(t - shift)|^2 over all shifts at once, through the Fourier transform. Positions must
    be in units of their spread.

    Returns:
        (k,) pairs of samples, (k,) mean square of the difference of a channel, (k,) mean variance
        of a channel of the first within the overlap.
    """
    from scipy.fft import irfft, next_fast_len, rfft

    size = next_fast_len(len(first.there) + len(second.there), real=True)
    there, position = rfft(first.there, size), rfft(first.position, size, axis=0)
    power = rfft((first.position**2).sum(axis=1), size)
    there_2, position_2 = (
        np.conj(rfft(values, size, axis=0)) for values in (second.there, second.position)
    )
    power_2 = np.conj(rfft((second.position**2).sum(axis=1), size))

    def at(spectrum: Array) -> Array:
        return np.asarray(irfft(spectrum, size, axis=0)[shifts])  # from the end, if negative

    pairs = np.round(at(there * there_2))
    count, channels = np.maximum(pairs, 1.0), first.position.shape[1]
    product = (position * position_2).sum(axis=1)
    difference = at(power * there_2 + there * power_2 - 2.0 * product)
    mean = at(position * there_2[:, None]) / count[:, None]
    square = at(power * there_2) / count
    variance = (square - (mean**2).sum(axis=1)) / channels
    return pairs, np.maximum(difference, 0.0) / (count * channels), np.maximum(variance, 0.0)


def _spread_of(positions: Array) -> Array:
    """Return (m,) standard deviations of (n, m) positions, rounding's at least."""
    return np.asarray(np.maximum(positions.std(axis=0), 1e-3))


def _run_around(good: NDArray[np.bool_], inside: int) -> slice:
    """Return the run of true values around one."""
    wrong = np.flatnonzero(~good)
    index = int(np.searchsorted(wrong, inside))
    start = int(wrong[index - 1]) + 1 if index else 0
    return slice(start, int(wrong[index]) if index < len(wrong) else len(good))
