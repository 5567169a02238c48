"""What no such arm can do: reach so far, pull so hard, jump, or be driven by its friction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dvrk_gravity.recording.data import Recording
from dvrk_gravity.recording.data_warning import DataWarning
from dvrk_gravity.recording.grid import stale
from dvrk_gravity.recording.signal_checks import position_unit
from dvrk_gravity.recording.steps import largest, reachable


@dataclass(frozen=True)
class PossibleSettings:
    """When numbers count as in another unit, and a motor as driven by friction.

    Attributes:
        position_margin: Times what the joint reaches. Chosen between what a zero may be off by and
            the 57 of degrees.
        effort_margin: Times what the motor can. Chosen between what a peak may exceed a limit by
            and the 1000 of mN·m.
        driven: Part of the work there and back that friction has given to the motor, where none can
            be, beside what springs and weight may still give back: once over the range. Real arms
            have 0.2 to 1.0 of it the other way round (the recordings of docs/psm.md,
            docs/own_arm.md and docs/identification.md). Chosen; among neighbours' weights and
            springs the sum of one joint need not be that of its friction.
    """

    position_margin: float = 2.5
    effort_margin: float = 10.0
    driven: float = 0.2


def beyond_the_arm(recording: Recording) -> list[DataWarning]:
    """Return findings about numbers that no such arm can reach: they are in another unit."""
    arm = recording.arm
    if arm is None:
        return []
    (reach, strength), settings = largest(arm), PossibleSettings()
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


def jumps(recording: Recording) -> list[DataWarning]:
    """Return findings about positions that no joint can have gone between two samples."""
    # What stale samples hide comes at once, and others may be an interval off their stamps.
    fresh = recording.rows(~stale(recording))
    assert fresh.time is not None
    findings = []
    interval, way = np.diff(fresh.time), np.diff(fresh.position, axis=0)
    reach = reachable(fresh)
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


def driven_motors(recording: Recording) -> list[DataWarning]:
    """Return findings about motors that friction drives, if their efforts have the right sign."""
    if recording.effort is None:
        return []
    way = np.diff(recording.position, axis=0)
    work = 0.5 * (recording.effort[1:] + recording.effort[:-1]) * way
    there_and_back = np.abs(work).sum(axis=0)
    settings = PossibleSettings()
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
