"""Covariance of coefficients when the residual is not white noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.estimation.noise import autocorrelation
from dvrk_gravity.estimation.normal_equations import Regression, Solution, solve
from dvrk_gravity.estimation.splits import Labels

NORMAL_95 = 1.959964
"""97.5 % point of the normal distribution."""


LONGEST = 1.5
"""s, of the residual's autocorrelation. Chosen; see benchmark/coverage.py."""

PRIOR_SHARE = 0.5
"""Part of its standard deviation by which the ridge can be expected to have moved a coefficient
that counts as determined by the data: at a half, a 95 % interval still holds 92 %
(`test_a_bias_of_half_a_deviation_costs_three_per_cent`)."""

REPRODUCED = 0.01
"""Part of a column's square that a fit leaves, below which the fit reproduces it (a correlation of
.995). Chosen on 14 draws each of an ECM, a PSM, a UR5, a Panda and an MTM (seeds 0 to 13): with
.001 as many intervals hold the truth, to a per cent, and those of parameters are 10 % wider.
`benchmark/coverage.py --arms` counts with it."""

NEGLIGIBLE = 1e-6
"""Part of the largest variance below which a combination of scores has none, as of columns that are
nearly the same. Chosen on the same draws: 1e-4 and 1e-8 hold as much."""

RANGE = 12.0
"""Natural logarithms, either way from where noise and omitted columns have equal shares in the
scores, within which the amplitudes' variance is sought. Chosen: at the ends, one of the two is less
than a hundred-thousandth of the other."""

LEVEL = 0.05
"""Significance at which scores refute that all omitted columns leave about nothing: that of the
intervals."""


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Covariance of coefficients.

    Attributes:
        covariance: (p, p), from noise.
        bias: (p, p) second moment of the shift expected of the ridge.
        omitted: (p, p) the same of the shift expected of torque that the model lacks.
    """

    covariance: Array
    bias: Array
    omitted: Array | float = 0.0

    @property
    def total(self) -> Array:
        """(p, p) second moment of the coefficients' errors."""
        return self.covariance + self.bias + self.omitted

    def interval(self, value: float, direction: Array) -> tuple[float, float]:
        """Return the 95 % interval of a (p,) combination of the coefficients."""
        variance = float(direction @ self.total @ direction)
        half = NORMAL_95 * max(variance, 0.0) ** 0.5
        return value - half, value + half

    def identifiable(self, direction: Array) -> bool:
        """Return whether data, not the ridge, determine a (p,) combination."""
        noise = direction @ self.covariance @ direction
        bias = direction @ self.bias @ direction
        return bool(noise > 0.0 and bias <= PRIOR_SHARE**2 * noise)

    def correlation(self, first: Array, second: Array) -> float:
        """Return the correlation of two (p,) combinations."""
        total = self.total
        scale = (first @ total @ first) * (second @ total @ second)
        return float(first @ total @ second / np.sqrt(scale)) if scale > 0.0 else 0.0


def sandwich(solution: Solution, meat: Array) -> Uncertainty:
    """Return the covariance P^-1 M P^-1 of a weighted ridge fit with precision P.

    M is the (p, p) covariance of the scores, X' W R W X. Coefficients that their sign holds at zero
    have none.
    """
    inverse = _inverse(solution)
    prior = solution.precision - solution.data
    return Uncertainty(inverse @ meat @ inverse, inverse @ prior @ inverse)


def _inverse(solution: Solution) -> Array:
    """Return P^-1 of the coefficients that their sign does not hold at zero."""
    inverse = np.zeros_like(solution.precision)
    free = np.flatnonzero(solution.free)
    grid = np.ix_(free, free)
    inverse[grid] = np.linalg.inv(solution.precision[grid])
    return inverse


