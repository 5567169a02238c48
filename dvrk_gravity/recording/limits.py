"""Limits of arms: how far joints reach and step, how hard motors pull; readings beyond them."""

from __future__ import annotations

import numpy as np

from dvrk_gravity.arms import FASTEST, UNTIMED_STEP, Arm
from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.recording.notes import Note
from dvrk_gravity.recording.position_unit import ENDLESS, other_units
from dvrk_gravity.recording.samples import Samples
from dvrk_gravity.recording.timing import stale

# Way below which a joint did not move, rad (2 mm where it slides). Chosen: about 1 deg, more than a
# servo that holds moves by.
STILL = 0.02
# rad/s^2, by which a joint may be faster than a moment before. Chosen: it is at FASTEST in 25 ms,
# within five samples at 200 Hz.
_SUDDEN = 1000.0
MOMENT = 0.1  # s, on either side, over which a joint's speed is measured. Chosen
# Multiple of a joint's range beyond which a position is in another unit. Chosen between the error
# of a zero and the 57 of degrees.
_POSITION_MARGIN = 2.5
# Multiple of a motor's limit beyond which an effort is in another unit. Chosen between what a peak
# may exceed a limit by and the 1000 of mN·m.
EFFORT_MARGIN = 10.0


def position_unit(recording: Samples, joint: str) -> str:
    """Return the unit of a joint's position; of an unknown arm, that of a revolute joint."""
    arm = recording.arm
    return "rad" if arm is None else arm.units[arm.joint_names.index(joint)]


def effort_unit(recording: Samples, joint: str) -> str:
    """Return the unit of a joint's effort; of an unknown arm, that of a revolute joint."""
    arm = recording.arm
    return "N·m" if arm is None else arm.effort_units[arm.joint_names.index(joint)]


def largest(arm: Arm) -> tuple[dict[str, float], dict[str, float]]:
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


def beyond_reach(recording: Samples, arm: Arm) -> Mask:
    """Return (N, n) positions so far beyond an arm's reach that they are in another unit."""
    reach, _ = largest(arm)
    most = np.array([min(reach[name], ENDLESS) for name in recording.joints])
    return np.asarray(np.abs(recording.position) > _POSITION_MARGIN * most)


def beyond_the_arm(recording: Samples) -> list[Note]:
    """Return findings about numbers beyond the arm's reach: they are in another unit."""
    arm = recording.arm
    if arm is None:
        return []
    reach, strength = largest(arm)
    findings = []
    peaks = np.max(np.abs(recording.position), axis=0)
    beyond = np.asarray(beyond_reach(recording, arm).any(axis=0))
    others = other_units(recording, beyond) if beyond.any() else ""
    for column, name in enumerate(recording.joints):
        joint = arm.joints[arm.joint_names.index(name)]
        if beyond[column]:
            peak = float(peaks[column])
            numbers = {"largest": peak, "plausible": reach[name]}
            text = f"position up to {peak:.4g}, an arm reaches {reach[name]:g}: expected "
            same = [other for other in arm.joints if other.unit == joint.unit]
            if peak <= max(min(reach[other.name], ENDLESS) for other in same):
                text += f"{joint.unit}, and the columns of the right joints"
                findings.append(Note("exchanged_joints", name, numbers, text))
            else:
                text += others
                findings.append(Note("position_unit", name, numbers, text, unusable=True))
        if recording.effort is None:
            continue
        peak = float(np.max(np.abs(recording.effort[:, column])))
        if peak <= EFFORT_MARGIN * strength[name]:
            continue
        numbers = {"largest": peak, "plausible": strength[name]}
        text = f"effort up to {peak:.4g}, an arm reaches {strength[name]:g}: expected "
        if peak <= max(strength.values()):
            text += f"{joint.effort_unit}, and the columns of the right joints"
            findings.append(Note("exchanged_joints", name, numbers, text))
        else:
            text += f"{joint.effort_unit}, not m{joint.effort_unit}"
            if joint.effort_unit == "N·m":  # of a force no other unit is read
                text += f"; declare it for each such joint, --effort-unit {name}=mN·m"
            findings.append(Note("effort_unit", name, numbers, text, unusable=True))
    return findings


def reachable(fresh: Samples) -> Array:
    """Return the (N - 1, n) ways that joints can go between N samples, none of them stale."""
    assert fresh.time is not None
    interval, way = np.diff(fresh.time), np.diff(fresh.position, axis=0)
    late = float(np.median(interval)) if len(interval) else 0.0
    if late <= 0.0:  # one sample, or stamps of which most repeat others
        return np.full(way.shape, np.inf)
    within = interval[:, None] + late
    speeding = _SUDDEN * within**2 * fresh.scale
    going_on = _speed_around(np.abs(way), late) * (_renewed_after(way, fresh.time) + late)
    reach = np.minimum(going_on + speeding, FASTEST * within * fresh.scale)
    return np.asarray(reach + UNTIMED_STEP * fresh.scale)


def _speed_around(way: Array, interval: float) -> Array:
    """Return (N, n) speeds around each of (N, n) ways between two samples, that way left out."""
    side = max(1, round(MOMENT / interval))
    total = np.cumsum(np.vstack([np.zeros(way.shape[1]), way]), axis=0)
    rows = np.arange(len(way))
    first, stop = np.maximum(rows - side, 0), np.minimum(rows + 1 + side, len(way))
    others = np.maximum(stop - first - 1, 1)[:, None] * interval
    return np.asarray((total[stop] - total[first] - way) / others)


def _renewed_after(way: Array, time: Array) -> Array:
    """Return (N, n) times, s, since each joint's position was another one than before (N, n) ways.

    A reading that is not renewed with every sample makes all its way at once when it is.
    """
    read = np.where(way != 0.0, time[1:, None], time[0])
    last = np.maximum.accumulate(read, axis=0)
    return np.asarray(time[1:, None] - np.vstack([np.full(way.shape[1], time[0]), last[:-1]]))


def jumps(recording: Samples) -> list[Note]:
    """Return findings about ways that no joint can have gone between two samples."""
    # After stale samples the whole way comes at once.
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
            "a continuous angle, not wrapped"
            if wraps
            else f"less than {reach[row, joint]:.2g} {unit}; if it is a wrong reading, take its "
            "sample out"
        )
        before, after = fresh.position[row : row + 2, joint]
        others = f", the first of {len(rows)} jumps" if len(rows) > 1 else ""
        text = (
            f"position goes from {before:.4g} to {after:.4g} {unit} within "
            f"{1e3 * interval[row]:.3g} ms at {fresh.time[row + 1]:.9g} s{others}: "
            f"expected {expected}"
        )
        numbers = {"jumps": len(rows), f"way_{unit}": float(way[row, joint])}
        findings.append(Note("position_jump", name, numbers, text, unusable=True))
    return findings
