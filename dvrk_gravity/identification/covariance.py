"""How certain the coefficients are when the residual is no white noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dvrk_gravity.identification.moments import Design
from dvrk_gravity.identification.regression import Solution, autocorrelation
from dvrk_gravity.recording.data import Array

LONGEST = 1.5  # s, of the residual's autocorrelation
NORMAL_95 = 1.959964
# A coefficient counts as determined by the data if the ridge can be expected to have moved it by
# no more than this part of its standard deviation.
PRIOR_SHARE = 0.5


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Covariance of the coefficients.

    Attributes:
        covariance: (p, p), from noise.
        bias: (p, p) second moment of what the ridge can be expected to have moved.
    """

    covariance: Array
    bias: Array

    def interval(self, value: float, direction: Array) -> tuple[float, float]:
        """Return the 95 % interval of a (p,) combination of the coefficients."""
        variance = float(direction @ (self.covariance + self.bias) @ direction)
        half = NORMAL_95 * max(variance, 0.0) ** 0.5
        return value - half, value + half

    def identifiable(self, direction: Array) -> bool:
        """Tell whether data, not the ridge, determine a (p,) combination."""
        noise = direction @ self.covariance @ direction
        bias = direction @ self.bias @ direction
        return bool(noise > 0.0 and bias <= PRIOR_SHARE**2 * noise)

    def correlation(self, first: Array, second: Array) -> float:
        """Return the correlation of two (p,) combinations."""
        total = self.covariance + self.bias
        scale = (first @ total @ first) * (second @ total @ second)
        return float(first @ total @ second / np.sqrt(scale)) if scale > 0.0 else 0.0


def uncertainty(
    design: Design,
    chosen: Sequence[int],
    solution: Solution,
    residual: Array,
    held_out: Array,
    weight: Array,
) -> Uncertainty:
    """Return the sandwich covariance P^-1 (X' W R W X) P^-1 of a weighted ridge fit.

    R holds the residual's own autocorrelation, motor by motor, tapered (Parzen) to zero at
    1.5 s (Newey and West 1987; Andrews 1991). Its variance is the mean product of a residual
    with the same sample's residual when held out: a fit bends itself towards the noise that it
    has seen, so the first is too small, the second too large by the same factor, and the product
    is unbiased (the leave-out estimate of Kline, Saggio and Sølvsten 2020; HC2 and HC3 of
    MacKinnon and White 1985 lie on either side).

    Args:
        design: The samples.
        chosen: Columns of the fit.
        solution: The fit.
        residual: (n, 7) N·m, of the fit, times the samples' robust weights.
        held_out: (n, 7) N·m, of fits that had not seen the sample, weighted in the same way.
        weight: (7,) inverse variance of one sample of each motor, correlation included.
    """
    longest = int(LONGEST * design.rate)
    rho = autocorrelation(held_out, design.part, longest) * _parzen(longest)[:, None]
    product = np.mean(residual * held_out, axis=0, where=design.measured)
    variance = np.maximum(product, 0.0)
    meat = np.zeros_like(solution.data)
    index = list(chosen)
    for j in range(residual.shape[1]):
        for part in np.unique(design.part):
            columns = design.x[design.part == part, j][:, index]
            smoothed = _convolve(columns, rho[:, j])
            meat += weight[j] ** 2 * variance[j] * (columns.T @ smoothed)
    inverse = np.zeros_like(meat)
    free = np.flatnonzero(solution.free)
    grid = np.ix_(free, free)
    inverse[grid] = np.linalg.inv(solution.precision[grid])
    prior = solution.precision - solution.data
    return Uncertainty(inverse @ meat @ inverse, inverse @ prior @ inverse)


def _parzen(longest: int) -> Array:
    u = np.arange(longest + 1) / (longest + 1)
    return np.where(u <= 0.5, 1.0 - 6.0 * u**2 + 6.0 * u**3, 2.0 * (1.0 - u) ** 3)


def _convolve(columns: Array, rho: Array) -> Array:
    """Return R @ columns for the symmetric Toeplitz matrix R of autocorrelations."""
    from scipy.signal import oaconvolve

    kernel = np.concatenate([rho[:0:-1], rho])[:, None]
    return np.asarray(oaconvolve(columns, kernel, mode="same", axes=0))
