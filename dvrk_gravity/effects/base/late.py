"""Torques as they were a while before."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.evidence import Motion

_WHILE = 0.0625  # s; chosen: over twice that, half of 3.5 Hz is left, and nothing of 8


def shifted(motion: Motion, torque: Array, late: float) -> Array:
    """Return (N, n) a torque as it was so many seconds before, at the ends as it is there.

    By cubic splines: straight lines between samples are means, and take noise away.
    """
    result = np.empty_like(torque)
    for part in motion.parts:
        time = motion.time[part]
        then = np.clip(time - late, time[0], time[-1])
        result[part] = CubicSpline(time, torque[part], axis=0)(then)
    return result


def smoothed(motion: Motion, torque: Array) -> Array:
    """Return (N, n) the mean of a torque over a while about each sample, or what there is of it."""
    result = np.empty_like(torque)
    for part in motion.parts:
        sums = CubicSpline(motion.time[part], torque[part], axis=0).antiderivative()
        first, last = _while_about(motion.time[part], motion.time[part])
        result[part] = (sums(last) - sums(first)) / (last - first)[:, None]
    return result


def slope_by_delay(motion: Motion, torque: Array, late: float) -> Array:
    """Return (N, n) how a torque changes with its delay, N·m/s: minus its slope, so long before.

    Over a while, in which noise is nearly gone: in a column it makes a delay look smaller, and
    surer, than it is. Zero where all of that is outside what was recorded.
    """
    result = np.empty_like(torque)
    for part in motion.parts:
        time = motion.time[part]
        first, last = _while_about(time - late, time)
        spline = CubicSpline(time, torque[part], axis=0)
        length = np.where(last > first, last - first, np.inf)
        result[part] = (spline(first) - spline(last)) / length[:, None]
    return result


def _while_about(moments: Array, time: Array) -> tuple[Array, Array]:
    """Return (N,) when a while about some moments begins and ends, within recorded times."""
    first, last = (np.clip(moments + way, time[0], time[-1]) for way in (-_WHILE, _WHILE))
    return first, last


def mean_slope_by_delay(motion: Motion, delay: float = 0.0) -> Array:
    """Return (N, n) the same of efforts and reference, their mean, laid over each other.

    Args:
        motion: N samples with a reference.
        delay: By which the efforts are late, s.
    """
    assert motion.reference is not None
    efforts = slope_by_delay(motion, motion.effort, -0.5 * delay)
    return 0.5 * (efforts + slope_by_delay(motion, motion.reference, 0.5 * delay))
