"""Parameters with their covariance: of noise by blocks, and of what the model is known to miss."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arrays import Array
from dvrk_gravity.estimation import NORMAL_95, Regression, block_jackknife


@dataclass(frozen=True)
class OwnParameters:
    """The model's own parameters, which come first and are not free.

    Attributes:
        count: How many there are.
        prior: Variance of noise, in units of the weights, for which the ridge is their prior.
    """

    count: int
    prior: float


@dataclass(frozen=True)
class CoherentError:
    """The part of a model's known error that may look like a cause in all of a motion.

    Attributes:
        rms: (n,) at each joint, in units of the weights.
        adds: (k,) parameters that it looks like at all joints in the same sense.
    """

    rms: Array
    adds: NDArray[np.bool_]


def block_fit(
    regression: Regression, target: Array, block: NDArray[np.int64],
    own_parameters: OwnParameters, coherent: CoherentError, counts: Array,
) -> tuple[Array, Array]:  # fmt: skip
    """Return parameters (k,) but for the model's own, and their covariance (k, k).

    The covariance is the jackknife's over blocks, and what the model's parameters, which are not
    free, may be off by as it says, and the part of its known error that looks like a cause. That of
    few blocks is widened so that normal 95 % intervals are as wide as Student's with one degree of
    freedom less than there are blocks (Cameron and Miller 2015, section VI).

    Args:
        regression: Of (N n, d + k) columns of n joints in turn, the d of the model first.
        target: (N n,).
        block: (N n,) number of the block.
        own_parameters: The model's own parameters.
        coherent: Error that may look like a cause.
        counts: (n,) samples that count.
    """
    from scipy.stats import norm
    from scipy.stats import t as student

    order = np.argsort(block, kind="stable")
    edges = np.flatnonzero(np.diff(block[order], prepend=-1))[1:]
    design = regression.design
    pieces = list(zip(np.split(design[order], edges), np.split(target[order], edges), strict=True))
    theta, covariance = block_jackknife(
        [x.T @ x for x, _ in pieces], [x.T @ y for x, y in pieces],
        regression.ridge, regression.trace,
    )  # fmt: skip
    first = own_parameters.count
    inverse = regression.inverse[first:]
    coupling = inverse[:, :first]
    held = own_parameters.prior * coupling @ regression.ridge[:first, :first] @ coupling.T
    held += _of_known_error(design, inverse, first, coherent, counts)
    wider = student.ppf(norm.cdf(NORMAL_95), max(len(pieces) - 1, 1)) / NORMAL_95
    return theta[first:], wider**2 * (covariance[first:, first:] + held)


def _of_known_error(
    design: Array, inverse: Array, first: int, coherent: CoherentError, counts: Array
) -> Array:
    """Return the (k, k) covariance of what a known error that looks like a cause adds.

    Of each joint an error of that RMS, in the shape of each of its columns; the joints' are
    independent, or add.

    Args:
        design: (N n, d + k) weighted columns, the model's own first.
        inverse: (k, d + k) rows of the inverse of the normal equations' matrix.
        first: d.
        coherent: The error.
        counts: (n,) samples that count.
    """
    columns = design.reshape(-1, len(coherent.rms), design.shape[1]).transpose(1, 2, 0)
    # As errors of that RMS over the usable samples: D_j' W x_jk / RMS(x_jk).
    products = np.matmul(columns, columns[:, first:].transpose(0, 2, 1))
    square = np.einsum("jkk->jk", products[:, first:]) / counts[:, None]
    per_rms = np.where(square > 0.0, 1.0 / np.sqrt(np.where(square > 0.0, square, 1.0)), 0.0)
    scaled = products * (coherent.rms[:, None] * per_rms)[:, None]
    apart, adding = scaled[:, :, ~coherent.adds], scaled[:, :, coherent.adds].sum(axis=0)
    # A square: of columns that are all but the same it stays one to the last digit.
    root = inverse @ np.hstack([*apart, adding])
    return np.asarray(root @ root.T)
