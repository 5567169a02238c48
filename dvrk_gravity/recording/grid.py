"""Bringing a trajectory onto a uniform time grid: stale samples, gaps, jittering stamps."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arrays import Array
from dvrk_gravity.recording.filters import LowPass, derivative
from dvrk_gravity.recording.quantization import quantum
from dvrk_gravity.recording.sample_times import retimed
from dvrk_gravity.recording.samples import QUANTITIES, Samples, SamplesT, not_recorded


@dataclass(frozen=True)
class TimingSettings:
    """What is a gap, what is a uniform grid already, and what is a reading not renewed.

    Attributes:
        gap: Interval, in median ones, from which on samples are missing. Chosen: more than jitter
            makes of two lost samples.
        uniform: Part by which intervals of a uniform grid may differ. Chosen: rounding of stamps.
        on_grid: Intervals that a grid's points may be off. Chosen.
        moving: Way in one sample below which an unchanged reading proves nothing, rad. Chosen: less
            than a step of any encoder.
    """

    gap: float = 3.5
    uniform: float = 1e-4
    on_grid: float = 0.01
    moving: float = 1e-6


def speed(recording: Samples) -> Array:
    """Return a rough velocity ``(N, n)``, rad/s, from low-passed positions and nominal rate."""
    rate = recording.rate
    assert rate is not None
    return derivative(LowPass(rate / 20.0, rate)(recording.position), rate)


def stale(recording: Samples) -> NDArray[np.bool_]:
    """Return ``(N,)``: samples that repeat the one before, although the arm moves.

    At rest identical samples are what an arm should give. While a joint travels by more than two
    encoder steps a sample, they are readings that were not renewed.
    """
    result = np.zeros(len(recording), dtype=bool)
    rate = recording.rate
    if rate is None or len(recording) < 100:
        return result
    same = np.ones(len(recording) - 1, dtype=bool)
    for name in QUANTITIES:
        values = getattr(recording, name)
        if values is not None:
            own = ~not_recorded(values)
            same &= np.all(values[1:, own] == values[:-1, own], axis=1)
    if not same.any():
        return result
    steps = np.array([2.0 * quantum(column) for column in recording.position.T])
    travel = np.abs(speed(recording)) / rate
    moving = np.any(travel > np.maximum(steps, TimingSettings().moving), axis=1)
    result[1:] = same & moving[1:]
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
    """Return the parts between long intervals.

    Args:
        recording: What was recorded.
        longest: Interval that is no gap yet, s; default: ``TimingSettings.gap`` median ones.
    """
    if recording.time is None or len(recording) < 3:
        return (recording,)
    intervals = np.diff(recording.time)
    if longest is None:
        longest = TimingSettings().gap * float(np.median(intervals))
    ends = np.flatnonzero(intervals > longest) + 1
    edges = [0, *ends.tolist(), len(recording)]
    return tuple(recording.rows(slice(a, b)) for a, b in pairwise(edges))


def resample(recording: SamplesT, rate: float, origin: float | None = None) -> SamplesT:
    """Return the recording on a uniform grid from its first to its last sample.

    Samples that were taken off their stamps are put back first, see :func:`retimed`. A recording
    whose intervals are uniform then is returned as it is, if it lies on the grid.
    Values between samples come from Akima's piecewise cubics (Akima 1970): they follow curvature,
    and a step or an outlier disturbs only its neighbours, where a spline would ring on.

    Args:
        recording: With time, at least two samples.
        rate: Samples a second of the grid, Hz.
        origin: Time of a grid point, s, inside or outside the recording; default: its first sample.
    """
    from scipy.interpolate import Akima1DInterpolator

    recording = retimed(recording)
    time = recording.time
    assert time is not None
    ahead = 0.0 if origin is None else float((origin - time[0]) * rate)
    offset = ahead - round(ahead)
    settings = TimingSettings()
    uniform = np.all(np.abs(np.diff(time) * rate - 1.0) < settings.uniform)
    if abs(offset) < settings.on_grid and uniform:
        return recording
    begin = time[0] + (0.0 if abs(offset) < 1e-6 else offset % 1.0) / rate
    count = int(np.floor((time[-1] - begin) * rate + 1e-6)) + 1
    grid = np.clip(begin + np.arange(count) / rate, time[0], time[-1])

    def onto_grid(values: Array) -> Array:
        own = ~not_recorded(values)
        result = np.full((len(grid), values.shape[1]), np.nan)
        result[:, own] = Akima1DInterpolator(time, values[:, own], axis=0)(grid)
        return result

    direction = recording.direction
    if direction is not None:
        direction = direction[np.searchsorted(time, grid, side="right") - 1]
    return replace(
        recording,
        time=grid,
        position=onto_grid(recording.position),
        velocity=None if recording.velocity is None else onto_grid(recording.velocity),
        effort=None if recording.effort is None else onto_grid(recording.effort),
        direction=direction,
    )
