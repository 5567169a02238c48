"""Motion that comes back: after a period, or in another recording; one time for what is the same.

Whoever holds out what one recording shows has to hold out the same states in all others. So parts
are brought to a common time, in which equal states of a repeated motion have equal times.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arrays import Array
from dvrk_gravity.estimation.series import Part, Series, compare, run_around, spread_of

Labels = NDArray[np.int64]


@dataclass(frozen=True)
class RepetitionSettings:
    """When a motion counts as repeated.

    Attributes:
        tolerance: Part of its spread by which a motion that repeats may differ from itself. Chosen;
            see `make sensitivity`.
        shortest: Period from which on one is looked for, s. Chosen; see `make sensitivity`.
        overlap: s of motion that two parts must show alike to be one motion. Chosen.
        moving: Part of its spread that the motion must go there. Chosen: at rest all are alike.
        search: Samples a second that are compared for it. Chosen: some ten for each period of the
            fastest motion of an arm, 4 Hz; between them the shift is interpolated.
        most: Longest parts of which it is asked; others keep their own time. Chosen, for the time
            that comparing each with each takes.
        largest: Samples of a common time that may be compared: a bound on memory.
    """

    tolerance: float = 0.05
    shortest: float = 2.0
    overlap: float = 5.0
    moving: float = 0.1
    search: float = 40.0
    most: int = 40
    largest: int = 400_000


@dataclass(frozen=True, eq=False)
class Repetition:
    """A motion that comes back to itself.

    Attributes:
        period: s.
        copies: How often a phase is seen, in the mean.
    """

    period: float
    copies: float

    def phase(self, time: Array) -> Array:
        """Return (n,) phases in [0, 1) of common times in s."""
        return np.asarray(time % self.period / self.period)


@dataclass(frozen=True, eq=False)
class CommonTime:
    """When samples were taken, such that what shows the same has the same time, or phase.

    Attributes:
        time: (n,) s; comparable within a group.
        group: (n,) numbers from 0 of the groups: parts that show some of the same motion.
        periods: Period of each group, s; ``None`` where it does not repeat.
    """

    time: Array
    group: Labels
    periods: tuple[float | None, ...]

    @classmethod
    def single_clock(cls, time: Array, period: float | None = None) -> CommonTime:
        """Return the time of samples that all are on one clock already."""
        return cls(time, np.zeros(len(time), dtype=np.int64), (period,))

    def at(self, time: Array, group: Array) -> CommonTime:
        """Return the same of other samples, by their common times and groups."""
        return replace(self, time=time, group=group.astype(np.int64))


def find_period(
    position: Array, rate: float, settings: RepetitionSettings | None = None
) -> float | None:
    """Return the period of (n, m) positions, s; ``None`` if they do not repeat.

    The least lag, up to two thirds of the length, at which the motion comes back to itself, every
    channel in units of its own spread.
    """
    return _period(Series.of([(0.0, position)], rate), settings or RepetitionSettings())


def find_common_time(
    time: Array, part: Labels, position: Array, rate: float,
    clock: Sequence[int] | None = None, settings: RepetitionSettings | None = None,
) -> CommonTime:  # fmt: skip
    """Bring parts of motions to a common time.

    Parts of one recording share their clock: where their union repeats, it is kept. Otherwise, and
    from one recording to the next, two parts are one motion if at some shift in time their
    positions coincide wherever both are (by cross-correlation), for some seconds at least in which
    the arm moves. What coincides with nothing is a group by itself.

    Args:
        time: (n,) s, increasing within each part.
        part: (n,) number of the contiguous part that a sample is in, uniformly sampled.
        position: (n, m).
        rate: Hz.
        clock: By number of the part, which clock its times are of; default: each its own.
        settings: When a motion counts as repeated.
    """
    settings = settings or RepetitionSettings()
    numbers = np.unique(part).tolist()
    rows = {number: np.flatnonzero(part == number) for number in numbers}
    given = {number: (float(time[rows[number][0]]), position[rows[number]]) for number in numbers}
    clocks: dict[int, list[int]] = {}
    for number in numbers:
        clocks.setdefault(-1 - number if clock is None else clock[number], []).append(number)
    found = [group for same in clocks.values() for group in _of_clock(same, given, rate, settings)]
    common = np.array(time, dtype=float)
    group_index = np.zeros(len(time), dtype=np.int64)
    joined = _joined(found, given, rate, settings)
    for index, group in enumerate(joined):
        for number, shift in group.shift.items():
            common[rows[number]] += shift
            group_index[rows[number]] = index
    return CommonTime(common, group_index, tuple(group.period for group in joined))


def find_repetition(
    seen: CommonTime, part: Labels, position: Array, rate: float,
    settings: RepetitionSettings | None = None,
) -> tuple[Repetition, Array] | None:  # fmt: skip
    """Return how a motion repeats as a whole, and (n,) its increasing times; ``None`` if not.

    Args:
        seen: Common time of the samples.
        part: (n,) number of the part of each sample, in order.
        position: (n, m).
        rate: Hz.
        settings: When a motion counts as repeated.
    """
    settings = settings or RepetitionSettings()
    period = seen.periods[0]
    if len(seen.periods) > 1 or period is None:
        return None
    pieces = [np.flatnonzero(part == number) for number in np.unique(part)]
    if not _holds(period, [(float(seen.time[p[0]]), position[p]) for p in pieces], rate, settings):
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
    """Parts that show the same motion: what is added to their times, s, by number."""

    shift: dict[int, float] = field(default_factory=dict)
    period: float | None = None

    def parts(self, given: dict[int, Part]) -> list[Part]:
        """Return the parts at common times."""
        return [(given[number][0] + by, given[number][1]) for number, by in self.shift.items()]


def _period(series: Series, settings: RepetitionSettings) -> float | None:
    """Return the least lag at which a series comes back to itself, of a third of it at least."""
    seen = series.seen
    first, last = int(settings.shortest * series.rate), int(len(series.there) * 2 / 3)
    if last <= first:
        return None
    scaled = series.scaled(seen.mean(axis=0), spread_of(seen))
    lags = np.arange(first, last)
    pairs, square, _ = compare(scaled, scaled, lags)
    good = (3.0 * pairs >= len(seen)) & (np.sqrt(square) < settings.tolerance * np.sqrt(2.0))
    if not good.any():
        return None
    run = run_around(good, int(np.argmax(good)))
    best, count = run.start + int(np.argmin(square[run])), 1
    # Twice as many periods tell one twice as well.
    while (again := 2 * int(lags[best]) - first) + 2 < len(lags):
        near = again - 2 + int(np.argmin(square[again - 2 : again + 3]))
        if not good[near]:
            break
        best, count = near, 2 * count
    return float(lags[best] / count / series.rate)


def _of_clock(
    numbers: list[int], given: dict[int, Part], rate: float, settings: RepetitionSettings
) -> list[_Group]:
    """Return the parts of one recording as a group if they repeat together, else each for itself.

    A part that is in another phase than its clock says is a group by itself, too.
    """
    longest = max(numbers, key=lambda number: len(given[number][1]))
    alone = _period(Series.of([given[longest]], rate), settings)
    if len(numbers) == 1:
        return [_Group({longest: 0.0}, alone)]
    parts = [given[number] for number in numbers]
    period = _common_period(parts, alone, rate, settings)
    same = list(numbers)
    if period is None and alone is not None:
        period, same = alone, [longest]
        for number in numbers:
            trial = [given[member] for member in {*same, number}]
            if number not in same and _holds(period, trial, rate, settings):
                same.append(number)
    elif period is None:
        same = []
    groups = [_Group(_closed_up(sorted(same), given, rate, period), period)] if period else []
    for number in numbers:
        if number not in same:
            alone = _period(Series.of([given[number]], rate), settings)
            groups.append(_Group({number: 0.0}, alone))
    return groups


def _closed_up(
    numbers: Iterable[int], given: dict[int, Part], rate: float, period: float
) -> dict[int, float]:
    """Return by how many periods parts of one clock move so that no gap is as long as one."""
    shift: dict[int, float] = {}
    last = None
    for number in numbers:
        start, position = given[number]
        gap = 0.0 if last is None else start - last
        shift[number] = (min(shift.values()) if shift else 0.0) - period * (gap // period)
        last = start + len(position) / rate
    return shift


def _common_period(
    parts: Sequence[Part], known: float | None, rate: float, settings: RepetitionSettings
) -> float | None:
    """Return the period of all of some parts at common times: one that is known, or a better one.

    A period of few samples misses by many after hundreds of times.
    """
    if known is not None and _holds(known, parts, rate, settings):
        return known
    span = max(start + len(position) / rate for start, position in parts)
    if (span - min(start for start, _ in parts)) * rate > settings.largest:
        return None
    period = _period(Series.of(parts, rate), settings)
    if known is None or period is None:
        return period
    return period if _holds(period, parts, rate, settings) else None


def _holds(period: float, parts: Sequence[Part], rate: float, settings: RepetitionSettings) -> bool:
    """Tell whether each of some parts goes where all do at its phases of a period."""
    spread = spread_of(np.concatenate([position for _, position in parts]))
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
        if len(apart) and np.mean(apart * copies / (copies - 1.0)) > settings.tolerance**2:
            return False
    return True


def _joined(
    groups: list[_Group], given: dict[int, Part], rate: float, settings: RepetitionSettings
) -> list[_Group]:
    """Return groups with those as one that show the same motion."""
    least = settings.overlap * rate
    length = [sum(len(given[number][1]) for number in group.shift) for group in groups]
    order = sorted(range(len(groups)), key=lambda index: -length[index])
    asked = {index for index in order[: settings.most] if length[index] >= least}
    found: list[_Group] = []
    for index, group in enumerate(groups):
        # It may be what connects two that are there.
        for other in list(found) if index in asked else ():
            union = _together(other, group, given, rate, settings)
            if union is not None:
                found[found.index(other)] = union
                if group in found:
                    found.remove(group)
                group = union
        if group not in found:
            found.append(group)
    return found


def _together(
    first: _Group, second: _Group, given: dict[int, Part], rate: float,
    settings: RepetitionSettings,
) -> _Group | None:  # fmt: skip
    """Return two groups as one if they show the same motion."""
    shift = _shift(
        Series.of(first.parts(given), rate), Series.of(second.parts(given), rate), settings
    )
    if shift is None:
        return None
    moved = {number: by + shift for number, by in second.shift.items()}
    union = _Group({**first.shift, **moved})
    known = first.period or second.period
    period = _common_period(union.parts(given), known, rate, settings)
    return None if known and period is None else replace(union, period=period)


def _shift(first: Series, second: Series, settings: RepetitionSettings) -> float | None:
    """Return how much later, s, the second is the same motion as the first, if it is.

    Of several such shifts, that of the longest overlap. The difference counts in units of the
    spread within the overlap: two arms at rest in one place are not two of one motion.
    """
    seen = np.concatenate([first.seen, second.seen])
    middle, spread = seen.mean(axis=0), spread_of(seen)
    a, b = (series.scaled(middle, spread).thinned(settings.search) for series in (first, second))
    shifts = np.arange(1 - len(b.there), len(a.there))
    pairs, square, variance = compare(a, b, shifts)
    good = (pairs >= settings.overlap * a.rate) & (variance > settings.moving**2)
    good &= square < 2.0 * settings.tolerance**2 * variance
    if not good.any():
        return None
    run = run_around(good, int(np.argmax(np.where(good, pairs, 0.0))))
    best = run.start + int(np.argmin(square[run]))
    offset = 0.0
    if 0 < best < len(shifts) - 1:
        # The square of a difference is a parabola about its minimum.
        before, here, after = square[best - 1 : best + 2]
        bend = before - 2.0 * here + after
        offset = float(np.clip(0.5 * (before - after) / bend, -0.5, 0.5)) if bend > 0.0 else 0.0
    return float(first.begin + (shifts[best] + offset) / a.rate - second.begin)
