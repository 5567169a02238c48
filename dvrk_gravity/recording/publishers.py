"""Several publishers of one topic: the messages of one are kept, those of the others left out.

A driver or a ``joint_state_publisher`` is often started beside a controller, and publishes the same
joints: efforts of zero, positions a cycle old, stamps of another clock. A message counts as another
publisher's by such a sign, if it lies among others without it, and if the times of these have no
hole there: a single publisher's have.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.recording.notes import note
from dvrk_gravity.recording.quantization import quantum
from dvrk_gravity.recording.samples import LARGEST
from dvrk_gravity.recording.table import RowTable

# Messages in a part of a file from which on another publisher is looked for. Chosen: fewer do no
# harm, and may be a fault of a moment.
_LEAST = 3
# Runs of another publisher's messages, as a part of the rarer ones' number. Chosen: of interleaved
# ones each is a run; those of an arm without power are one.
_RUNS = 0.3
# Median interval of the other messages around them, in their typical ones, beyond which they have a
# hole there. Chosen between one interval and two.
_HOLE = 1.5
# Part of the typical effort or velocity, and steps of it, that both neighbours of a zero must have.
# Chosen: more than at a change of sign.
_CLEAR, _STEPS = 0.1, 3.0
_OLDEST = 25  # messages ago, of which a position may be a copy. Chosen: 20 ms at 1 kHz
_RESTS = 1e-6  # rad in a message, below which an arm is at rest. Chosen: less than any step
# By how many intervals, and widths of their own, the delays of two clocks differ. Chosen: more than
# those of messages that are sent or received in batches.
_CLOCK, _WIDTHS = 5.0, 10.0
_SEQUENCE = 50  # messages from which on regular sequences are looked for. Chosen
_OFF = 0.2  # of an interval, by which a regular one may be off. Chosen: jitter
_ALONE = 0.97  # part of the intervals that are regular in a single sequence. Chosen likewise
_MOSTLY = 0.8  # part of the intervals that are regular. Chosen: others are of lost messages
# Parts of the times that the best interval leads to another one, from which on a shorter one may be
# the period. Chosen: for jitter, and of sequences of which one is half as fast.
_AS_GOOD = (0.9, 0.6)
_FOLLOW = 0.3  # of an error, by which the next message is expected later. Chosen
# Standard deviation of the phase of two sequences in step (of any phase: .29), phase of messages
# that come in pairs, and intervals by which one of two in step is older. Chosen: half of the latter
# is what wrong stamps of one publisher make of every second message.
_IN_STEP, _TOGETHER, _OLD = 0.15, 0.02, 0.5
# Difference of two sequences in step, in the spread of a joint's readings, and in what
# every second message of one is off the others, from which on they are of two publishers; and
# number of messages of one in the other's, from which on it is the faster. Chosen: ripple and noise
# are less, and with less their mean is off by a twentieth.
_DIFFERS, _BEYOND_NOISE, _FASTER = 0.1, 3.0, 1.5
_USUAL = 0.9  # part of the readings by which they are compared. Chosen: others are spikes

_Sign = Callable[[RowTable], Mask | None]


def one_publisher(tables: Iterable[RowTable], source: str) -> Iterator[RowTable]:
    """Yield the rows of consecutive parts of a file that are of one publisher, with notes.

    Raises:
        RecordingError: Two publishers in step with other readings each, neither of which is older
            or slower: which one is right is not known.
    """
    found: dict[str, bool] = {}  # by sign: whether messages with it are left out
    of_times: _Sign = partial(_other_period, source)
    for table in tables:
        for text, sign in (*_SIGNS, ("another sequence of times", of_times)):
            if table.stamps is not None and len(table):
                table = _without(table, text, sign, found)
        yield replace(table, received=None, other_layout=None)


def _without(table: RowTable, text: str, sign: _Sign, found: dict[str, bool]) -> RowTable:
    """Return a table without the rows of another publisher that a sign gives away."""
    marked = sign(table)
    if marked is None or not marked.any() or marked.all():
        return table
    if text not in found and min(int(marked.sum()), int((~marked).sum())) < _LEAST:
        return table
    leave_out = found[text] if text in found else sign not in _OF_EITHER or _stale(table, marked)
    others = marked if leave_out else ~marked
    assert table.stamps is not None
    if text not in found and not _interleaved(table.stamps, others):
        return table
    found[text] = leave_out
    what = f"of a second publisher of the same joints ({text})"
    left_out = note("second_publisher", what, left_out=int(others.sum()))
    return replace(table.rows(~others), notes=(*table.notes, left_out))


def _interleaved(stamps: NDArray[np.int64], others: Mask) -> bool:
    """Return whether some messages lie among the rest, whose times have no holes there."""
    rarer = min(int(others.sum()), int((~others).sum()))
    runs = int(np.count_nonzero(np.diff(others)) + 1) // 2
    if runs < max(_LEAST, _RUNS * rarer):
        return False
    own = np.sort(stamps[~others])
    intervals = np.diff(own)
    after = np.searchsorted(own, stamps[others])
    inside = after[(after > 0) & (after < len(own))]  # the rest is of a clock that is off
    if not len(inside):
        return True
    return bool(np.median(intervals[inside - 1]) < _HOLE * np.median(intervals))


def _stale(table: RowTable, marked: Mask) -> bool:
    """Return whether marked messages are older than the rest, or fewer where neither are older."""
    late = _late(table, marked)
    if abs(late) > _CLEAR:
        return late > 0.0
    return int(marked.sum()) < int((~marked).sum())


def _late(table: RowTable, marked: Mask) -> float:
    """Return how old marked messages are beside the rest, in intervals of these.

    Their positions are compared with those of the rest at the time when they were received: what
    follows the velocity is a delay.
    """
    assert table.stamps is not None
    received = table.stamps if table.received is None else table.received
    time = (received - received[0]) / 1e9
    order = np.argsort(time[~marked], kind="stable")
    rest, position = time[~marked][order], table.values["position"][~marked][order]
    at, given = time[marked], table.values["position"][marked]
    ahead = power = 0.0
    readings = (np.abs(table.values["position"]) < LARGEST).all(axis=0)
    position, given = position[:, readings], given[:, readings]
    for own, other in zip(position.T, given.T, strict=True):
        way = np.interp(at, rest, np.gradient(own))
        ahead += float(way @ (other - np.interp(at, rest, own)))
        power += float(way @ way)
    return -ahead / power if power > 0.0 else 0.0


def _zeros(table: RowTable, quantity: str, *, at_rest: bool) -> Mask | None:
    """Return rows whose quantity is zero at all joints, if those around them are clearly not."""
    values = table.values.get(quantity)
    if values is None:
        return None
    zero: Mask = np.all(values == 0.0, axis=1)
    rows = np.flatnonzero(~zero)
    if not zero.any() or not len(rows):
        return None
    size = np.abs(np.nan_to_num(values[rows], posinf=0.0, neginf=0.0))
    after = np.searchsorted(rows, np.flatnonzero(zero))
    least = np.minimum(size[after.clip(max=len(rows) - 1)], size[(after - 1).clip(min=0)])
    steps = np.array([quantum(column) for column in values.T])
    clear = (least > np.maximum(_CLEAR * np.median(size, axis=0), _STEPS * steps)).any(axis=1)
    if at_rest:  # it has efforts there, and velocities may be zero
        return zero if clear.mean() > 0.5 else None
    zero[zero] = clear
    return zero


def _old_positions(table: RowTable) -> Mask:
    """Return rows whose positions are those of an earlier one, but for the one before."""
    position = table.values["position"]
    first = position[:, np.argmax(np.ptp(position, axis=0))]  # the others only where it is the same
    old = np.zeros(len(position), dtype=bool)
    for back in range(2, min(_OLDEST, len(position) - 1) + 1):
        rows = np.flatnonzero(first[back:] == first[:-back]) + back
        old[rows] |= (position[rows] == position[rows - back]).all(axis=1)
    if old.any():  # of an arm at rest they are the same again and again
        steps = np.array([quantum(column) for column in position.T])
        way = np.abs(np.diff(position, axis=0, prepend=position[:1]))
        old &= (way > np.maximum(_STEPS * steps, _RESTS)).any(axis=1)
    return old


def _other_layout(table: RowTable) -> Mask | None:
    """Return rows of another layout than the file's first one."""
    return table.other_layout