def omitted_columns(
    solution: Solution, gram: Array, score: Array, meat: Array, inside: NDArray[np.int64],
    outside: NDArray[np.int64], scale: Array,
) -> Array:  # fmt: skip
    """Return (q, q) second moment of all coefficients' errors from columns outside a fit.

    Columns X2 of amplitudes a shift the coefficients by D a, D = P^-1 X1' W X2 (omitted-variable
    bias). Their own are off by -a, so that the torque is off by R a, R = X2 - X1 D: less than
    either part where the fit reproduces X2. A sandwich does not see the shift, since the residual
    is orthogonal to the fit's own columns; the scores s = R' W e = M a + noise, M = R' W R, do.
    So the second moment of a is that of its posterior given s. A priori every column leaves as much
    as any other, independently of it: a ~ N(0, lambda / diag(M)), within the prior of a fit. lambda
    maximises the likelihood of s (empirical Bayes; Casella 1985): about zero for a model that lacks
    nothing. Of one that lacks little else, scores beyond noise count by themselves.

    Args:
        solution: The fit.
        gram: (q, q) weighted products of all columns.
        score: (q,) their weighted products with the residual.
        meat: (q, q) covariance of the scores, from noise.
        inside: (p,) columns of the fit.
        outside: (k,) others, none of which is a multiple of another one or of one inside.
        scale: (q,) prior standard deviations.
    """
    own = np.diag(gram)
    outside = outside[own[outside] > 0.0]
    shift = _inverse(solution) @ gram[np.ix_(inside, outside)]
    left = np.zeros((len(gram), len(outside)))  # R, in terms of all columns
    left[inside], left[outside, np.arange(len(outside))] = -shift, 1.0
    least = REPRODUCED * own[outside]
    size = np.einsum("ik,ij,jk->k", left, gram, left, optimize=True)
    seen = size > least
    left /= np.sqrt(np.maximum(size, least))  # so that each leaves as much as any other
    noise, vectors = np.linalg.eigh(left[:, seen].T @ meat @ left[:, seen])
    acts = noise > NEGLIGIBLE * noise.max(initial=0.0)
    if not acts.any():
        return np.zeros_like(gram)
    white = left[:, seen] @ (vectors[:, acts] / np.sqrt(noise[acts]))
    shown, scores = white.T @ gram @ left, white.T @ score  # scores = shown a + unit noise
    typical = _likeliest_variance(shown[:, seen], scores)
    largest = scale[outside] ** 2 * np.maximum(size, least)
    deviation = np.sqrt(typical / (1.0 + typical / largest))
    left *= deviation
    return left @ _posterior_moment(shown * deviation, scores) @ left.T


def _likeliest_variance(shown: Array, scores: Array) -> float:
    """Return the variance of (k,) amplitudes for (r,) scores of ``shown`` a and unit noise."""
    from scipy.optimize import minimize_scalar  # slow to load

    vectors, singular, _ = np.linalg.svd(shown, full_matrices=False)
    explained, squares = singular**2, (vectors.T @ scores) ** 2
    middle = -np.log(np.mean(explained))

    def improbability(logarithm: float) -> float:
        variance = 1.0 + np.exp(logarithm) * explained
        return float(np.sum(np.log(variance) + squares / variance))

    # Of several minima the least: columns may leave little in many joints, and much in one.
    grid = middle + np.linspace(-RANGE, RANGE, 25)
    least = int(np.argmin([improbability(each) for each in grid]))
    bounds = grid[max(least - 1, 0)], grid[min(least + 1, len(grid) - 1)]
    found = minimize_scalar(improbability, bounds=bounds, method="bounded")
    return float(np.exp(found.x))


def _posterior_moment(shown: Array, scores: Array) -> Array:
    """Return (k, k) second moment of amplitudes, N(0, 1) a priori, given (r,) scores.

    Where such amplitudes leave less than noise does, few columns may still leave much: scores that
    refute this, at a level of 5 % for all of them together (Bonferroni), have amplitudes of the
    variance that they show themselves (Tipping 2001).
    """
    from scipy.special import chdtri  # slow to load

    vectors, singular, directions = np.linalg.svd(shown, full_matrices=False)
    explained, seen = singular**2, vectors.T @ scores
    variance, refuted = np.ones(len(seen)), np.zeros(len(seen), dtype=bool)
    if explained.mean() < 1.0:
        refuted = seen**2 > (1.0 + explained) * chdtri(1, LEVEL / len(scores))
    variance[refuted] = (seen[refuted] ** 2 - 1.0) / explained[refuted]
    left = variance / (1.0 + variance * explained)
    mean = directions.T @ (left * singular * seen)
    covariance = np.eye(shown.shape[1]) + directions.T * (left - 1.0) @ directions
    return np.asarray(covariance + np.outer(mean, mean))


def autocorrelated_scores(
    x: Array, residual: Array, held_out: Array, part: Labels, rate: float, weight: Array,
    measured: Mask, longest: float = LONGEST,
) -> Array:  # fmt: skip
    """Return (p, p) covariance of the scores where residuals are autocorrelated.

    Each channel's own autocorrelation, tapered (Parzen) to zero (Newey and West 1987; Andrews
    1991). Its variance is the mean product of a residual with the same sample's residual when held
    out: a fit bends itself towards the noise that it has seen, so the first is too small, the
    second too large by the same factor, and the product is unbiased (the leave-out estimate of
    Kline, Saggio and Sølvsten 2020; HC2 and HC3 of MacKinnon and White 1985 lie on either side).

    Args:
        x: (n, m, p) columns.
        residual: (n, m) of the fit, times the samples' robust weights.
        held_out: (n, m) of fits that had not seen the sample, weighted in the same way.
        part: (n,) part of each sample, evenly sampled within.
        rate: Hz.
        weight: (m,) of the channels in the fit.
        measured: (n, m) samples that were measured.
        longest: s that correlation may last.
    """
    from scipy.linalg import matmul_toeplitz

    lags = int(longest * rate)
    rho = autocorrelation(held_out, part, lags) * _parzen(lags)[:, None]
    variance = np.maximum(np.mean(residual * held_out, axis=0, where=measured), 0.0)
    meat = np.zeros((x.shape[2], x.shape[2]))
    for j in range(residual.shape[1]):
        for rows in (part == index for index in np.unique(part)):
            used = np.flatnonzero(np.any(x[rows, j] != 0.0, axis=0))
            if not len(used):
                continue
            columns = x[rows, j][:, used]
            first = np.zeros(len(columns))
            reach = min(lags + 1, len(columns))
            first[:reach] = rho[:reach, j]
            smoothed = matmul_toeplitz(first, columns, check_finite=False)
            meat[np.ix_(used, used)] += weight[j] ** 2 * variance[j] * (columns.T @ smoothed)
    return meat


