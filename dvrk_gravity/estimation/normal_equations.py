"""Weighted least squares on sums of products, from which held-out blocks are subtracted.

Samples are summed once. Then every fit with any choice of columns, with or without any block, works
on small Gram matrices and takes milliseconds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arrays import Array
from dvrk_gravity.errors import DvrkGravityError

NULL = 1e-12
"""Squared size of a column, in units of the weights, that is round-off: its coefficient would have
to be a million."""

ROUND_OFF = 1e-13
"""Part of a column's own square to which sums in double precision are exact: a smaller ridge leaves
duplicates among a few hundred columns singular."""

EXCHANGES = 5  # before the solver that always terminates is called: a bound on time


class NotConvergedError(DvrkGravityError):
    """A constrained least-squares problem whose solver did not converge."""


class SingularError(DvrkGravityError):
    """Least squares that are singular in double precision despite their priors."""

    def __init__(self, count: int) -> None:
        """Name the number of coefficients."""
        super().__init__(
            f"a fit of {count} coefficients is singular in double precision: got effort limits or "
            "other priors far from what was recorded, expected the arm's own"
        )


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Sums of products over a set of samples, channel by channel (m channels).

    Attributes:
        gram: (m, p, p) sums of w x x'.
        cross: (m, p) sums of w x y.
        power: (m,) sums of w y^2.
    """

    gram: Array
    cross: Array
    power: Array

    @classmethod
    def of(cls, x: Array, y: Array, weight: Array | None = None) -> NormalEquations:
        """Sum (n, m, p) columns and (n, m) values with (n, m) weights >= 0, by default one."""
        weight = np.ones_like(y) if weight is None else weight
        channels, columns = x.shape[1:]
        gram, cross = np.zeros((channels, columns, columns)), np.zeros((channels, columns))
        for j in range(channels):
            # Most columns are zero in a given channel.
            used = np.flatnonzero(np.any(x[:, j] != 0.0, axis=0))
            root = np.sqrt(weight[:, j])
            scaled = x[:, j, used] * root[:, None]
            gram[j][np.ix_(used, used)] = scaled.T @ scaled  # of one array: half of it is computed
            cross[j][used] = scaled.T @ (root * y[:, j])
        return cls(gram, cross, (weight * y * y).sum(0))

    def __sub__(self, other: NormalEquations) -> NormalEquations:
        """Return the sums of this set without a part of it."""
        return NormalEquations(
            self.gram - other.gram, self.cross - other.cross, self.power - other.power
        )

    def select(self, chosen: Sequence[int] | NDArray[np.int64]) -> NormalEquations:
        """Return the sums of some of the columns."""
        index = np.asarray(chosen, dtype=np.int64)
        gram = self.gram[:, index[:, None], index]
        return NormalEquations(gram, self.cross[:, index], self.power)

    def combined(self, weight: Array) -> tuple[Array, Array]:
        """Return the (p, p) and (p,) sums over channels, each times its (m,) weight."""
        return np.tensordot(weight, self.gram, 1), weight @ self.cross

    def error(self, theta: Array) -> Array:
        """Return (m,) weighted sums of squared errors of (p,) coefficients."""
        return np.maximum(self.power - 2.0 * self.cross @ theta + (self.gram @ theta) @ theta, 0.0)


@dataclass(frozen=True, eq=False)
class Solution:
    """A fit.

    Attributes:
        theta: (p,) coefficients.
        precision: (p, p) weighted Gram matrix and prior together.
        data: (p, p) weighted Gram matrix alone.
        free: (p,) mask of the coefficients not held at zero by their sign.
    """

    theta: Array
    precision: Array
    data: Array
    free: NDArray[np.bool_]

    @property
    def prior(self) -> Array:
        """(p,) prior standard deviations of the fit."""
        return np.asarray(np.diag(self.precision - self.data) ** -0.5)


def prior_precision(gram: Array, scale: Array) -> Array:
    """Return (..., p, p) precisions of a prior.

    A prior that is lost in the round-off of a column's own square, such as one by an effort limit
    ten thousand times the recorded torques, leaves duplicate columns singular. It is narrowed until
    it does not, and still does not affect what the data determine.

    Args:
        gram: (..., p, p) weighted.
        scale: (p,) prior standard deviations.
    """
    own = np.diagonal(gram, axis1=-2, axis2=-1)
    return np.asarray(np.maximum(scale**-2.0, ROUND_OFF * own)[..., None] * np.eye(len(scale)))


def fit(
    equations: NormalEquations,
    weight: Array,
    scale: Array,
    positive: NDArray[np.bool_] | None = None,
) -> Solution:
    """Minimise sum_j weight_j |y_j - X_j theta|^2 + |theta / scale|^2 under sign constraints.

    Args:
        equations: Of p columns.
        weight: (m,) of the channels, inverse variances of one sample, correlation included.
        scale: (p,) prior standard deviations: a ridge towards zero.
        positive: (p,) mask of coefficients that must not be negative; by default none.

    Raises:
        NotConvergedError: The solver runs out of iterations.
        SingularError: Columns that are linearly dependent.
    """
    data, right = equations.combined(weight)
    precision = data + prior_precision(data, scale)
    if positive is None:
        positive = np.zeros(len(right), dtype=bool)
    theta, free = solve_signed(precision, right, positive)
    return Solution(theta, precision, data, free)


