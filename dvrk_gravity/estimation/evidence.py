"""P-values of gains, corrected for multiplicity."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np

from dvrk_gravity.arrays import Array

FEWEST_BLOCKS = 10
"""Blocks of a paired test, at least: Wilcoxon's least p-value of ten is 1/1024, and Student's needs
about as many for skewed gains. Chosen."""

_RESAMPLED = 1000  # draws of a bootstrap: 25 lie beyond either end of a 95 % interval


def bonferroni(p_value: float, trials: float) -> float:
    """Return a p-value corrected for being the best of some trials, of whatever dependence.

    The union bound (Dunn 1961): conservative if the trials are correlated.
    """
    return float(min(1.0, p_value * trials))


def holm(p_values: Sequence[float]) -> Array:
    """Return p-values corrected for the family-wise error rate.

    Uniformly stronger than Bonferroni's (Holm 1979).
    """
    p = np.asarray(p_values, dtype=float)
    order = np.argsort(p)
    stepped = np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1))
    corrected = np.empty_like(p)
    corrected[order] = np.minimum(stepped, 1.0)
    return corrected


def log_likelihood(mean_square: Array, known: Array, samples: Array, dof: float) -> Array:
    """Return (n,) log-likelihoods, but for a constant, of errors of a variance known beforehand.

    Errors larger than that are Student's, as the variance was estimated with few degrees of freedom
    (the moderated statistics of Smyth 2004, Statistical Applications in Genetics and Molecular
    Biology 3:3). Smaller ones are no evidence that it was overestimated: they are Gaussian. Where
    the variance is not known, it is the maximum-likelihood one.

    Args:
        mean_square: (n,) of errors.
        known: (n,) variance of the noise; zero: not known.
        samples: (n,) independent ones.
        dof: Degrees of freedom of ``known``.
    """
    is_known = known > 0.0
    ratio = np.maximum(mean_square, 1e-300) / np.where(is_known, known, 1.0)
    beyond = np.maximum(ratio, 1.0) - 1.0
    total = dof + samples
    above = -0.5 * total * np.log1p(samples * beyond / total)
    below = -0.5 * samples * (np.minimum(ratio, 1.0) - 1.0)
    return np.asarray(np.where(is_known, above + below, -0.5 * samples * np.log(ratio)))


def of_student(normal: float, dof: float) -> float:
    """Return a gain in the log-density of parameters whose covariance was estimated.

    ``u²/2`` of a known covariance becomes the logarithm of Student's density (Lange, Little and
    Taylor 1989).

    Args:
        normal: The gain if they were normal.
        dof: Degrees of freedom of the covariance.
    """
    size = 0.5 * (dof + 1.0) * np.log1p(2.0 * abs(normal) / dof)
    return float(np.copysign(size, normal))


def likelihood_ratio(gain: float, parameters: int) -> float:
    """Return the p-value of a gain in log-likelihood by some parameters (Wilks 1938).

    For a held-out gain, whose mean is negative without an effect, it is an upper bound.
    """
    from scipy.special import chdtrc

    return float(chdtrc(parameters, max(2.0 * gain, 0.0)))


def variance_ratio(gain: float, parameters: int, dof: float, trials: float = 1.0) -> float:
    """Return the p-value of the best of some gains in log-likelihood of an estimated variance.

    Twice a gain is then no chi-square but ``parameters`` times Fisher's F. The variance is
    underestimated equally for all trials: the union bound holds for each true variance, and is
    averaged over those, weighted by the chi-square of the estimate.

    Args:
        gain: The gain by some parameters, in units of the estimated variance.
        parameters: Their number.
        dof: Degrees of freedom of the variance.
        trials: Number of gains of which it is the best.
    """
    from scipy.special import chdtrc

    ratio, weight = _ratios(dof)
    alone = chdtrc(parameters, max(2.0 * gain, 0.0) * ratio)
    return float(weight @ np.minimum(trials * alone, 1.0))


@cache
def _ratios(dof: float) -> tuple[Array, Array]:
    """Return ratios of an estimated variance to the true one, and their probabilities."""
    from scipy.special import chdtr

    edges = np.concatenate([[0.0], np.geomspace(1e-3, 10.0, 400), [np.inf]])
    weight = np.diff(chdtr(dof, dof * edges))
    middle = np.sqrt(edges[1:-2] * edges[2:-1])
    return np.concatenate([edges[:1], middle, edges[-2:-1]]), weight


def student(gains: Array) -> float | None:
    """Return Student's one-sided p-value of (k,) gains over independent blocks.

    Blocks of gain zero do not count; ``None`` for fewer than ``FEWEST_BLOCKS``.
    """
    from scipy.special import stdtr

    gains = gains[gains != 0.0]
    if len(gains) < FEWEST_BLOCKS or np.std(gains) == 0.0:
        return None
    dof = len(gains) - 1
    # As `ttest_1samp`, which takes half a millisecond to check its input, hundreds of times.
    return float(stdtr(dof, -np.mean(gains) * np.sqrt(dof) / np.std(gains)))


def paired(gains: Array) -> list[float]:
    """Return the p-values of :func:`student` and of Wilcoxon's test; none of few blocks.

    Only the latter is clear if a few blocks dominate.
    """
    by_mean = student(gains)
    if by_mean is None:
        return []
    from scipy.stats import wilcoxon  # slow to load

    return [by_mean, float(wilcoxon(gains[gains != 0.0], alternative="greater").pvalue)]


def of_gain(gains: Array, likelihood: float, parameters: int) -> float:
    """Return the one-sided p-value of a held-out gain.

    The best of three tests, times three: Student's and Wilcoxon's over the blocks, and the
    likelihood ratio, which can be clear with few blocks.

    Args:
        gains: (k,) reduction of the squared error, by block.
        likelihood: Gain in log-likelihood of the independent samples.
        parameters: Number of parameters.
    """
    tests = [likelihood_ratio(likelihood, parameters), *paired(gains)]
    return bonferroni(min(tests), 3)


def bootstrap_interval(
    statistic: Callable[..., Array], samples: Sequence[Array], resampled: int = _RESAMPLED
) -> tuple[float, float]:
    """Return the 95 % percentile interval of a statistic of paired (k,) samples (Efron 1979).

    Args:
        statistic: Of the samples, with an ``axis``.
        samples: Of the same k blocks.
        resampled: Number of draws.
    """
    from scipy.stats import bootstrap

    if len(samples[0]) < 2:
        value = float(statistic(*samples, axis=-1))
        return value, value
    found = bootstrap(
        tuple(samples), statistic, paired=True, vectorized=True, method="percentile",
        n_resamples=resampled, rng=np.random.default_rng(0),
    ).confidence_interval  # fmt: skip
    return float(found.low), float(found.high)
