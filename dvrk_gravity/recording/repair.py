"""Impossible readings left out, and angles that wrap at a turn unwrapped.

A joint that jumps and is back a moment later, or stands still for a moment and then catches up,
was not read in between. A jump that stays is refused by the checks: which side of it is right would
have to be guessed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import compress

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arms import FASTEST, UNTIMED_STEP
from dvrk_gravity.arrays import Mask
from dvrk_gravity.recording.limits import EFFORT_MARGIN, MOMENT, beyond_reach, largest, reachable
from dvrk_gravity.recording.notes import Note, merged, note
from dvrk_gravity.recording.samples import Samples
from dvrk_gravity.recording.timing import stale

TURN = 2.0 * np.pi
_AWAY = "in which its position jumps away and back"
_STALLED = "in which its position stands still and then catches up"
_EFFORT = "with an effort that no such motor has"


_MOST_AWAY = 0.1  # s, that a reading may be away. Chosen: 20 samples at 200 Hz
_MOST_STALLED = 0.25  # s, that a joint may seem to stand still while it moves. Chosen
# Multiple of the joint's speed before or after, at which it may have moved meanwhile. Chosen: it
# may have been speeding up.
_FASTER = 2.0
_TURN_ERROR = 0.5  # rad, that a step may be off a turn. Chosen: a joint at 25 rad/s, read at 50 Hz
# Part of the samples that may be no readings. Chosen: more is a fault of the recording, which the
# checks refuse.
_MOST = 0.1


def repaired(samples: Samples) -> Samples:
    """Return a recording without impossible readings, which are counted."""
    if samples.time is None:
        return samples
    whole = _unwrapped(samples)
    notes, keep = list(whole.notes), np.ones(len(whole), dtype=bool)
    for text, joint, rows in _impossible(whole):
        notes += _count(text, joint, keep, rows)
        keep[rows] = False
    return replace(whole, notes=merged(notes)).rows(keep) if not keep.all() else whole


def _count(text: str, joint: str, keep: Mask, rows: NDArray[np.intp]) -> list[Note]:
    """Return a note of how many more samples are left out for a reason, if any."""
    count = int(keep[rows].sum())
    return [note("impossible_readings", text, joint, count)] if count else []


def _unwrapped(samples: Samples) -> Samples:
    """Return samples with angles that go on beyond a turn."""
    time = samples.time
    assert time is not None
    way = np.diff(samples.position, axis=0)
    turns = np.round(way / TURN)
    turning = _may_turn(samples) & ~_in_another_unit(samples)
    if not turns[:, turning].any():
        return samples
    interval = np.diff(time)[:, None]
    rest = way - TURN * turns
    most = np.minimum(FASTEST * (interval + float(np.median(interval))) + UNTIMED_STEP, _TURN_ERROR)
    found = (turns != 0.0) & turning & (np.abs(rest) <= most)
    # Files wrap at half a turn, or at a whole one; angles unwrapped before are turns away.
    ends = np.abs((samples.position + np.pi / 2.0) % np.pi - np.pi / 2.0) <= _TURN_ERROR
    at_ends = ends[:-1] & ends[1:]
    found &= at_ends
    if samples.velocity is not None:
        expected = 0.5 * (samples.velocity[1:] + samples.velocity[:-1]) * interval
        found &= ~((np.abs(expected) > UNTIMED_STEP) & (np.sign(expected) != np.sign(rest)))
    if not found.any():
        return samples
    added = np.zeros_like(samples.position)
    added[1:] = np.cumsum(np.where(found, -TURN * turns, 0.0), axis=0)
    text = "its position wraps at a turn, and was unwrapped"
    notes = [note("wrapped", text, joint) for joint in compress(samples.joints, found.any(axis=0))]
    position = samples.position + added
    position.flags.writeable = False
    return replace(samples, position=position, notes=merged((*samples.notes, *notes)))


def _may_turn(samples: Samples) -> Mask:
    """Return the (n,) mask of joints that can go on beyond a turn; of an unknown arm, all."""
    if samples.arm is None:
        return np.ones(len(samples.joints), dtype=bool)
    joints = {
        joint.name: joint.kind == "revolute" and joint.upper - joint.lower > TURN
        for joint in samples.arm.joints
    }
    return np.array([joints[name] for name in samples.joints])


Left = tuple[str, str, NDArray[np.intp]]  # why, of which joint, which rows


def _impossible(samples: Samples) -> list[Left]:
    """Return rows with impossible readings."""
    found = _beyond_motors(samples)
    way = np.abs(np.diff(samples.position, axis=0))
    if not (way > UNTIMED_STEP * samples.scale).any():  # which any joint can go
        return found
    fresh = np.flatnonzero(~stale(samples))
    track = _Track(samples.rows(fresh))
    following = np.append(fresh, len(samples))
    # Of faults in more samples, or of positions in another unit, nothing is left out.
    some = (track.beyond.mean(axis=0) <= 2.0 * _MOST) & ~_in_another_unit(samples)
    for joint in np.flatnonzero(track.beyond.any(axis=0) & some).tolist():
        own = [
            (text, samples.joints[joint], np.arange(fresh[first], following[stop]))
            for text, first, stop in track.of(joint)
        ]
        if sum(len(rows) for _, _, rows in own) <= _MOST * len(samples):
            found += own
    return found


def _in_another_unit(samples: Samples) -> Mask:
    """Return (n,) joints whose positions are far beyond the arm's reach most of the time."""
    if samples.arm is None:
        return np.zeros(len(samples.joints), dtype=bool)
    return np.asarray(beyond_reach(samples, samples.arm).mean(axis=0) > _MOST)


