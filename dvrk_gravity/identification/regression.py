"""Regularised, weighted least squares on Gram matrices, with signs kept."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.identification.moments import Moments
from dvrk_gravity.recording.data import Array

ROUNDS = 4  # of weights from residuals; the weights settle after two or three
HUBER = 2.5  # standard deviations beyond which a residual counts linearly


@dataclass(frozen=True, eq=False)
class Solution:
    """A fit.

    Attributes:
        theta: (p,) coefficients.
        precision: (p, p) weighted Gram matrix and prior together; rows of coefficients that are
            held at zero by their sign are those of the prior only.
        data: (p, p) weighted Gram matrix alone.
        free: (p,) mask of the coefficients not held at zero.
    """

    theta: Array
    precision: Array
    data: Array
    free: NDArray[np.bool_]


def solve(moments: Moments, weight: Array, scale: Array, positive: NDArray[np.bool_]) -> Solution:
    """Minimise sum_j weight_j |y_j - X_j theta|^2 + |theta / scale|^2, signs kept.

    Args:
        moments: Of p columns.
        weight: (7,) inverse variance of one sample of each motor, correlation included.
        scale: (p,) prior standard deviations: ridge towards zero where data are silent.
        positive: (p,) mask of coefficients that must not be negative.
    """
    data = np.tensordot(weight, moments.gram, 1)
    right = weight @ moments.cross
    precision = data + np.diag(1.0 / scale**2)
    theta, free = solve_signed(precision, right, positive)
    return Solution(theta, precision, data, free)


def solve_signed(
    precision: Array, right: Array, positive: NDArray[np.bool_]
) -> tuple[Array, NDArray[np.bool_]]:
    """Solve a symmetric positive definite system with some unknowns held from below zero.

    Coefficients that come out negative are held at zero; one that would then grow again is
    released (active set).

    Returns:
        The (p,) solution and the mask of those not held.
    """
    from scipy.linalg import cho_factor, cho_solve

    free = np.ones(len(right), dtype=bool)
    theta = np.zeros_like(right)
    for _ in range(20):
        theta[:] = 0.0
        index = np.flatnonzero(free)
        factor = cho_factor(precision[np.ix_(index, index)], check_finite=False)
        theta[index] = cho_solve(factor, right[index], check_finite=False)
        wrong = positive & (theta < 0.0)
        gradient = right - precision @ theta
        release = ~free & (gradient > 0.0)
        if not wrong.any() and not release.any():
            break
        # Releasing only when nothing is wrong keeps the loop from going in circles.
        free = free & ~wrong if wrong.any() else free | release
    return np.where(positive, np.maximum(theta, 0.0), theta), free


def huber_weights(residual: Array) -> Array:
    """Return (n, 7) weights of a robust loss (Huber 1964) from (n, 7) residuals.

    The spread of each motor's residuals is 1.4826 times their median absolute value.
    """
    spread = 1.4826 * np.median(np.abs(residual), axis=0)
    limit = HUBER * np.maximum(spread, 1e-12)
    return np.minimum(1.0, limit / np.maximum(np.abs(residual), 1e-12))


def correlation_time(residual: Array, part: NDArray[np.int64], longest: int) -> Array:
    """Return (7,) number of samples that count as one: 1 + 2 sum of autocorrelations.

    Args:
        residual: (n, 7), evenly sampled within each part.
        part: (n,) part of each sample.
        longest: Lags looked at; the sum stops at the first negative one (Geyer 1992).
    """
    rho = autocorrelation(residual, part, longest)
    positive = np.logical_and.accumulate(rho > 0.0, axis=0)
    return 1.0 + 2.0 * np.sum(np.where(positive, rho, 0.0)[1:], axis=0)


def autocorrelation(residual: Array, part: NDArray[np.int64], longest: int) -> Array:
    """Return (longest + 1, 7) autocorrelations, sums over all parts."""
    total = np.zeros((longest + 1, residual.shape[1]))
    for index in np.unique(part):
        one = residual[part == index]
        for lag in range(min(longest + 1, len(one))):
            total[lag] += np.sum(one[lag:] * one[: len(one) - lag], axis=0)
    return total / np.maximum(total[0], 1e-300)