def solve(gram: Array, right: Array, trace: float = 0.0) -> Array:
    """Solve normal equations scaled to a diagonal of ones.

    Args:
        gram: (p, p) positive semidefinite.
        right: (p,) or (p, k).
        trace: Added to the ones: duplicate columns share their coefficient.
    """
    if not len(gram):
        return np.zeros((0, *right.shape[1:]))
    size = gram.diagonal()
    known = size > NULL
    scale = np.sqrt(np.where(known, size, np.inf))
    scaled = gram / (scale[:, None] * scale)
    scaled.flat[:: len(gram) + 1] += np.where(known, trace, 1.0)
    units = scale if right.ndim == 1 else scale[:, None]
    return np.asarray(np.linalg.solve(scaled, right / units) / units)


def extended_products(products: Array, design: Array, more: Array) -> Array:
    """Return the (k + c, k + c) products of (n, k) columns and (n, c) further ones.

    Only those with the further ones are summed.
    """
    coupling = more.T @ design
    return np.block([[products, coupling.T], [coupling, more.T @ more]])


class Regression:
    """Least squares on some columns, for many targets.

    Attributes:
        design: (n, k) columns, weighted.
        ridge: (k, k) prior precision.
        trace: See :func:`solve`.
    """

    def __init__(
        self, design: Array, ridge: Array, trace: float, products: Array | None = None
    ) -> None:
        """Sum the products, unless the (k, k) ``products`` of the columns are given."""
        self.design, self.ridge, self.trace = design, ridge, trace
        self._products = design.T @ design if products is None else products
        self._gram = self._products + ridge

    def extended(self, columns: Array, ridge: Array) -> Regression:
        """Return the fit with further weighted (n, c) columns of (c, c) prior precision."""
        none = np.zeros((len(ridge), len(self.ridge)))
        return Regression(
            np.hstack([self.design, columns]),
            np.block([[self.ridge, none.T], [none, ridge]]),
            self.trace,
            extended_products(self._products, self.design, columns),
        )

    def coefficients(self, target: Array) -> Array:
        """Return (k,) or (k, c) coefficients of (n,) or (n, c) targets."""
        return solve(self._gram, self.design.T @ target, self.trace)

    @property
    def inverse(self) -> Array:
        """(k, k) inverse of the normal equations' matrix."""
        return solve(self._gram, np.eye(len(self._gram)), self.trace)

    def residual(self, target: Array) -> Array:
        """Return the residual of (n,) or (n, c) targets."""
        if not self.design.shape[1]:
            return target
        return target - self.design @ self.coefficients(target)


def solve_signed(
    precision: Array, right: Array, positive: NDArray[np.bool_],
    guess: NDArray[np.bool_] | None = None,
) -> tuple[Array, NDArray[np.bool_]]:  # fmt: skip
    """Solve a symmetric positive definite system with some unknowns not negative.

    By a few exchanges of the active set (Portugal, Júdice, Vicente 1994) if these satisfy the
    Karush-Kuhn-Tucker conditions. Else the unknowns without a sign are eliminated, and the others
    are non-negative least squares (Lawson and Hanson 1974, by SciPy) on the Cholesky factor of the
    Schur complement.

    Args:
        precision: (p, p).
        right: (p,).
        positive: (p,) unknowns that must not be negative.
        guess: (p,) initial guess of the unknowns not held at zero; by default all.

    Returns:
        The (p,) solution and the mask of those not held at zero.

    Raises:
        NotConvergedError: If SciPy's solver runs out of iterations.
        SingularError: If the system is not positive definite.
    """
    free = np.ones(len(right), dtype=bool) if guess is None else guess | ~positive
    for _ in range(EXCHANGES):
        theta = _solve_free(precision, right, free)
        wrong, (held,) = positive & (theta < 0.0), (~free).nonzero()
        if len(held):
            wrong[held] = right[held] > precision[held] @ theta
        if not wrong.any():
            return theta, free
        free = free ^ wrong
    from scipy.linalg import cho_factor, cho_solve, solve_triangular
    from scipy.optimize import nnls

    signed, unsigned = np.flatnonzero(positive), np.flatnonzero(~positive)
    coupling = precision[np.ix_(unsigned, signed)]
    try:
        factor = cho_factor(precision[np.ix_(unsigned, unsigned)], check_finite=False)
        through = cho_solve(factor, np.column_stack([coupling, right[unsigned]]))
        reduced = precision[np.ix_(signed, signed)] - coupling.T @ through[:, :-1]
        # Scaled to a unit diagonal, for the solver's tolerance; a negative diagonal keeps its sign,
        # for the factorisation to refuse.
        unit = np.sqrt(np.abs(np.diag(reduced)))
        triangle = np.linalg.cholesky(reduced / np.outer(unit, unit))
    except np.linalg.LinAlgError as error:
        raise SingularError(len(right)) from error
    target = right[signed] - coupling.T @ through[:, -1]
    try:
        found, _ = nnls(triangle.T, solve_triangular(triangle, target / unit, lower=True))
    except RuntimeError as error:
        raise NotConvergedError(
            f"{len(signed)} coefficients that must not be negative: {error}"
        ) from error
    theta[signed] = found / unit
    theta[unsigned] = through[:, -1] - through[:, :-1] @ theta[signed]
    free = np.ones(len(right), dtype=bool)
    free[signed] = found > 0.0
    return theta, free


def _solve_free(precision: Array, right: Array, free: NDArray[np.bool_]) -> Array:
    """Return the solution (p,) with all but some unknowns at zero."""
    from scipy.linalg.lapack import dposv

    theta = np.zeros(len(right))
    (index,) = free.nonzero()
    if not len(index):
        return theta
    # A copy, in LAPACK's order of rows and columns: the matrix is symmetric.
    part = precision[index[:, None], index].T
    _, theta[index], info = dposv(part, right[index], overwrite_a=True)
    if info:
        raise SingularError(len(index))
    return theta