def _other_clock(table: RowTable) -> Mask | None:
    """Return rows whose stamps are later against their times of reception than the others'."""
    if table.received is None or table.stamps is None or len(table) < 2 * _LEAST:
        return None
    delay = (table.received - table.stamps).astype(float)
    ordered = np.sort(delay)
    cut = int(np.argmax(np.diff(ordered))) + 1
    widths = [np.ptp(np.percentile(part, (5, 95))) for part in (ordered[:cut], ordered[cut:])]
    interval = float(np.ptp(table.received)) / len(table)
    least = max(_CLOCK * interval, _WIDTHS * max(widths))
    return delay >= ordered[cut] if ordered[cut] - ordered[cut - 1] > least else None


def _other_period(source: str, table: RowTable) -> Mask | None:
    """Return rows of the slower or older of two regular sequences that run beside each other.

    A single publisher whose stamps jitter has no two of them; one whose messages come in pairs, or
    with stamps that are early and late in turn, has two in step, neither of which is older, and
    which read the same.
    """
    for marked, in_step, in_pairs in _sequences(table):
        few, many = sorted((int(marked.sum()), int((~marked).sum())))
        differing = _differing(table, marked) if in_step else ""
        if not in_step or (differing and many > _FASTER * few):
            return marked if _stale(table, marked) else ~marked
        if not in_pairs and abs(_late(table, marked)) >= _OLD:
            return marked if _stale(table, marked) else ~marked
        if differing:
            raise RecordingError(
                source,
                f"{differing} differ between two publishers of the same joints in one topic, "
                f"{int((~marked).sum())} and {int(marked.sum())} messages in step: expected one "
                "publisher (`ros2 topic info --verbose` names both): record without the other",
            )
    return None


