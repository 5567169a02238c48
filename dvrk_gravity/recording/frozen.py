"""Efforts that stay the same, to the last bit, while their joint moves: stopped, or clipped."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.recording.data import Recording
from dvrk_gravity.recording.data_warning import DataWarning
from dvrk_gravity.recording.grid import speed
from dvrk_gravity.recording.quantization import quantum


@dataclass(frozen=True)
class FrozenSettings:
    """When an effort is no reading.

    Attributes:
        longest: s, for which an effort may be the same. Chosen: a part of most motions' periods.
        change: Change of the joint's speed meanwhile, in its RMS speed: friction and inertia take
            another effort then. At a constant speed a noiseless one may stay. Chosen.
        least: rad/s, of that change at least (a tenth in m/s). Chosen: a joint that is held.
        steps: Of the effort in the standard deviation of its other samples: one of coarser steps
            may be the same for long. Chosen, as ``SignalSettings.coarse``.
        clipped: s, for which the greatest or least effort is the same where a limit holds it.
            Chosen: five readings at 200 Hz, as ``SignalSettings.pinned_run``.
    """

    longest: float = 1.0
    change: float = 1.0
    least: float = 0.02
    steps: float = 20.0
    clipped: float = 0.025


@dataclass(frozen=True)
class FrozenSpan:
    """Samples of a joint's effort that are no readings.

    Attributes:
        joint: Number of its column.
        rows: First sample, and the one after the last.
        span: s, times of the first and the last.
        value: The effort, N·m.
    """

    joint: int
    rows: tuple[int, int]
    span: tuple[float, float]
    value: float


def frozen_efforts(recording: Recording) -> list[FrozenSpan]:
    """Return where efforts are no readings; of poses, and of a short recording, nothing is known.

    An effort at its greatest or least is one that a limit holds (``signal_checks.saturation``).
    """
    rate, effort, time = recording.rate, recording.effort, recording.time
    if rate is None or effort is None or time is None or len(recording) < 100:
        return []
    settings, found = FrozenSettings(), []
    least = int(np.ceil(settings.longest * rate))
    rough: Array | None = None
    for joint, column in enumerate(effort.T):
        edges = np.flatnonzero(np.diff(column, prepend=np.nan, append=np.nan))
        runs = [(a, b) for a, b in pairwise(edges.tolist()) if b - a > least]
        if not runs:
            continue
        rough = speed(recording) if rough is None else rough
        typical = float(np.sqrt(np.mean(rough[:, joint] ** 2)))
        enough = max(settings.change * typical, settings.least * float(recording.scale[joint]))
        for first, stop in runs:
            value = float(column[first])
            others = np.delete(column, slice(first, stop))
            if np.ptp(rough[first:stop, joint]) < enough or _at_a_limit(value, others):
                continue
            if len(others) and np.std(others) < settings.steps * _step(column):
                continue
            span = float(time[first]), float(time[stop - 1])
            found.append(FrozenSpan(joint, (first, stop), span, value))
    return found


def clipped_efforts(recording: Recording) -> list[FrozenSpan]:
    """Return where efforts are at a limit, their greatest or least, while their joint moves.

    What the arm took was more than was read. Of poses, and of a short recording, nothing is known.
    """
    rate, effort, time = recording.rate, recording.effort, recording.time
    if rate is None or effort is None or time is None or len(recording) < 100:
        return []
    settings, found = FrozenSettings(), []
    least = max(2, int(np.ceil(settings.clipped * rate)))
    rough: Array | None = None
    for joint, column in enumerate(effort.T):
        edges = np.flatnonzero(np.diff(column, prepend=np.nan, append=np.nan)).tolist()
        ends = {float(column.min()), float(column.max())} - {0.0}
        runs = [(a, b) for a, b in pairwise(edges) if b - a >= least and float(column[a]) in ends]
        if not runs or np.std(column) < settings.steps * _step(column):
            continue
        rough = speed(recording) if rough is None else rough
        moving = 0.1 * np.sqrt(np.mean(rough[:, joint] ** 2))
        found += [
            FrozenSpan(joint, (a, b), (float(time[a]), float(time[b - 1])), float(column[a]))
            for a, b in runs
            if np.mean(np.abs(rough[a:b, joint])) > max(moving, settings.least / 2.0)
        ]
    return found


def _at_a_limit(value: float, others: Array) -> bool:
    """Tell whether an effort, which is not zero, is the greatest or the least of all."""
    if not len(others):
        return False
    return (value > 0.0 and value >= others.max()) or (value < 0.0 and value <= others.min())


def _step(values: Array) -> float:
    """Return the step of efforts; with but two of them the distance is one."""
    distinct = np.unique(values)
    return float(np.ptp(distinct)) if len(distinct) < 3 else quantum(values)


def frozen(recording: Recording) -> list[DataWarning]:
    """Return findings about efforts that are no readings, one a joint."""
    spans = frozen_efforts(recording)
    findings = []
    for joint in dict.fromkeys(span.joint for span in spans):
        own = [span for span in spans if span.joint == joint]
        (first, last), name = own[0].span, recording.joints[joint]
        seconds = sum(span.span[1] - span.span[0] for span in own)
        further = f", {seconds:.3g} s in {len(own)} such spans" if len(own) > 1 else ""
        findings.append(
            DataWarning(
                "effort_frozen", name, {"seconds": seconds, "from_s": first, "to_s": last},
                f"effort stays at {own[0].value:.4g} from {first:.6g} to {last:.6g} s "
                f"({last - first:.3g} s{further}) while the joint goes on moving: no reading",
            )
        )  # fmt: skip
    return findings
