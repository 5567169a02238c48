"""What is wrong with a recording: typed findings by joint, with numbers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.recording.data import Recording
from dvrk_gravity.recording.data_warning import DataWarning, Kind
from dvrk_gravity.recording.frozen import frozen
from dvrk_gravity.recording.grid import TimingSettings
from dvrk_gravity.recording.impossible import beyond_the_arm, driven_motors, jumps
from dvrk_gravity.recording.notes import Note, merged
from dvrk_gravity.recording.signal_checks import (
    position_unit,
    quantisation,
    ripple,
    sampling,
    saturation,
)
from dvrk_gravity.recording.velocity import common_factor, compare_velocity

UNITS: tuple[Kind, ...] = ("position_unit", "effort_unit", "time_unit")


@dataclass(frozen=True)
class CheckSettings:
    """When time counts as irregular, and a joint as at rest.

    Attributes:
        time_jitter: Standard deviation of the intervals, as a part of their median. Chosen.
        still: Way below which a joint did not move, rad (2 mm where it slides). Chosen: about
            1 deg, more than a servo that holds moves by.
        rates: Hz, between which robots are recorded: stamps that are not in seconds are known by
            it. Chosen wider than any console's rate.
    """

    time_jitter: float = 0.05
    still: float = 0.02
    rates: tuple[float, float] = (10.0, 5000.0)


def check(
    recording: Recording, effort_limits: Mapping[str, float] | None = None
) -> tuple[DataWarning, ...]:
    """Look for what makes a recording worse than it seems.

    Args:
        recording: Trajectory or static poses.
        effort_limits: Limit by joint, N·m, in the recording's coordinates; without it, saturation
            shows only as an extreme effort that repeats.

    Returns:
        Findings, those of the whole recording first.
    """
    signals = check_signals(recording, effort_limits)
    if any(finding.kind in UNITS for finding in signals):
        return signals
    counts = check_counts(len(recording), recording.found)
    motion = check_motion(recording, np.ptp(recording.position, axis=0))
    return in_order([*counts, *motion, *signals])


def in_order(findings: Iterable[DataWarning]) -> tuple[DataWarning, ...]:
    """Return findings with those of the whole recording first."""
    return tuple(sorted(findings, key=lambda finding: finding.joint is not None))


def check_signals(
    recording: Recording, effort_limits: Mapping[str, float] | None = None
) -> tuple[DataWarning, ...]:
    """Return what a part of a recording tells by itself: units, time, signals; see ``check``."""
    findings = beyond_the_arm(recording)
    if findings:
        # Every further figure would be in the wrong unit.
        return tuple(findings)
    if recording.time is not None and len(recording) > 2:
        findings += _time(recording)
        found = jumps(recording)
        if found:
            return (*findings, *found)
        findings += [*sampling(recording), *ripple(recording), *_velocity(recording)]
        findings += [*driven_motors(recording), *frozen(recording)]
    findings += [*saturation(recording, effort_limits or {}), *quantisation(recording)]
    return tuple(findings)


def check_counts(samples: int, notes: Iterable[Note]) -> list[DataWarning]:
    """Return findings about what reading left out of a file of which samples are left."""
    notes = merged(notes)
    total = samples + sum(note.count for note in notes)
    return [note.warning(total) for note in notes]


def check_motion(recording: Recording, ranges: Array) -> list[DataWarning]:
    """Return findings about joints that do not move; ``ranges`` (n,) rad or m."""
    still = ranges < CheckSettings().still * recording.scale
    if np.all(still):
        furthest = recording.joints[int(np.argmax(ranges))]
        unit = position_unit(recording, furthest)
        return [
            DataWarning(
                "nothing_moves",
                None,
                {f"range_{unit}": float(ranges.max())},
                f"no joint moves by more than {ranges.max():.2g} {unit}",
                unusable=True,
            )
        ]
    return [
        DataWarning(
            "no_motion",
            joint,
            {f"range_{position_unit(recording, joint)}": float(ranges[k])},
            f"moves by {ranges[k]:.2g} {position_unit(recording, joint)} only",
        )
        for k, joint in enumerate(recording.joints)
        if still[k]
    ]


def _time(recording: Recording) -> list[DataWarning]:
    assert recording.time is not None
    intervals = np.diff(recording.time)
    typical = float(np.median(intervals))
    findings, settings = [], CheckSettings()
    slowest, fastest = settings.rates
    for unit, factor in (("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)):
        if 1.0 / typical < 2.0 and slowest <= 1.0 / (typical * factor) <= fastest:
            findings.append(
                DataWarning(
                    "time_unit",
                    None,
                    {"interval": typical},
                    f"{typical:g} s between samples: expected seconds, not {unit} (of a CSV file: "
                    f"--columns 'time=time[{unit}]')",
                    unusable=True,
                )
            )
    long = intervals > TimingSettings().gap * typical
    if long.any():
        findings.append(
            DataWarning(
                "gaps",
                None,
                {"count": int(long.sum()), "longest_s": float(intervals.max())},
                f"{long.sum()} gaps in time, the longest {intervals.max():.3g} s",
            )
        )
    jitter = float(np.std(intervals[~long]))
    if jitter > settings.time_jitter * typical:
        findings.append(
            DataWarning(
                "time_jitter",
                None,
                {"jitter_s": jitter, "interval_s": typical},
                f"intervals vary by {1e3 * jitter:.2g} ms around {1e3 * typical:.3g} ms",
            )
        )
    return findings


def _velocity(recording: Recording) -> list[DataWarning]:
    fits = compare_velocity(recording)
    findings, common = [], common_factor(fits)
    if common is not None:
        findings.append(
            DataWarning(
                "wrong_clock",
                None,
                {"factor": common},
                f"velocity is {common:.3g} times the differentiated position at all joints: the "
                f"clock, or all velocities, are wrong by a factor of {max(common, 1 / common):.2g}",
            )
        )
    for joint, fit in zip(recording.joints, fits, strict=True):
        if fit is None or not fit.worse:
            continue
        sense = "late" if fit.lag > 0.0 else "early"
        numbers = {
            "slope": fit.slope,
            "lag_s": fit.lag,
            "correlation": fit.correlation,
            "residual": fit.residual,
        }
        findings.append(
            DataWarning(
                "velocity_factor"
                if common is None and fit.of_another_scale
                else "velocity_mismatch",
                joint,
                numbers,
                f"velocity is {fit.slope:.3g} times the differentiated position"
                f"{fit.suspicion}, {abs(1e3 * fit.lag):.1f} ms {sense}, correlation "
                f"{fit.correlation:.3f}, {100 * fit.residual:.0f} % of it unexplained",
                unusable=fit.position_in_degrees,
            )
        )
    return findings
