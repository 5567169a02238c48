"""When were samples taken, if not at their stamps?

A console that reads its arm at one time and stamps the reading at another leaves a jitter that all
joints share. Positions tell it: between two readings every joint went its velocity times the
same interval. With encoders of 1e-5 rad and joints at 1 rad/s that interval is known to some 10 us.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dvrk_gravity.recording.data import Array, Recording
from dvrk_gravity.recording.filters import LowPass
from dvrk_gravity.recording.quantization import quantum

SLOWEST = 1.0  # Hz; slower wander is left to the stamps: velocities are off by a percent or two
SLOPE_TOLERANCE = 0.03  # of a velocity column against positions, to be of use here
LEAST_SHIFT = 0.1  # of the sampling interval, RMS; less is not worth a correction
EXPLAINED = 0.5  # share of the disagreement that one common jitter must explain
NEVER = 0.04  # of the sampling interval: readings closer than this are one


def retimed(recording: Recording) -> Recording:
    """Return the recording with its samples at the times at which they were taken.

    It is returned as it is without velocities, if it is too short, and where no jitter
    common to all joints explains at least half of the disagreement of positions and velocities.
    Samples that turn out to be almost simultaneous with the one before are left out.

    Args:
        recording: With time, without gaps and stale samples.
    """
    time, velocity, rate = recording.time, recording.velocity, recording.rate
    if time is None or velocity is None or rate is None or rate <= 4.0 * SLOWEST:
        return recording
    low = LowPass(SLOWEST, rate)
    grid = np.arange(time[0], time[-1], 1.0 / rate)
    if len(grid) <= 2 * low.edge:
        return recording
    stamped = np.diff(time)
    found = _intervals(recording.position, velocity, stamped, 1.0 / rate)
    if found is None:
        return recording
    late = np.append(0.0, np.cumsum(found - stamped))
    late -= np.interp(time, grid, low(np.interp(grid, time, late)))
    if np.std(late) * rate < LEAST_SHIFT:
        return recording
    taken = time + late
    before = np.append(-np.inf, np.maximum.accumulate(taken)[:-1])
    kept = taken > before + NEVER / rate
    return replace(recording.rows(kept), time=taken[kept])


def _intervals(position: Array, velocity: Array, stamped: Array, nominal: float) -> Array | None:
    """Return (N - 1,) intervals on which joints agree; ``None`` if stamps do as well.

    Weighted least squares over the joints, with the stamped interval as a weak prior.
    """
    way, mean = np.diff(position, axis=0), 0.5 * (velocity[1:] + velocity[:-1])
    expected = mean * stamped[:, None]
    power = np.sum(expected**2, axis=0)
    slope = np.sum(way * expected, axis=0) / np.where(power > 0.0, power, 1.0)
    step = np.array([quantum(column) for column in position.T])
    # Without steps the joints' noise is unknown: a hundredth of the typical way.
    noise = np.where(step > 0.0, step / np.sqrt(6.0), 0.01 * np.std(way, axis=0))
    used = (np.abs(slope - 1.0) < SLOPE_TOLERANCE) & (noise > 0.0)
    if used.sum() < 2:
        return None
    way, mean, weight = way[:, used], mean[:, used], noise[used] ** -2
    prior = (0.5 * nominal) ** -2
    known = (mean**2) @ weight
    intervals = ((way * mean) @ weight + prior * stamped) / (known + prior)
    left, before = (
        ((way - mean * one[:, None]) ** 2 @ weight).sum() for one in (intervals, stamped)
    )
    return np.asarray(intervals) if left < (1.0 - EXPLAINED) * before else None