def _beyond_motors(samples: Samples) -> list[Left]:
    """Return rows with efforts far beyond the motors' for a moment; longer, the unit is wrong."""
    if samples.arm is None or samples.effort is None:
        return []
    assert samples.time is not None
    _, strength = largest(samples.arm)
    most = EFFORT_MARGIN * np.array([strength[joint] for joint in samples.joints])
    beyond = np.abs(samples.effort) > most
    found = []
    for joint in np.flatnonzero(beyond.any(axis=0)).tolist():
        if np.mean(beyond[:, joint]) > _MOST:
            continue
        edges = np.flatnonzero(np.diff(beyond[:, joint], prepend=False, append=False))
        for first, stop in edges.reshape(-1, 2).tolist():
            if samples.time[stop - 1] - samples.time[first] <= _MOST_AWAY:
                found.append((_EFFORT, samples.joints[joint], np.arange(first, stop)))
    return found


class _Track:
    """Tracks of joints, and impossible steps in them."""

    def __init__(self, fresh: Samples) -> None:
        assert fresh.time is not None
        self._time, self._position, self._scale = fresh.time, fresh.position, fresh.scale
        self._way = np.abs(np.diff(fresh.position, axis=0))
        self.beyond = self._way > reachable(fresh)

    def of(self, joint: int) -> Iterator[tuple[str, int, int]]:
        """Yield faults of a joint: reason, first sample, sample after the last."""
        steps = np.flatnonzero(self.beyond[:, joint]).tolist()
        at = 0
        while at < len(steps):
            step = steps[at]  # from this sample to the next
            still = self._still_since(joint, step)
            if still < step and self._goes_on(joint, still, step + 1):
                yield _STALLED, still + 1, step + 1
                at += 1
                continue
            back = self._back(joint, steps, at)
            if back:
                yield _AWAY, step + 1, steps[at + back] + 1
                at += back + 1
                continue
            first, last = at == 0, at == len(steps) - 1
            if first and self._time[step] - self._time[0] <= _MOST_AWAY:
                yield _AWAY, 0, step + 1
            elif last and self._time[-1] - self._time[step + 1] <= _MOST_AWAY:
                yield _AWAY, step + 1, len(self._time)
            at += 1

    def _still_since(self, joint: int, sample: int) -> int:
        """Return since which sample a joint's position has been the same."""
        position, time = self._position[:, joint], self._time
        first = sample
        while first > 0 and position[first - 1] == position[sample]:
            first -= 1
            if time[sample] - time[first] > _MOST_STALLED:
                return sample  # it stands
        return first

    def _back(self, joint: int, steps: list[int], at: int) -> int:
        """Return after how many steps a joint is back on its track; 0: it is not."""
        for more in range(1, len(steps) - at):
            last = steps[at + more]
            if self._time[last] - self._time[steps[at] + 1] > _MOST_AWAY:
                return 0
            if self._goes_on(joint, steps[at], last + 1):
                return more
        return 0

    def _goes_on(self, joint: int, first: int, last: int) -> bool:
        """Return whether a joint can go from one sample to another at its speed around them."""
        interval = float(self._time[last] - self._time[first])
        speed = max(self._speed(joint, first, -1), self._speed(joint, last, 1))
        most = min(_FASTER * speed, FASTEST * float(self._scale[joint])) * interval
        way = abs(float(self._position[last, joint] - self._position[first, joint]))
        return way <= most + UNTIMED_STEP * float(self._scale[joint])

    def _speed(self, joint: int, sample: int, side: int) -> float:
        """Return a joint's speed just before or after a sample."""
        other = int(np.searchsorted(self._time, self._time[sample] + side * MOMENT))
        first, last = sorted((sample, min(other, len(self._time) - 1)))
        own = ~self.beyond[first:last, joint]
        if not own.any():
            return 0.0
        ways, intervals = self._way[first:last, joint], np.diff(self._time[first : last + 1])
        return float(ways[own].sum() / intervals[own].sum())
