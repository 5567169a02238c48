"""Unknown scales of channels: readings that are a sum of columns, each in a unit of its own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.estimation.noise import LONGEST_CORRELATION, correlation_time

_ROUNDS = 50  # Gauss-Newton steps, at most. Chosen: the problem is bilinear, and ten do
_UNKNOWN = 10.0  # relative prior standard deviation of a scale. Chosen: as good as none
_CONVERGED = 1e-6  # relative change of the scales. Chosen: a thousandth of their uncertainty


@dataclass(frozen=True, eq=False)
class Scales:
    """Scales of channels, and the coefficients solved for with them.

    Attributes:
        gain: (m,) columns' units per unit of each channel's reading.
        error: (m,) relative standard errors, with the residual's autocorrelation.
        theta: (p,) coefficients of the shared columns.
        residual: (n, m) readings minus prediction, in the readings' units.
    """

    gain: Array
    error: Array
    theta: Array
    residual: Array


def solve_scales(
    reading: Array, known: Array, shared: Array, shared_scale: Array, own: Array,
    own_scale: Array, rate: float, guess: Array,
) -> Scales:  # fmt: skip
    """Solve ``reading = (known + shared theta) / gain + own phi + noise`` for gain, theta and phi.

    By Gauss-Newton steps. The noise is the readings', so the gain divides the *prediction*;
    regressing the torque on the readings would bias every gain towards zero by their noise (errors
    in variables).

    Args:
        reading: (n, m).
        known: (n, m) known part of the prediction, which sets the scale.
        shared: (n, m, p) columns of the unknown part.
        shared_scale: (p,) prior standard deviations of theta.
        own: (n, m, q) columns in the readings' units.
        own_scale: (m, q) prior standard deviations of phi.
        rate: Samples a second.
        guess: (m,) initial gains.
    """
    m, p, q = reading.shape[1], shared.shape[2], own.shape[2]
    part = np.zeros(len(reading), dtype=np.int64)
    inverse = 1.0 / guess
    theta, phi = np.zeros(p), np.zeros((m, q))
    spread = np.maximum(reading.std(axis=0), 1e-12)
    longest = int(LONGEST_CORRELATION * rate)
    correlated = np.ones(m)
    of_scale = (_UNKNOWN * inverse) ** -2.0
    prior = np.concatenate([shared_scale**-2.0, own_scale.ravel() ** -2.0, of_scale])
    mean = np.concatenate([np.zeros(p + m * q), inverse])
    covariance = np.eye(len(prior))
    for round_ in range(_ROUNDS):
        torque = known + shared @ theta
        residual = reading - torque * inverse - np.einsum("nmq,mq->nm", own, phi)
        if round_ > 1:
            spread = np.maximum(residual.std(axis=0), 1e-12)
            correlated = correlation_time(residual, part, longest)
        weight = 1.0 / (spread * np.sqrt(correlated))
        here = np.concatenate([theta, phi.ravel(), inverse])
        precision, right = np.diag(prior), prior * (mean - here)
        for j in range(m):  # a channel at a time: the columns of its own are no others'
            columns = np.zeros((len(reading), len(prior)))
            columns[:, :p] = shared[:, j] * inverse[j]
            columns[:, p + j * q : p + (j + 1) * q] = own[:, j]
            columns[:, p + m * q + j] = torque[:, j]
            columns *= weight[j]
            precision += columns.T @ columns
            right += columns.T @ (residual[:, j] * weight[j])
        unit = 1.0 / np.sqrt(np.diag(precision))  # scaled to a diagonal of ones
        scaled = np.linalg.inv(precision * np.outer(unit, unit))
        covariance = scaled * np.outer(unit, unit)
        step = covariance @ right
        theta, phi = theta + step[:p], phi + step[p : p + m * q].reshape(m, q)
        change = step[p + m * q :]
        inverse = inverse + change
        if round_ > 2 and np.all(np.abs(change) < _CONVERGED * np.abs(inverse)):
            break
    torque = known + shared @ theta
    residual = reading - torque * inverse - np.einsum("nmq,mq->nm", own, phi)
    deviation = np.sqrt(np.maximum(np.diag(covariance)[p + m * q :], 0.0))
    return Scales(1.0 / inverse, deviation / np.abs(inverse), theta, residual)
