"""What no such arm can do: reach so far, pull so hard, jump, or be driven by its friction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arms.description import FASTEST, UNTIMED_STEP
from dvrk_gravity.recording.data import Array, Recording
from dvrk_gravity.recording.data_warning import DataWarning
from dvrk_gravity.recording.grid import stale
from dvrk_gravity.recording.signal_checks import position_unit


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
        sudden: rad/s^2, by which a joint may be faster than a moment before. Chosen: it is at
            FASTEST in 25 ms, within five samples at 200 Hz.
        moment: s, on either side, whose speed tells how fast a joint moves. Chosen.
    """

    position_margin: float = 2.5
    effort_margin: float = 10.0
    driven: float = 0.2
    sudden: float = 1000.0
    moment: float = 0.1


def beyond_the_arm(recording: Recording) -> list[DataWarning]:
    """Return findings about numbers that no such arm can reach: they are in another unit."""
    arm = recording.arm
    if arm is None:
        return []
    (reach, strength), settings = _largest(arm), PossibleSettings()
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


def _largest(arm: Arm) -> tuple[dict[str, float], dict[str, float]]:
    """Return the largest position and effort by joint, in joint or actuator coordinates."""
    part = arm.joint_to_actuator[:, :, None]
    # Zero times a joint that has no end is nothing, too.
    each = part * np.where(part == 0.0, 0.0, np.stack([arm.lower, arm.upper], axis=-1))
    motor = np.abs([each.min(axis=2).sum(axis=1), each.max(axis=2).sum(axis=1)]).max(axis=0)
    position = np.maximum(motor, np.maximum(np.abs(arm.lower), np.abs(arm.upper)))
    effort = np.maximum(arm.effort_limit, arm.actuator_effort_limit)
    effort[[not joint.effort_stated for joint in arm.joints]] = np.inf
    return (
        dict(zip(arm.joint_names, position.tolist(), strict=True)),
        dict(zip(arm.joint_names, effort.tolist(), strict=True)),
    )


def jumps(recording: Recording) -> list[DataWarning]:
    """Return findings about positions that no joint can have gone between two samples."""
    # What stale samples hide comes at once, and others may be an interval off their stamps.
    fresh = recording.rows(~stale(recording))
    assert fresh.time is not None
    findings = []
    interval = np.diff(fresh.time)
    way = np.diff(fresh.position, axis=0)
    late = float(np.median(interval)) if len(interval) else 0.0
    if late <= 0.0:  # one sample, or stamps of which most repeat others
        return []
    within = interval[:, None] + late
    speeding = PossibleSettings().sudden * within**2 * recording.scale
    going_on = _speed_around(np.abs(way), late) * (_renewed_after(way, fresh.time) + late)
    reach = np.minimum(going_on + speeding, FASTEST * within * recording.scale)
    reach += UNTIMED_STEP * recording.scale
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


def _speed_around(way: Array, interval: float) -> Array:
    """Return (N, n) speeds just before and after each of (N, n) ways between two samples.

    The way itself is left out, for it may be a jump; a reading that jumps there and back is not.
    """
    side = max(1, round(PossibleSettings().moment / interval))
    total = np.cumsum(np.vstack([np.zeros(way.shape[1]), way]), axis=0)
    rows = np.arange(len(way))
    first, stop = np.maximum(rows - side, 0), np.minimum(rows + 1 + side, len(way))
    others = np.maximum(stop - first - 1, 1)[:, None] * interval
    return np.asarray((total[stop] - total[first] - way) / others)


def _renewed_after(way: Array, time: Array) -> Array:
    """Return (N, n) times, s, since each joint's position was another one than before (N, n) ways.

    What is not read anew with every sample goes all its way when it is.
    """
    read = np.where(way != 0.0, time[1:, None], time[0])
    last = np.maximum.accumulate(read, axis=0)
    return np.asarray(time[1:, None] - np.vstack([np.full(way.shape[1], time[0]), last[:-1]]))


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
