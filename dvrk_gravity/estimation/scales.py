"""Unknown scales of channels: readings that are a sum of columns, each in a unit of its own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.estimation.noise import NoiseSettings, correlation_time


@dataclass(frozen=True)
class ScaleSettings:
    """How scales are solved for.

    Attributes:
        rounds: Gauss-Newton steps, at most. Chosen: the problem is bilinear, and ten do.
        unknown: Relative standard deviation of a scale before any data. Chosen: as good as none.
        tolerance: Relative change of the scales by which they count as found. Chosen: a thousandth
            of what data can tell.
    """

    rounds: int = 50
    unknown: float = 10.0
    tolerance: float = 1e-6


@dataclass(frozen=True, eq=False)
class Scales:
    """Scales of channels, and what was solved for with them.

    Attributes:
        gain: (m,) what a unit of each channel's reading is in the columns' unit.
        error: (m,) relative standard errors, the residual's autocorrelation respected.
        theta: (p,) coefficients of the shared columns.
        residual: (n, m) readings minus prediction, in the readings' units.
    """

    gain: Array
    error: Array
    theta: Array
    residual: Array


def solve_scales(
    reading: Array,
    known: Array,
    shared: Array,
    shared_scale: Array,
    own: Array,
    own_scale: Array,
    rate: float,
    guess: Array,
    settings: ScaleSettings | None = None,
) -> Scales:
    """Solve ``reading = (known + shared theta) / gain + own phi + noise`` for gain, theta and phi.

    By Gauss-Newton steps: the noise is the readings', so that the *prediction*, not the reading, is
    what the gain multiplies; regressing the torque on the readings would bias every gain towards
    zero by their noise (errors in variables).

    Args:
        reading: (n, m).
        known: (n, m) the part that is known, which sets the scale.
        shared: (n, m, p) columns of what is not.
        shared_scale: (p,) prior standard deviations of theta.
        own: (n, m, q) columns in the readings' units.
        own_scale: (m, q) prior standard deviations of phi.
        rate: Samples a second.
        guess: (m,) gains to begin with.
        settings: When it ends.
    """
    settings = settings or ScaleSettings()
    m, p, q = reading.shape[1], shared.shape[2], own.shape[2]
    part = np.zeros(len(reading), dtype=np.int64)
    inverse = 1.0 / guess
    theta, phi = np.zeros(p), np.zeros((m, q))
    spread = np.maximum(reading.std(axis=0), 1e-12)
    longest = int(NoiseSettings().longest * rate)
    together = np.ones(m)
    of_scale = (settings.unknown * inverse) ** -2.0
    prior = np.concatenate([shared_scale**-2.0, own_scale.ravel() ** -2.0, of_scale])
    mean = np.concatenate([np.zeros(p + m * q), inverse])
    covariance = np.eye(len(prior))
    for round_ in range(settings.rounds):
        torque = known + shared @ theta
        residual = reading - torque * inverse - np.einsum("nmq,mq->nm", own, phi)
        if round_ > 1:
            spread = np.maximum(residual.std(axis=0), 1e-12)
            together = correlation_time(residual, part, longest)
        weight = 1.0 / (spread * np.sqrt(together))
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
        if round_ > 2 and np.all(np.abs(change) < settings.tolerance * np.abs(inverse)):
            break
    torque = known + shared @ theta
    residual = reading - torque * inverse - np.einsum("nmq,mq->nm", own, phi)
    deviation = np.sqrt(np.maximum(np.diag(covariance)[p + m * q :], 0.0))
    return Scales(1.0 / inverse, deviation / np.abs(inverse), theta, residual)
