"""Time of a trajectory: stale samples, gaps, jittering stamps; onto a uniform grid.

A console that reads its arm at one time and stamps the reading at another leaves a jitter that all
joints share. Positions show it: between two readings every joint moves by its velocity times the
same interval. With encoders of 1e-5 rad and joints at 1 rad/s that interval is known to some 10 us.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arrays import Array
from dvrk_gravity.recording.filters import LowPass, derivative
from dvrk_gravity.recording.quantization import quantum
from dvrk_gravity.recording.samples import QUANTITIES, Samples, SamplesT, not_recorded


@dataclass(frozen=True)
class TimingSettings:
    """Thresholds of gaps, uniform grids and stale samples.

    Attributes:
        gap: Interval, in median ones, beyond which samples are missing. Chosen: more than jitter
            makes of two lost samples.
        uniform: Part by which intervals of a uniform grid may differ. Chosen: rounding of stamps.
        moving: Way in one sample below which an unchanged reading proves nothing, rad. Chosen: less
            than a step of any encoder.
    """

    gap: float = 3.5
    uniform: float = 1e-4
    moving: float = 1e-6


SLOWEST_JITTER = 1.0  # Hz; slower wander is left to the stamps: velocities are off by a percent
_SLOPE = 0.03  # relative error of a velocity column against positions, to be of use. Chosen
_LEAST_SHIFT = 0.1  # RMS, in sampling intervals; less is not worth a correction. Chosen
_EXPLAINED = 0.5  # part of the disagreement that one common jitter must explain. Chosen: most
_NEVER = 0.04  # sampling intervals; readings closer than this are the same reading. Chosen


def speed(recording: Samples) -> Array:
    """Return a rough velocity ``(N, n)``, rad/s, from low-passed positions and nominal rate."""
    rate = recording.rate
    assert rate is not None
    return derivative(LowPass(rate / 20.0, rate)(recording.position), rate)


def moving(recording: Samples) -> NDArray[np.bool_]:
    """Return (N, n) where a joint travels by more than two encoder steps a sample."""
    rate = recording.rate
    assert rate is not None
    steps = np.array([2.0 * quantum(column) for column in recording.position.T])
    travel = np.abs(speed(recording)) / rate
    return np.asarray(travel > np.maximum(steps, TimingSettings().moving))


def stale(recording: Samples) -> NDArray[np.bool_]:
    """Return the (N,) mask of samples that repeat the one before although the arm moves.

    At rest, identical samples are correct. While a joint travels by more than two encoder steps a
    sample, they are readings that were not renewed.
    """
    result = np.zeros(len(recording), dtype=bool)
    rate = recording.rate
    if rate is None or len(recording) < 100:
        return result
    same = np.ones(len(recording) - 1, dtype=bool)
    for name, values in recording.arrays().items():
        if name in QUANTITIES:
            own = ~not_recorded(values)
            same &= np.all(values[1:, own] == values[:-1, own], axis=1)
    if not same.any():
        return result
    result[1:] = same & moving(recording)[1:].any(axis=1)
    return result


def longest_bridged(rate: float, band: float) -> float:
    """Return the longest interval, s, that may be interpolated over in signals used below a band.

    One time constant 1 / (2 pi band) of the low-pass. Between samples T apart a cubic with the
    right slopes is off by at most T^4 / 384 of the fourth derivative (de Boor 2001, ch. IV): 0.26 %
    of a sine at the band's edge, where the filter takes half of it, and less below. What jitter
    can be, ``TimingSettings.gap`` intervals, is never a gap.

    Args:
        rate: Samples a second, Hz.
        band: Cut-off of the low-pass that goes over the signals, Hz.
    """
    return max(TimingSettings().gap / rate, 1.0 / (2.0 * np.pi * band))


def split_at_gaps(recording: SamplesT, longest: float | None = None) -> tuple[SamplesT, ...]:
    """Return the parts between intervals beyond ``longest`` s, by default ``gap`` median ones."""
    if recording.time is None or len(recording) < 3:
        return (recording,)
    intervals = np.diff(recording.time)
    if longest is None:
        longest = TimingSettings().gap * float(np.median(intervals))
    ends = np.flatnonzero(intervals > longest) + 1
    edges = [0, *ends.tolist(), len(recording)]
    return tuple(recording.rows(slice(a, b)) for a, b in pairwise(edges))


def retimed(recording: SamplesT) -> SamplesT:
    """Return a recording without gaps and stale samples, each sample at the time of its reading.

    It is unchanged without velocities, if it is too short, or if no jitter common to all joints
    explains at least half of the disagreement of positions and velocities. Samples almost
    simultaneous with the one before are left out.
    """
    time, velocity, rate = recording.time, recording.velocity, recording.rate
    if time is None or velocity is None or rate is None or rate <= 4.0 * SLOWEST_JITTER:
        return recording
    low = LowPass(SLOWEST_JITTER, rate)
    grid = np.arange(time[0], time[-1], 1.0 / rate)
    if len(grid) <= 2 * low.edge:
        return recording
    stamped = np.diff(time)
    found = _intervals(recording.position, velocity, stamped, 1.0 / rate)
    if found is None:
        return recording
    late = np.append(0.0, np.cumsum(found - stamped))
    late -= np.interp(time, grid, low(np.interp(grid, time, late)))
    if np.std(late) * rate < _LEAST_SHIFT:
        return recording
    taken = time + late
    before = np.append(-np.inf, np.maximum.accumulate(taken)[:-1])
    kept = taken > before + _NEVER / rate
    return replace(recording.rows(kept), time=taken[kept])


def _intervals(position: Array, velocity: Array, stamped: Array, nominal: float) -> Array | None:
    """Return (N - 1,) intervals on which joints agree; ``None`` if the stamps are as good.

    Weighted least squares over the joints, with the stamped interval as a weak prior.
    """
    way, mean = np.diff(position, axis=0), 0.5 * (velocity[1:] + velocity[:-1])
    expected = mean * stamped[:, None]
    power = np.sum(expected**2, axis=0)
    slope = np.sum(way * expected, axis=0) / np.where(power > 0.0, power, 1.0)
    step = np.array([quantum(column) for column in position.T])
    # Without steps the joints' noise is unknown: a hundredth of the typical way.
    noise = np.where(step > 0.0, step / np.sqrt(6.0), 0.01 * np.std(way, axis=0))
    used = (np.abs(slope - 1.0) < _SLOPE) & (noise > 0.0)
    if used.sum() < 2:
        return None
    way, mean, weight = way[:, used], mean[:, used], noise[used] ** -2
    prior = (0.5 * nominal) ** -2
    known = (mean**2) @ weight
    intervals = ((way * mean) @ weight + prior * stamped) / (known + prior)
    residual, before = (
        ((way - mean * interval[:, None]) ** 2 @ weight).sum() for interval in (intervals, stamped)
    )
    return np.asarray(intervals) if residual < (1.0 - _EXPLAINED) * before else None


def resample(recording: SamplesT, rate: float) -> SamplesT:
    """Return the recording on a uniform grid from its first to its last sample.

    Jitter is removed first (:func:`retimed`). A recording that lies on the grid then is returned
    unchanged. Values between samples come from Akima's piecewise cubics (Akima 1970): they follow
    curvature, and a step or an outlier disturbs only its neighbours, where a spline would ring on.

    Args:
        recording: With time, at least two samples.
        rate: Samples a second of the grid, Hz.
    """
    from scipy.interpolate import Akima1DInterpolator

    recording = retimed(recording)
    time = recording.time
    assert time is not None
    if np.all(np.abs(np.diff(time) * rate - 1.0) < TimingSettings().uniform):
        return recording
    count = int(np.floor((time[-1] - time[0]) * rate + 1e-6)) + 1
    grid = np.minimum(time[0] + np.arange(count) / rate, time[-1])

    def onto_grid(values: Array) -> Array:
        own = ~not_recorded(values)
        result = np.full((len(grid), values.shape[1]), np.nan)
        result[:, own] = Akima1DInterpolator(time, values[:, own], axis=0)(grid)
        return result

    direction = recording.direction
    if direction is not None:
        direction = direction[np.searchsorted(time, grid, side="right") - 1]
    arrays: dict[str, Any] = {
        name: onto_grid(values) for name, values in recording.arrays().items() if name in QUANTITIES
    }
    return replace(recording, time=grid, direction=direction, **arrays)
