"""When were samples taken, if not at their stamps?

A console that reads its arm at one time and stamps the reading at another leaves a jitter that all
joints share. Positions tell it: between two readings every joint went its velocity times the
same interval. With encoders of 1e-5 rad and joints at 1 rad/s that interval is known to some 10 us.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.recording.filters import LowPass
from dvrk_gravity.recording.quantization import quantum
from dvrk_gravity.recording.samples import SamplesT


@dataclass(frozen=True)
class RetimingSettings:
    """When samples are put back to the times at which they were taken.

    Attributes:
        slowest: Hz; slower wander is left to the stamps: velocities are off by a percent or two.
            Chosen.
        slope: Relative error of a velocity column against positions, to be of use here. Chosen.
        least_shift: RMS shift, in sampling intervals; less is not worth a correction. Chosen.
        explained: Part of the disagreement that one common jitter must explain. Chosen: most.
        never: Sampling intervals; readings closer than this are one. Chosen.
    """

    slowest: float = 1.0
    slope: float = 0.03
    least_shift: float = 0.1
    explained: float = 0.5
    never: float = 0.04


def retimed(recording: SamplesT) -> SamplesT:
    """Return the recording with its samples at the times at which they were taken.

    It is returned as it is without velocities, if it is too short, and where no jitter
    common to all joints explains at least half of the disagreement of positions and velocities.
    Samples that turn out to be almost simultaneous with the one before are left out.

    Args:
        recording: With time, without gaps and stale samples.
    """
    settings = RetimingSettings()
    time, velocity, rate = recording.time, recording.velocity, recording.rate
    if time is None or velocity is None or rate is None or rate <= 4.0 * settings.slowest:
        return recording
    low = LowPass(settings.slowest, rate)
    grid = np.arange(time[0], time[-1], 1.0 / rate)
    if len(grid) <= 2 * low.edge:
        return recording
    stamped = np.diff(time)
    found = _intervals(recording.position, velocity, stamped, 1.0 / rate)
    if found is None:
        return recording
    late = np.append(0.0, np.cumsum(found - stamped))
    late -= np.interp(time, grid, low(np.interp(grid, time, late)))
    if np.std(late) * rate < settings.least_shift:
        return recording
    taken = time + late
    before = np.append(-np.inf, np.maximum.accumulate(taken)[:-1])
    kept = taken > before + settings.never / rate
    return replace(recording.rows(kept), time=taken[kept])


def _intervals(position: Array, velocity: Array, stamped: Array, nominal: float) -> Array | None:
    """Return (N - 1,) intervals on which joints agree; ``None`` if stamps do as well.

    Weighted least squares over the joints, with the stamped interval as a weak prior.
    """
    settings = RetimingSettings()
    way, mean = np.diff(position, axis=0), 0.5 * (velocity[1:] + velocity[:-1])
    expected = mean * stamped[:, None]
    power = np.sum(expected**2, axis=0)
    slope = np.sum(way * expected, axis=0) / np.where(power > 0.0, power, 1.0)
    step = np.array([quantum(column) for column in position.T])
    # Without steps the joints' noise is unknown: a hundredth of the typical way.
    noise = np.where(step > 0.0, step / np.sqrt(6.0), 0.01 * np.std(way, axis=0))
    used = (np.abs(slope - 1.0) < settings.slope) & (noise > 0.0)
    if used.sum() < 2:
        return None
    way, mean, weight = way[:, used], mean[:, used], noise[used] ** -2
    prior = (0.5 * nominal) ** -2
    known = (mean**2) @ weight
    intervals = ((way * mean) @ weight + prior * stamped) / (known + prior)
    residual, before = (
        ((way - mean * interval[:, None]) ** 2 @ weight).sum() for interval in (intervals, stamped)
    )
    return np.asarray(intervals) if residual < (1.0 - settings.explained) * before else None