def _sequences(table: RowTable) -> Iterator[tuple[Mask, bool, bool]]:
    """Yield rows of one of two regular sequences, whether both are in step, and in pairs."""
    assert table.stamps is not None
    order = np.argsort(table.stamps, kind="stable")
    time = (table.stamps[order] - table.stamps[order[0]]) / 1e9
    if len(time) < _SEQUENCE:
        return
    if _regular(time) > _ALONE:  # or two that are half an interval apart
        steps = np.diff(time) / np.median(np.diff(time))
        every = np.append(0, np.cumsum(np.round(steps))) % 2 == 1
        marked = np.zeros(len(time), dtype=bool)
        marked[order[every]] = True
        yield marked, True, True
        return
    for period in _periods(time):
        first = _sequence(time, period)
        if min(first.sum(), (~first).sum()) < _LEAST:
            continue
        own, rest = time[first], time[~first]
        if _regular(rest) < _MOSTLY or first.sum() < _MOSTLY * np.ptp(time) / period:
            continue
        inside = rest[(rest > own[0]) & (rest < own[-1])]
        after = np.searchsorted(own, inside)
        phase = (inside - own[after - 1]) / (own[after] - own[after - 1])
        marked = np.zeros(len(time), dtype=bool)
        marked[order[~first]] = True
        together = np.median(np.minimum(phase, 1.0 - phase)) < _TOGETHER
        yield marked, bool(np.std(phase) < _IN_STEP or together), bool(together)


