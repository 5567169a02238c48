"""What is wrong with a recording: typed findings by joint, with numbers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arms.description import FASTEST, UNTIMED_STEP
from dvrk_gravity.recording.data import Array, Recording
from dvrk_gravity.recording.data_warning import DataWarning, Kind
from dvrk_gravity.recording.grid import TimingSettings, stale
from dvrk_gravity.recording.signal_checks import (
    position_unit,
    quantisation,
    ripple,
    sampling,
    saturation,
)
from dvrk_gravity.recording.velocity import compare_velocity

UNITS: tuple[Kind, ...] = ("position_unit", "effort_unit", "time_unit")


@dataclass(frozen=True)
class CheckSettings:
    """When numbers count as in another unit, time as irregular, and a joint as at rest.

    Attributes:
        position_margin: Times what the joint reaches. Chosen between what a zero may be off by and
            the 57 of degrees.
        effort_margin: Times what the motor can. Chosen between what a peak may exceed a limit by
            and the 1000 of mN·m.
        time_jitter: Standard deviation of the intervals, as a part of their median. Chosen.
        driven: Part of the work there and back that friction has given to the motor, where none can
            be, beside what springs and weight may still give back: once over the range. Real arms
            have 0.2 to 1.0 of it the other way round (the recordings of docs/psm.md,
            docs/own_arm.md and docs/identification.md). Chosen; among neighbours' weights and
            springs the sum of one joint need not be that of its friction.
        still: Way below which a joint did not move, rad (2 mm where it slides). Chosen: about
            1 deg, more than a servo that holds moves by.
        rates: Hz, between which robots are recorded: stamps that are not in seconds are known by
            it. Chosen wider than any console's rate.
    """

    position_margin: float = 2.5
    effort_margin: float = 10.0
    time_jitter: float = 0.05
    driven: float = 0.2
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
    counts = check_counts(len(recording), recording.invalid, recording.repeated)
    motion = check_motion(recording, np.ptp(recording.position, axis=0))
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
        findings += _time(recording)
        jumps = _jumps(recording)
        if jumps:
            return (*findings, *jumps)
        findings += [*sampling(recording), *ripple(recording), *_velocity(recording)]
        findings += _signs(recording)
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


def _units(recording: Recording) -> list[DataWarning]:
    """Return findings about numbers that no such arm can reach: they are in another unit."""
    arm = recording.arm
    if arm is None:
        return []
    (reach, strength), settings = largest(arm), CheckSettings()
    findings = []
    for column, name in enumerate(recording.joints):
        joint = arm.joints[arm.joint_names.index(name)]
        peak = float(np.max(np.abs(recording.position[:, column])))
        if peak > settings.position_margin * reach[name]:
            numbers = {"largest": peak, "plausible": reach[name]}
            text = f"position up to {peak:.4g}, an arm reaches {reach[name]:g}: expected "
            others = [other for other in arm.joints if other.unit == joint.unit]
            if peak <= max(reach[other.name] for other in others):
                text += f"{joint.unit}, and the columns of the right joints"
                findings.append(DataWarning("exchanged_joints", name, numbers, text))
            else:
                text += "rad, not deg" if joint.unit == "rad" else "m, not mm"
                findings.append(DataWarning("position_unit", name, numbers, text, unusable=True))
        if recording.effort is None:
            continue
        peak = float(np.max(np.abs(recording.effort[:, column])))
        if peak <= settings.effort_margin * strength[name]:
            continue
        numbers = {"largest": peak, "plausible": strength[name]}
        text = f"effort up to {peak:.4g}, an arm reaches {strength[name]:g}: expected "
        if peak <= max(strength.values()):
            text += f"{joint.effort_unit}, and the columns of the right joints"
            findings.append(DataWarning("exchanged_joints", name, numbers, text))
        else:
            text += f"{joint.effort_unit}, not m{joint.effort_unit}"
            findings.append(DataWarning("effort_unit", name, numbers, text, unusable=True))
    return findings


def largest(arm: Arm) -> tuple[dict[str, float], dict[str, float]]:
    """Return the largest position and effort by joint, in joint or actuator coordinates."""
    part = arm.joint_to_actuator[:, :, None]
    # Zero times a joint that has no end is nothing, too.
    each = part * np.where(part == 0.0, 0.0, np.stack([arm.lower, arm.upper], axis=-1))
    motor = np.abs([each.min(axis=2).sum(axis=1), each.max(axis=2).sum(axis=1)]).max(axis=0)
    position = np.maximum(motor, np.maximum(np.abs(arm.lower), np.abs(arm.upper)))
    effort = np.maximum(arm.effort_limit, arm.actuator_effort_limit)
    return (
        dict(zip(arm.joint_names, position.tolist(), strict=True)),
        dict(zip(arm.joint_names, effort.tolist(), strict=True)),
    )


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
                    f"{typical:g} s between samples: expected seconds, not {unit}",
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


def _jumps(recording: Recording) -> list[DataWarning]:
    """Return findings about positions that no joint can have gone between two samples."""
    # What stale samples hide comes at once, and others may be an interval off their stamps.
    fresh = recording.rows(~stale(recording))
    assert fresh.time is not None
    findings = []
    interval = np.diff(fresh.time)
    way = np.diff(fresh.position, axis=0)
    late = float(np.median(interval)) if len(interval) else 0.0
    reach = (UNTIMED_STEP + FASTEST * (interval[:, None] + late)) * recording.scale
    for joint in np.flatnonzero((np.abs(way) > reach).any(axis=0)).tolist():
        rows = np.flatnonzero(np.abs(way[:, joint]) > reach[:, joint])
        name, row = recording.joints[joint], int(rows[0])
        unit = position_unit(recording, name)
        turns = np.round(way[rows, joint] / (2.0 * np.pi))
        rest = np.abs(way[rows, joint] - 2.0 * np.pi * turns)
        wraps = unit == "rad" and bool((rest < reach[rows, joint]).all())
        expected = (
            "an angle that goes on beyond a turn, not wrapped"
            if wraps
            else f"less than {reach[row, joint]:.2g} {unit}; if it is a wrong reading, take its "
            "sample out"
        )
        before, after = fresh.position[row : row + 2, joint]
        findings.append(
            DataWarning(
                "position_jump", name, {"jumps": len(rows), f"way_{unit}": float(way[row, joint])},
                f"position goes from {before:.4g} to {after:.4g} {unit} within "
                f"{1e3 * interval[row]:.3g} ms at {fresh.time[row + 1]:.9g} s"
                f"{f', the first of {len(rows)} jumps' if len(rows) > 1 else ''}: "
                f"expected {expected}",
                unusable=True,
            )
        )  # fmt: skip
    return findings


def _signs(recording: Recording) -> list[DataWarning]:
    """Return findings about motors that friction drives, if their efforts have the right sign."""
    if recording.effort is None:
        return []
    way = np.diff(recording.position, axis=0)
    work = 0.5 * (recording.effort[1:] + recording.effort[:-1]) * way
    there_and_back = np.abs(work).sum(axis=0)
    settings = CheckSettings()
    length = np.maximum(np.abs(way).sum(axis=0), 1e-300)
    last = np.ptp(recording.position, axis=0) / length  # way that nothing was given back on
    findings = []
    for joint in np.flatnonzero(there_and_back > 0.0).tolist():
        part = float(work[:, joint].sum() / there_and_back[joint])
        if part < -settings.driven - last[joint]:
            findings.append(
                DataWarning(
                    "effort_sign", recording.joints[joint], {"work": part},
                    f"its motor takes {-100 * part:.0f} % of the work there and back out of the "
                    "arm, as if friction drove it: an effort of the wrong sign, or of another "
                    "joint, a hand that moves the arm, or work that comes over from other joints",
                )
            )  # fmt: skip
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
