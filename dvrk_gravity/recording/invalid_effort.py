"""Efforts that are no readings: frozen ones, clipped ones, and those at a limit that is known."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, partial
from itertools import pairwise

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.recording.notes import Note
from dvrk_gravity.recording.quantization import quantum
from dvrk_gravity.recording.recording import Recording
from dvrk_gravity.recording.timing import speed

# s, for which an effort may be the same while its joint moves. Chosen: a part of most motions'
# periods.
_FROZEN = 1.0
# Change of the joint's speed meanwhile, in its RMS speed: friction and inertia take another effort
# then; at a constant speed a noiseless one may stay. Chosen.
_FROZEN_CHANGE = 1.0
_FROZEN_SPEED = 0.02  # rad/s, of that change at least (a tenth in m/s). Chosen: a held joint
# Steps of an effort in the standard deviation of its other samples: a coarser effort may stay the
# same for long. Chosen, as _COARSE.
_FROZEN_STEPS = 20.0
# s, for which the greatest or least effort is the same where a limit holds it. Chosen: five
# readings at 200 Hz, as _PINNED_RUN.
_CLIPPED = 0.025
# Part of a known limit from which on an effort counts as clipped. Chosen: a diagnosis finds limits
# to a hundredth, and noise is about another.
_AT_LIMIT = 0.97


@dataclass(frozen=True)
class InvalidSpan:
    """Samples of a joint's effort that are no readings.

    Attributes:
        joint: Number of its column.
        rows: First sample, and the one after the last.
        span: s, times of the first and the last; of poses their numbers.
        value: The effort, N·m.
    """

    joint: int
    rows: tuple[int, int]
    span: tuple[float, float]
    value: float

    @classmethod
    def of(cls, recording: Recording, joint: int, first: int, stop: int) -> InvalidSpan:
        """Return the span of a joint's samples [first, stop)."""
        assert recording.effort is not None
        time = np.arange(len(recording)) if recording.time is None else recording.time
        span = float(time[first]), float(time[stop - 1])
        return cls(joint, (first, stop), span, float(recording.effort[first, joint]))


def frozen_efforts(recording: Recording) -> list[InvalidSpan]:
    """Return spans of efforts that stay the same, to the last bit, while their joint moves.

    Poses and short recordings have none. An effort at its greatest or least is one that a limit
    holds (:func:`.signal_checks.saturation`).
    """
    velocity, found = cache(partial(speed, recording)), []
    for joint, column, runs in _equal_efforts(recording, _FROZEN, 1):
        moving = velocity()[:, joint]
        typical = float(np.sqrt(np.mean(moving**2)))
        enough = max(_FROZEN_CHANGE * typical, _FROZEN_SPEED * float(recording.scale[joint]))
        for first, stop in runs:
            others = np.delete(column, slice(first, stop))
            if np.ptp(moving[first:stop]) < enough or _at_a_limit(float(column[first]), others):
                continue
            if not len(others) or np.std(others) >= _FROZEN_STEPS * _step(column):
                found.append(InvalidSpan.of(recording, joint, first, stop))
    return found


def clipped_efforts(recording: Recording) -> list[InvalidSpan]:
    """Return spans of efforts at a limit, their greatest or least, while their joint moves.

    The arm took more than was read. Poses and short recordings have none.
    """
    velocity, found = cache(partial(speed, recording)), []
    for joint, column, runs in _equal_efforts(recording, _CLIPPED):
        ends = {float(column.min()), float(column.max())} - {0.0}
        runs = [(first, stop) for first, stop in runs if float(column[first]) in ends]
        if not runs or np.std(column) < _FROZEN_STEPS * _step(column):
            continue
        size = np.abs(velocity()[:, joint])
        slowest = max(0.1 * np.sqrt(np.mean(size**2)), _FROZEN_SPEED / 2.0)
        found += [
            InvalidSpan.of(recording, joint, first, stop)
            for first, stop in runs
            if np.mean(size[first:stop]) > slowest
        ]
    return found


def limited_efforts(recording: Recording) -> list[InvalidSpan]:
    """Return spans of efforts at a limit that is known, ``Recording.effort_limit``."""
    effort, limits, arm = recording.effort, recording.effort_limit, recording.arm
    if effort is None or not limits:
        return []
    limit = _AT_LIMIT * np.array([limits.get(joint, np.inf) for joint in recording.joints])
    if recording.coordinates == "actuator" and arm is not None and len(limit) == arm.n:
        clipped = (np.abs(arm.joint_effort(effort)) >= limit) @ (arm.actuator_to_joint != 0.0)
    else:
        clipped = np.abs(effort) >= limit
    edges = np.diff(clipped.astype(np.int8), axis=0, prepend=0, append=0)
    return [
        InvalidSpan.of(recording, joint, first, stop)
        for joint, steps in enumerate(edges.T)
        for first, stop in zip(
            np.flatnonzero(steps > 0).tolist(), np.flatnonzero(steps < 0).tolist(), strict=True
        )
    ]


def invalid_efforts(recording: Recording) -> list[InvalidSpan]:
    """Return spans of efforts that are no readings: frozen, or at a known limit."""
    return [*frozen_efforts(recording), *limited_efforts(recording)]


def _equal_efforts(
    recording: Recording, duration: float, more: int = 0
) -> Iterator[tuple[int, Array, list[tuple[int, int]]]]:
    """Yield joints' efforts and runs [first, stop) of equal ones, of s and some samples more."""
    rate, effort = recording.rate, recording.effort
    if rate is None or effort is None or len(recording) < 100:
        return
    least = max(2, int(np.ceil(duration * rate)) + more)
    for joint, column in enumerate(effort.T):
        edges = np.flatnonzero(np.diff(column, prepend=np.nan, append=np.nan)).tolist()
        runs = [(first, stop) for first, stop in pairwise(edges) if stop - first >= least]
        if runs:
            yield joint, column, runs


def _at_a_limit(value: float, others: Array) -> bool:
    """Return whether an effort, which is not zero, is the greatest or the least of all."""
    if not len(others):
        return False
    return (value > 0.0 and value >= others.max()) or (value < 0.0 and value <= others.min())


def _step(values: Array) -> float:
    """Return the step of efforts; the distance of only two of them is one."""
    distinct = np.unique(values)
    return float(np.ptp(distinct)) if len(distinct) < 3 else quantum(values)


def frozen(recording: Recording) -> list[Note]:
    """Return findings about efforts that are no readings, one a joint."""
    spans = frozen_efforts(recording)
    findings = []
    for joint in dict.fromkeys(span.joint for span in spans):
        own = [span for span in spans if span.joint == joint]
        first, last = own[0].span
        seconds = sum(span.span[1] - span.span[0] for span in own)
        further = f", {seconds:.3g} s in {len(own)} such spans" if len(own) > 1 else ""
        text = (
            f"effort stays at {own[0].value:.4g} from {first:.6g} to {last:.6g} s "
            f"({last - first:.3g} s{further}) while the joint moves: not a reading"
        )
        numbers = {"seconds": seconds, "from_s": first, "to_s": last}
        findings.append(Note("effort_frozen", recording.joints[joint], numbers, text))
    return findings
