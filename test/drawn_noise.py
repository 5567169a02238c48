"""Noise that is drawn, and the bounds on what is counted in draws."""

from __future__ import annotations

import numpy as np
from scipy import stats
from scipy.signal import lfilter


def coloured(random: np.random.Generator, shape: tuple[int, ...], a: float) -> np.ndarray:
    """Draw AR(1) noise of variance one along the first axis."""
    noise = random.normal(size=(shape[0] + 200, *shape[1:]))
    return lfilter([np.sqrt(1.0 - a * a)], [1.0, -a], noise, axis=0)[200:]


def band(share: float, count: int) -> tuple[float, float]:
    """Return within which a count's share lies in 99.9 % of all cases."""
    low, high = stats.binom.interval(0.999, count, share)
    return low / count, high / count
