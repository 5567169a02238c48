"""Level of noise, and how many of its samples are independent."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.estimation.repetition import Labels, Repetition

LONGEST_CORRELATION = 2.0
"""s, of the correlations that are looked at. Chosen."""

_LEAST_PAIRS = 2.0  # s of motion seen twice, below which repetition gives no noise. Chosen


def autocorrelation(residual: Array, part: Labels, longest: int) -> Array:
    """Return (longest + 1, m) autocorrelations of (n, m) residuals, sums over all parts.

    Args:
        residual: Evenly sampled within each part.
        part: (n,) part of each sample.
        longest: Lag, samples.
    """
    total = np.zeros((longest + 1, residual.shape[1]))
    for index in np.unique(part):
        piece = residual[part == index]
        lags = min(longest + 1, len(piece))
        # Zeros beyond the end keep the circular products apart.
        power = np.abs(np.fft.rfft(piece, len(piece) + lags, axis=0)) ** 2
        total[:lags] += np.fft.irfft(power, len(piece) + lags, axis=0)[:lags]
    return total / np.maximum(total[0], 1e-300)


def correlation_time(residual: Array, part: Labels, longest: int) -> Array:
    """Return (m,) integrated correlation times in samples: 1 + 2 sum of autocorrelations.

    The sum stops at the first that is not positive (Geyer 1992).

    Args:
        residual: (n, m), evenly sampled within each part.
        part: (n,) part of each sample.
        longest: Lag looked at, samples.
    """
    rho = autocorrelation(residual, part, longest)
    positive = np.logical_and.accumulate(rho > 0.0, axis=0)
    return 1.0 + 2.0 * np.sum(np.where(positive, rho, 0.0)[1:], axis=0)


def intraclass_correlation(first: Array, second: Array, usable: Mask) -> Array:
    """Return (m,) correlation, at least 0, of (n, m) values with those of the same states later.

    ``usable`` is the (n, m) mask of the pairs that count.
    """
    square = np.where(usable, 0.5 * (first**2 + second**2), 0.0).sum(axis=0)
    product = np.where(usable, first * second, 0.0).sum(axis=0)
    return np.clip(product / np.maximum(square, 1e-300), 0.0, 1.0)


def design_effect(copies: float, correlation: Array) -> Array:
    """Return the (m,) design effect of states seen several times (Kish 1965).

    Args:
        copies: Mean number of times that a state is seen.
        correlation: (m,) intraclass correlation.
    """
    return 1.0 + (copies - 1.0) * correlation


def repetition_noise(repetition: Repetition, time: Array, residual: Array, usable: Mask) -> Array:
    """Return (m,) RMS of the (n, m) residual's part that does not recur after a period.

    The difference of two copies holds the noise of both, hence the square root of two. NaN where
    too little is seen twice.
    """
    from scipy.interpolate import CubicSpline

    step = float(np.median(np.diff(time)))
    later = time + repetition.period
    after = np.clip(np.searchsorted(time, later), 1, len(time) - 1)
    # Both neighbours of the moment a period later, and no gap between them.
    near = time[after] - time[after - 1] < 1.5 * step
    pair = usable & (usable[after] & usable[after - 1])
    pair &= (near & (later <= time[-1]))[:, None]
    difference = np.where(pair, CubicSpline(time, residual)(later) - residual, 0.0)
    count = pair.sum(axis=0)
    enough = count * step >= _LEAST_PAIRS
    square = 0.5 * (difference**2).sum(axis=0) / np.maximum(count, 1)
    return np.where(enough, np.sqrt(square), np.nan)


def band_noise(density: Array, cutoff: float) -> Array:
    """Return (m,) RMS of white noise behind a zero-phase second-order Butterworth low-pass.

    Args:
        density: (m,) of the noise, unit per sqrt(Hz).
        cutoff: Of each of the two passes, Hz.
    """
    frequency = np.linspace(0.0, 10.0 * cutoff, 4000)
    passed = np.mean(1.0 / (1.0 + (frequency / cutoff) ** 4) ** 2) * frequency[-1]
    return np.asarray(density * np.sqrt(passed))


def pairs_a_period_apart(
    time: Array, repetition: Repetition | None, near: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return (k,) indices of samples at (n,) times, s, and (k,) of those a period later.

    They may miss a period by ``near`` s.
    """
    if repetition is None:
        nothing = np.zeros(0, dtype=np.int64)
        return nothing, nothing
    order = np.argsort(time)
    later = time + repetition.period
    found = order[np.minimum(np.searchsorted(time[order], later), len(time) - 1)]
    close = np.abs(time[found] - later) < near
    return np.flatnonzero(close), found[close]
