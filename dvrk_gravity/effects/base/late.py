"""Torques as they were a while before."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from dvrk_gravity.effects.base.evidence import Motion

Array = NDArray[np.float64]

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


def slope_by_delay(motion: Motion, torque: Array, late: float = 0.0) -> Array:
    """Return (N, n) how a torque changes with its delay, N·m/s: minus its slope, so long before.

    Over a while, in which noise is nearly gone: in a column it makes a delay look smaller, and
    surer, than it is.
    """
    further, before = (shifted(motion, torque, late + way) for way in (_WHILE, -_WHILE))
    return (further - before) / (2.0 * _WHILE)


def mean_slope_by_delay(motion: Motion, delay: float = 0.0) -> Array:
    """Return (N, n) the same of efforts and reference, their mean, laid over each other.

    Args:
        motion: N samples with a reference.
        delay: By which the efforts are late, s.
    """
    assert motion.reference is not None
    efforts = slope_by_delay(motion, motion.effort, -0.5 * delay)
    return 0.5 * (efforts + slope_by_delay(motion, motion.reference, 0.5 * delay))
