"""Checks of a recording: findings by joint, with numbers."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from dvrk_gravity.recording.invalid_effort import frozen
from dvrk_gravity.recording.limits import STILL, beyond_the_arm, jumps, position_unit
from dvrk_gravity.recording.notes import Kind, Note, merged
from dvrk_gravity.recording.position_unit import declaring
from dvrk_gravity.recording.recording import Recording
from dvrk_gravity.recording.signal_checks import (
    driven_motors,
    held,
    quantisation,
    ripple,
    sampling,
    saturation,
)
from dvrk_gravity.recording.timing import TimingSettings
from dvrk_gravity.recording.velocity import common_factor, compare_velocity

UNITS: tuple[Kind, ...] = ("position_unit", "effort_unit", "time_unit")
# s, from which on a gap may be one between the stretches of a recording that was cut. Chosen: a
# diagnosis needs more of each.
_BETWEEN_STRETCHES = 5.0
_JITTER = 0.05  # standard deviation of the intervals, as a part of their median. Chosen
# Hz, between which robots are recorded: stamps that are not in seconds are known by it. Chosen
# wider than any console's rate.
_RATES = (10.0, 5000.0)


def check(recording: Recording) -> tuple[Note, ...]:
    """Return the faults of a trajectory or static poses, those of the whole recording first."""
    signals = _signals(recording)
    if any(finding.kind in UNITS for finding in signals):
        return tuple(signals)
    counts = check_counts(len(recording), recording.found)
    findings = [*counts, *_motion(recording), *signals]
    return tuple(sorted(findings, key=lambda finding: finding.joint is not None))


def _signals(recording: Recording) -> list[Note]:
    """Return findings about units, time and signals."""
    findings = beyond_the_arm(recording)
    if findings:
        return findings  # every further figure would be in the wrong unit
    if recording.time is not None and len(recording) > 2:
        findings += _time(recording)
        found = jumps(recording)
        if found:
            return [*findings, *found]
        findings += [
            *held(recording),
            *sampling(recording),
            *ripple(recording),
            *_velocity(recording),
        ]
        findings += [*driven_motors(recording), *frozen(recording)]
    return [*findings, *saturation(recording), *quantisation(recording)]


def check_counts(samples: int, notes: Iterable[Note]) -> list[Note]:
    """Return the reader's notes as findings about a file of which so many samples are left."""
    notes = merged(notes)
    total = samples + sum(each.left_out for each in notes)
    return [each.of(total) for each in notes]


def _motion(recording: Recording) -> list[Note]:
    """Return findings about joints that do not move."""
    ranges = np.ptp(recording.position, axis=0)
    still = ranges < STILL * recording.scale
    if np.all(still):
        furthest = recording.joints[int(np.argmax(ranges))]
        unit = position_unit(recording, furthest)
        text = f"no joint moves by more than {ranges.max():.2g} {unit}"
        text += "".join(f"; {note.text}" for note in recording.notes if note.kind == "moving_topic")
        numbers = {f"range_{unit}": float(ranges.max())}
        return [Note("nothing_moves", None, numbers, text, unusable=True)]
    findings = []
    for k in np.flatnonzero(still).tolist():
        joint, way = recording.joints[k], float(ranges[k])
        unit = position_unit(recording, joint)
        text = f"moves by {way:.2g} {unit} only"
        findings.append(Note("no_motion", joint, {f"range_{unit}": way}, text))
    return findings


def _time(recording: Recording) -> list[Note]:
    assert recording.time is not None
    intervals = np.diff(recording.time)
    typical = float(np.median(intervals))
    findings = []
    slowest, fastest = _RATES
    for unit, factor in (("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)):
        if 1.0 / typical < 2.0 and slowest <= 1.0 / (typical * factor) <= fastest:
            text = (
                f"{typical:g} s between samples: expected seconds, not {unit} (of a CSV file: "
                f"--columns 'time=time[{unit}]')"
            )
            numbers = {"interval": typical}
            findings.append(Note("time_unit", None, numbers, text, unusable=True))
    long = intervals > TimingSettings().gap * typical
    if any(note.kind == "excerpt" for note in recording.notes):
        long &= intervals < _BETWEEN_STRETCHES
    if long.any():
        numbers = {"count": int(long.sum()), "longest_s": float(intervals.max())}
        text = f"{long.sum()} gaps in time, the longest {intervals.max():.3g} s"
        findings.append(Note("gaps", None, numbers, text))
    jitter = float(np.std(intervals[~long]))
    if jitter > _JITTER * typical:
        numbers = {"jitter_s": jitter, "interval_s": typical}
        text = f"sampling intervals vary by {1e3 * jitter:.2g} ms around {1e3 * typical:.3g} ms"
        findings.append(Note("time_jitter", None, numbers, text))
    return findings


def _velocity(recording: Recording) -> list[Note]:
    fits = compare_velocity(recording)
    findings, common = [], common_factor(fits)
    if common is not None:
        text = (
            f"velocity is {common:.3g} times the differentiated position at all joints: the "
            f"clock, or all velocities, are wrong by a factor of {max(common, 1 / common):.2g}"
        )
        findings.append(Note("wrong_clock", None, {"factor": common}, text))
    for joint, fit in zip(recording.joints, fits, strict=True):
        if fit is None or not fit.worse:
            continue
        scaled = common is None and fit.of_another_scale
        kind: Kind = "velocity_factor" if scaled else "velocity_mismatch"
        numbers = {
            "slope": fit.slope,
            "lag_s": fit.lag,
            "correlation": fit.correlation,
            "residual": fit.residual,
        }
        text = (
            f"velocity is {fit.slope:.3g} times the differentiated position{fit.suspicion}, "
            f"{abs(1e3 * fit.lag):.1f} ms {'late' if fit.lag > 0.0 else 'early'}, correlation "
            f"{fit.correlation:.3f}, {100 * fit.residual:.0f} % of it unexplained"
        )
        unusable = fit.position_in_degrees
        if unusable:
            text += f"; {declaring(joint, 'position', 'deg')}"
        findings.append(Note(kind, joint, numbers, text, unusable))
    return findings