def block_jackknife(
    grams: Sequence[Array], sides: Sequence[Array], ridge: Array, trace: float
) -> tuple[Array, Array]:
    """Return (p,) coefficients and their (p, p) covariance by leaving out one block at a time.

    Errors may be correlated within a block, and parameters may be many beside the blocks (the
    jackknife of MacKinnon and White 1985, "HC3").

    Args:
        grams: (p, p) of each block.
        sides: (p,) of each block.
        ridge: (p, p) prior precision.
        trace: See :func:`solve`.
    """
    gram, side = sum(grams, ridge), np.sum(sides, axis=0)
    theta = solve(gram, side, trace)
    count = len(grams)
    apart = np.array(
        [solve(gram - g, side - s, trace) - theta for g, s in zip(grams, sides, strict=True)]
    )
    return theta, (count - 1) / count * apart.T @ apart


def block_fit(
    regression: Regression, target: Array, block: NDArray[np.int64], counts: Array, *,
    own: int, prior: float, coherent: Array, adds: NDArray[np.bool_],
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
        counts: (n,) samples that count.
        own: Number d of the model's own parameters.
        prior: Variance of noise, in units of the weights, for which the ridge is their prior.
        coherent: (n,) RMS of the part of the known error that may look like a cause in all of a
            motion, at each joint, in units of the weights.
        adds: (k,) parameters that it looks like at all joints in the same sense.
    """
    from scipy.special import ndtr, stdtrit

    order = np.argsort(block, kind="stable")
    edges = np.flatnonzero(np.diff(block[order], prepend=-1))[1:]
    design = regression.design
    pieces = list(zip(np.split(design[order], edges), np.split(target[order], edges), strict=True))
    theta, covariance = block_jackknife(
        [x.T @ x for x, _ in pieces], [x.T @ y for x, y in pieces],
        regression.ridge, regression.trace,
    )  # fmt: skip
    inverse = regression.inverse[own:]
    coupling = inverse[:, :own]
    held = prior * coupling @ regression.ridge[:own, :own] @ coupling.T
    held += _of_known_error(design, inverse, own, coherent, adds, counts)
    wider = stdtrit(max(len(pieces) - 1, 1), ndtr(NORMAL_95)) / NORMAL_95
    return theta[own:], wider**2 * (covariance[own:, own:] + held)


def _of_known_error(
    design: Array, inverse: Array, own: int, rms: Array, adds: NDArray[np.bool_], counts: Array
) -> Array:
    """Return the (k, k) covariance of what a known error that looks like a cause adds.

    Of each joint an error of that RMS, in the shape of each of its columns; the joints' are
    independent, or add. See :func:`block_fit`; ``inverse`` are (k, d + k) rows of the inverse of
    the normal equations' matrix.
    """
    columns = design.reshape(-1, len(rms), design.shape[1]).transpose(1, 2, 0)
    # As errors of that RMS over the usable samples: D_j' W x_jk / RMS(x_jk).
    products = np.matmul(columns, columns[:, own:].transpose(0, 2, 1))
    square = np.einsum("jkk->jk", products[:, own:]) / counts[:, None]
    per_rms = np.where(square > 0.0, 1.0 / np.sqrt(np.where(square > 0.0, square, 1.0)), 0.0)
    scaled = products * (rms[:, None] * per_rms)[:, None]
    apart, adding = scaled[:, :, ~adds], scaled[:, :, adds].sum(axis=0)
    # A square: of columns that are all but the same it stays one to the last digit.
    root = inverse @ np.hstack([*apart, adding])
    return np.asarray(root @ root.T)


def _parzen(longest: int) -> Array:
    u = np.arange(longest + 1) / (longest + 1)
    return np.where(u <= 0.5, 1.0 - 6.0 * u**2 + 6.0 * u**3, 2.0 * (1.0 - u) ** 3)


def squared_distance(theta: Array, covariance: Array) -> float:
    """Return the squared length of parameters in units of their covariance (Mahalanobis 1936).

    Args:
        theta: (k,) parameters, of whatever units.
        covariance: (k, k) of them; along what does not vary nothing counts.
    """
    deviation = np.sqrt(np.diag(covariance))
    per = np.where(deviation > 0.0, 1.0 / np.where(deviation > 0.0, deviation, 1.0), 0.0)
    inverse = np.linalg.pinv(np.outer(per, per) * covariance, hermitian=True)
    return float((per * theta) @ inverse @ (per * theta))
