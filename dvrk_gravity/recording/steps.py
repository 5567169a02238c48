"""How far joints can go from one sample to the next, and what an arm can reach at most."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arms import FASTEST, UNTIMED_STEP, Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.recording.samples import Samples


@dataclass(frozen=True)
class StepSettings:
    """How far a joint can go from one sample to the next.

    Attributes:
        sudden: rad/s^2, by which a joint may be faster than a moment before. Chosen: it is at
            FASTEST in 25 ms, within five samples at 200 Hz.
        moment: s, on either side, whose speed tells how fast a joint moves. Chosen.
    """

    sudden: float = 1000.0
    moment: float = 0.1


def reachable(fresh: Samples) -> Array:
    """Return how far (N - 1, n) joints can have gone between two of N samples, rad or m.

    Args:
        fresh: Samples without stale ones.
    """
    assert fresh.time is not None
    interval, way = np.diff(fresh.time), np.diff(fresh.position, axis=0)
    late = float(np.median(interval)) if len(interval) else 0.0
    if late <= 0.0:  # one sample, or stamps of which most repeat others
        return np.full(way.shape, np.inf)
    within = interval[:, None] + late
    speeding = StepSettings().sudden * within**2 * fresh.scale
    going_on = speed_around(np.abs(way), late) * (_renewed_after(way, fresh.time) + late)
    reach = np.minimum(going_on + speeding, FASTEST * within * fresh.scale)
    return np.asarray(reach + UNTIMED_STEP * fresh.scale)


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


def speed_around(way: Array, interval: float) -> Array:
    """Return (N, n) speeds just before and after each of (N, n) ways between two samples.

    The way itself is left out, for it may be a jump; a reading that jumps there and back is not.
    """
    side = max(1, round(StepSettings().moment / interval))
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
