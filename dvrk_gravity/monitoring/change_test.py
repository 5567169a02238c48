"""Did a torque begin in the last seconds? A likelihood ratio beside what is uncertain anyway.

The residual of whitened samples is r = U u + C theta [in the last seconds] + e, with u ~ N(0, 1)
what the model leaves open, e ~ N(0, 1), and C the torque of one cause per unit of its parameters.
All that came before the last seconds serves to know u. That is the generalised likelihood ratio for
a jump in a linear system (Willsky and Jones 1976), in the form of normal equations.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arrays import Array, Mask

# Part of a cause's information that what is uncertain leaves, below which its size is rounding.
_UNTOLD = 1e-6
_NOTHING = 1e-100  # whitened size of columns that are none


@dataclass(frozen=True, eq=False)
class Sums:
    """Sums of products of whitened samples.

    Attributes:
        gram: (d, d) of the uncertain directions U.
        cross: (d,) with the residual.
    """

    gram: Array
    cross: Array

    @classmethod
    def of(cls, uncertain: Array, residual: Array) -> Sums:
        """Return the sums over m samples of (m, d) directions and (m,) residuals."""
        return cls(uncertain.T @ uncertain, uncertain.T @ residual)

    @classmethod
    def empty(cls, d: int) -> Sums:
        """Return the sums over no samples, of d directions: zeros."""
        return cls(np.zeros((d, d)), np.zeros(d))

    def plus(self, other: Sums, kept: float = 1.0) -> Sums:
        """Return the sums of both, the earlier samples (these) weighted with ``kept``, 0 to 1."""
        return Sums(kept * self.gram + other.gram, kept * self.cross + other.cross)


@dataclass(frozen=True, eq=False)
class Evidence:
    """What samples say of one cause.

    Attributes:
        gain: Twice the log-likelihood ratio: chi-square of k degrees of freedom without the cause.
        theta: (k,) its parameters.
        covariance: (k, k) of them; NaN where the samples do not separate it from what is uncertain.
        directions: (d,) the uncertain directions beside it.
    """

    gain: float
    theta: Array
    covariance: Array
    directions: Array


class ChangeTest:
    """Tests of causes beside the uncertain directions, as all samples so far determine these.

    Attributes:
        directions: (d,) their estimates without any cause.
    """

    def __init__(self, uncertain: Array, residual: Array, before: Sums | None = None) -> None:
        """Add the prior, of unit variance, to sums over all samples.

        Args:
            uncertain: (m, n, d) whitened torque of the uncertain directions.
            residual: (m, n) whitened residual.
            before: Sums of earlier samples, over the first of the directions.
        """
        m, n, d = uncertain.shape
        self._uncertain, self._residual = uncertain, residual
        sums = Sums.of(uncertain.reshape(m * n, d), residual.reshape(-1))
        if before is not None:
            first = len(before.cross)
            sums.gram[:first, :first] += before.gram
            sums.cross[:first] += before.cross
        self._factor = np.linalg.cholesky(sums.gram + np.eye(d))
        self.directions = self._solve(sums.cross)

    def _solve(self, right: Array) -> Array:
        from scipy.linalg import cho_solve

        return np.asarray(cho_solve((self._factor, True), right, check_finite=False))

    def deviation_of(self, directions: Array) -> Array:
        """Return (r,) standard deviations of (r, d) combinations of the uncertain directions."""
        from scipy.linalg import solve_triangular

        found = solve_triangular(self._factor, directions.T, lower=True, check_finite=False)
        return np.asarray(np.sqrt(np.sum(found**2, axis=0)))

    def covariance_of(self, directions: Array) -> Array:
        """Return the (r, r) covariance of (r, d) combinations of the uncertain directions."""
        return np.asarray(directions @ self._solve(directions.T))

    def likelihood(self, columns: Array) -> tuple[Array, Array]:
        """Return (k, k) A and (k,) b of the log-likelihood b' theta - theta' A theta / 2.

        Args:
            columns: (m, n, k) whitened torque of a cause.
        """
        square, shared, solved, score = (each[0] for each in self._products(columns, [0]))
        return square - shared.T @ solved, score

    def evidence(self, columns: Array, prior: Array) -> Evidence:
        """Return the evidence of all samples for a cause with (m, n, k) whitened torque."""
        return next(self.evidence_by_onset(columns, [prior], [0]))[0]

    def evidence_by_onset(
        self, columns: Array, priors: Sequence[Array], firsts: Sequence[int]
    ) -> Iterator[list[Evidence]]:
        """Yield, cause by cause, its evidence for each of s possible onsets.

        Args:
            columns: (m, n, k) whitened torque of all causes, one beside the other.
            priors: (k,) prior precision of each one's parameters, mostly zero.
            firsts: Indices of the samples with which it may begin, rising.
        """
        square, shared, solved, score = self._products(columns, firsts)
        edges = np.cumsum([0, *map(len, priors)])
        for begin, prior in zip(edges.tolist(), priors, strict=False):
            part = slice(begin, begin + len(prior))
            yield self._evidence(
                square[:, part, part] + np.diag(prior), shared[:, :, part], solved[:, :, part],
                score[:, part],
            )  # fmt: skip

    def _products(self, columns: Array, firsts: Sequence[int]) -> tuple[Array, Array, Array, Array]:
        """Return products of (m, n, k) columns over all samples from each of s firsts on.

        Returns:
            (s, k, k) with themselves; (s, d, k) with the uncertain directions; (s, d, k) the
            directions that they are mistaken for; (s, k) with the residual beside the directions.
        """
        m, d, k = len(columns), self._uncertain.shape[2], columns.shape[2]
        stops = (*firsts[1:], m)
        shared, square = np.zeros((len(firsts), d, k)), np.zeros((len(firsts), k, k))
        score = np.zeros((len(firsts), k))
        for index, (first, stop) in enumerate(zip(firsts, stops, strict=True)):
            rows = slice(first, stop)
            own = columns[rows].reshape(-1, k)
            shared[index] = self._uncertain[rows].reshape(-1, d).T @ own
            square[index] = own.T @ own
            score[index] = own.T @ self._residual[rows].reshape(-1)
        # Of all samples from each of them on.
        shared, square, score = (
            np.cumsum(each[::-1], axis=0)[::-1] for each in (shared, square, score)
        )
        solved = self._solve(shared.transpose(1, 0, 2).reshape(d, -1)).reshape(d, len(firsts), k)
        score = score - np.einsum("sdk,d->sk", shared, self.directions)
        return square, shared, solved.transpose(1, 0, 2), score

    def _evidence(
        self, square: Array, shared: Array, solved: Array, score: Array
    ) -> list[Evidence]:
        """Return the evidence of s spans for one cause; its squares hold the prior's precision."""
        size = np.sqrt(np.einsum("skk->sk", square))
        scale = np.where(size > _NOTHING, size, 1.0)
        scale = scale[:, :, None] * scale[:, None, :]
        values, vectors = np.linalg.eigh((square - shared.transpose(0, 2, 1) @ solved) / scale)
        known = (values[:, 0] >= _UNTOLD) & (size > _NOTHING).all(axis=1)
        values = np.where(known[:, None], values, np.nan)
        covariance = (vectors / values[:, None]) @ vectors.transpose(0, 2, 1) / scale
        theta = np.einsum("skl,sl->sk", covariance, score)
        gain = np.sum(score * theta, axis=1)
        directions = self.directions - np.einsum("sdk,sk->sd", solved, theta)
        nothing = np.zeros(score.shape[1])
        return [
            Evidence(float(gain[i]), theta[i], covariance[i], directions[i])
            if known[i] else Evidence(0.0, nothing, covariance[i], self.directions)
            for i in range(len(known))
        ]  # fmt: skip

    def remaining_residual(self, found: Evidence, columns: Array) -> Array:
        """Return the (m, n) whitened residual without a fitted cause of (m, n, k) columns."""
        return self._residual - self._uncertain @ found.directions - columns @ found.theta


def whiten(values: Array, follows: Mask, deviation: Array, kept: Array) -> Array:
    """Return (m, n, …) samples whose errors are independent, of unit variance.

    Errors are taken to be of first order, e_i = kept e_(i-1) + white noise (Prais, Winsten 1954).

    Args:
        values: (m, n, …) samples.
        follows: (m, n) whether the sample before is one of the same series, and usable.
        deviation: (n,) standard deviation of the errors.
        kept: (m, n) or (n,) correlation with the sample before.
    """
    shape = (*follows.shape, *(1,) * (values.ndim - 2))
    after = follows.reshape(shape)
    rho, scale = (np.broadcast_to(each, follows.shape).reshape(shape) for each in (kept, deviation))
    before = np.concatenate([np.zeros_like(values[:1]), values[:-1]])
    return np.where(after, (values - rho * before) / np.sqrt(1.0 - rho**2), values) / scale
