"""What is wrong with a recording: typed findings by joint, with numbers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from dvrk_gravity.arm import JOINT_NAMES
from dvrk_gravity.recording.data import Array, Recording
from dvrk_gravity.recording.data_warning import DataWarning, Kind
from dvrk_gravity.recording.grid import GAP
from dvrk_gravity.recording.signal_checks import quantisation, ripple, sampling, saturation
from dvrk_gravity.recording.velocity import compare_velocity

# Largest position (rad) and effort (N·m) of any MTM's joint, in joint or actuator coordinates.
LARGEST_POSITION = dict(zip(JOINT_NAMES, (1.14, 1.14, 2.01, 5.4, 3.3, 0.79, 8.4), strict=True))
LARGEST_EFFORT = dict(
    zip(JOINT_NAMES, (1.861, 3.217, 1.960, 0.309, 0.097, 0.097, 0.023), strict=True)
)
POSITION_MARGIN = 2.5  # a zero may be far off, but degrees are 57 times as many
EFFORT_MARGIN = 10.0  # a peak may exceed the limit, but mN·m are 1000 times as many

TIME_JITTER = 0.05  # of the sampling interval
STILL = 0.02  # rad; a joint that stays within this did not move
UNITS: tuple[Kind, ...] = ("position_unit", "effort_unit", "time_unit")
RATES = (10.0, 5000.0)  # Hz, between which robots are recorded


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
    counts = check_counts(len(recording), recording.invalid, recording.repeated)
    motion = check_motion(recording.joints, np.ptp(recording.position, axis=0))
    return in_order([*counts, *motion, *signals])


def in_order(findings: Iterable[DataWarning]) -> tuple[DataWarning, ...]:
    """Return findings with those of the whole recording first."""
    return tuple(sorted(findings, key=lambda finding: finding.joint is not None))


def check_signals(
    recording: Recording, effort_limits: Mapping[str, float] | None = None
) -> tuple[DataWarning, ...]:
    """Return what a part of a recording tells by itself: units, time, signals; see ``check``."""
    findings = _units(recording)
    if findings:
        # Every further figure would be in the wrong unit.
        return tuple(findings)
    if recording.time is not None and len(recording) > 2:
        findings += [*_time(recording), *sampling(recording), *ripple(recording)]
        findings += _velocity(recording)
    findings += [*saturation(recording, effort_limits or {}), *quantisation(recording)]
    return tuple(findings)


def check_counts(samples: int, invalid: int, repeated: int) -> list[DataWarning]:
    """Return findings about samples that were left out in reading."""
    total = samples + invalid + repeated
    counted: tuple[tuple[Kind, int, str], ...] = (
        ("invalid_stamps", invalid, "with stamp 0 (marked invalid)"),
        ("repeated_stamps", repeated, "with the time of the sample before"),
    )
    return [
        DataWarning(
            kind,
            None,
            {"samples": count, "share": count / total},
            f"{count} of {total} samples {what}, left out",
        )
        for kind, count, what in counted
        if count
    ]


def check_motion(joints: Sequence[str], ranges: Array) -> list[DataWarning]:
    """Return findings about joints that do not move; ``ranges`` (n,) rad."""
    if np.all(ranges < STILL):
        return [
            DataWarning(
                "nothing_moves",
                None,
                {"range_rad": float(ranges.max())},
                f"no joint moves by more than {ranges.max():.2g} rad",
                unusable=True,
            )
        ]
    return [
        DataWarning("no_motion", joint, {"range_rad": float(span)}, f"moves by {span:.2g} rad only")
        for joint, span in zip(joints, ranges, strict=True)
        if span < STILL
    ]


def _units(recording: Recording) -> list[DataWarning]:
    tables: tuple[tuple[Kind, Array | None, dict[str, float], float, str], ...] = (
        ("position_unit", recording.position, LARGEST_POSITION, POSITION_MARGIN, "rad, not deg"),
        ("effort_unit", recording.effort, LARGEST_EFFORT, EFFORT_MARGIN, "N·m, not mN·m"),
    )
    findings = []
    for kind, values, largest, margin, unit in tables:
        if values is None:
            continue
        for joint, peak in zip(recording.joints, np.max(np.abs(values), axis=0), strict=True):
            if peak <= margin * largest[joint]:
                continue
            numbers = {"largest": float(peak), "plausible": largest[joint]}
            what = kind.split("_")[0]
            text = f"{what} up to {peak:.4g}, an arm reaches {largest[joint]:g}: expected"
            if kind == "effort_unit" and peak <= max(largest.values()):
                text += " N·m, and the columns of the right joints"
                findings.append(DataWarning("exchanged_joints", joint, numbers, text))
            else:
                findings.append(DataWarning(kind, joint, numbers, f"{text} {unit}", unusable=True))
    return findings


def _time(recording: Recording) -> list[DataWarning]:
    assert recording.time is not None
    intervals = np.diff(recording.time)
    typical = float(np.median(intervals))
    findings = []
    for unit, factor in (("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)):
        if 1.0 / typical < 2.0 and RATES[0] <= 1.0 / (typical * factor) <= RATES[1]:
            findings.append(
                DataWarning(
                    "time_unit",
                    None,
                    {"interval": typical},
                    f"{typical:g} s between samples: expected seconds, not {unit}",
                    unusable=True,
                )
            )
    long = intervals > GAP * typical
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
    if jitter > TIME_JITTER * typical:
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
    findings = []
    for joint, fit in zip(recording.joints, compare_velocity(recording), strict=True):
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
                "velocity_mismatch",
                joint,
                numbers,
                f"velocity is {fit.slope:.3g} times the differentiated position"
                f"{fit.suspicion}, {abs(1e3 * fit.lag):.1f} ms {sense}, correlation "
                f"{fit.correlation:.3f}, {100 * fit.residual:.0f} % of it unexplained",
                unusable=fit.position_in_degrees,
            )
        )
    return findings