def _differing(table: RowTable, marked: Mask) -> str:
    """Return which readings of marked messages are other than the rest's, a delay left out."""
    assert table.stamps is not None
    time = (table.stamps - table.stamps[0]) / 1e9
    order = np.argsort(time[~marked], kind="stable")
    rest, at = time[~marked][order], time[marked]
    at = at - float(np.clip(_late(table, marked), -1.0, 1.0) * np.median(np.diff(rest)))
    for quantity in ("effort", "position"):
        values = table.values.get(quantity)
        if values is None:
            continue
        own, others = values[~marked][order], values[marked]
        readings = (np.abs(values) < LARGEST).all(axis=0)  # others are looked at later
        for joint in np.flatnonzero(readings):
            mine, other = own[:, joint], others[:, joint]
            off = np.abs(other - np.interp(at, rest, mine))
            noise = np.abs(mine[1:-1] - np.interp(rest[1:-1], rest[::2], mine[::2]))[::2]
            sizes = off, np.abs(mine - np.median(mine)), noise
            most, spread, rough = (np.quantile(each, _USUAL) for each in sizes)
            if most > max(_DIFFERS * spread, _BEYOND_NOISE * rough):
                return f"{quantity}s of {table.joints[joint]}"
    return ""


def _regular(time: Array) -> float:
    """Return the part of the intervals of (N,) times that are the usual one."""
    intervals = np.diff(time)
    typical = float(np.median(intervals))
    return float(np.mean(np.abs(intervals - typical) < _OFF * typical))


def _periods(time: Array) -> list[float]:
    """Return the shortest intervals, s, at which all or most of (N,) times have another one."""
    few = time[: 4 * _SEQUENCE]
    steps = np.concatenate([few[k:] - few[:-k] for k in range(1, 5)])
    candidates = np.unique(steps[steps > 0.0])
    candidates = candidates[:: 1 + len(candidates) // (4 * _SEQUENCE)]

    def followed(period: float) -> Array:
        after = np.searchsorted(few, few + period).clip(1, len(few) - 1)
        off = np.stack([few[after], few[after - 1]]) - few - period
        nearest = off[np.argmin(np.abs(off), axis=0), np.arange(len(few))]
        return nearest[np.abs(nearest) < 0.25 * _OFF * period]

    if not len(candidates):
        return []
    counts = np.array([len(followed(period)) for period in candidates.tolist()])
    found = [float(candidates[np.argmax(counts > part * counts.max())]) for part in _AS_GOOD]
    return [period + float(np.median(followed(period))) for period in found]


def _sequence(time: Array, period: float) -> Mask:
    """Return the longest regular sequence in (N,) times that begins with one of the first."""
    best = np.zeros(len(time), dtype=bool)
    for begin in range(min(_LEAST, len(time))):
        found = np.zeros(len(time), dtype=bool)
        expected, last = float(time[begin]), float(time[-1])
        while expected <= last + _OFF * period:
            at = int(np.searchsorted(time, expected))
            at = min((k for k in (at - 1, at) if 0 <= k < len(time)),
                     key=lambda k: abs(time[k] - expected))  # fmt: skip
            off = float(time[at]) - expected
            if abs(off) < _OFF * period:
                found[at] = True
                expected += _FOLLOW * off
            expected += period
        best = found if found.sum() > best.sum() else best
    return best


# The most certain first.
_SIGNS: tuple[tuple[str, _Sign], ...] = (
    ("efforts of 0", lambda table: _zeros(table, "effort", at_rest=True)),
    ("velocities of 0", lambda table: _zeros(table, "velocity", at_rest=False)),
    ("old positions", _old_positions),
    ("another clock", _other_clock),
    ("another order of joints, or frame", _other_layout),
)
_OF_EITHER = (_other_clock, _other_layout)  # signs that do not show which of the two is to be kept
