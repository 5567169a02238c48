"""P-values of gains, and what is left of them when many were tried."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from dvrk_gravity.arrays import Array


@dataclass(frozen=True)
class EvidenceSettings:
    """Of tests.

    Attributes:
        fewest_blocks: Gains over fewer blocks go to no paired test: Wilcoxon's least p-value of ten
            is 1/1024, and Student's needs about as many for skewed gains. Chosen.
        resampled: Draws of a bootstrap: 25 lie beyond either end of a 95 % interval.
    """

    fewest_blocks: int = 10
    resampled: int = 1000


def bonferroni(p_value: float, trials: float) -> float:
    """Return a p-value corrected for being the best of some trials, of whatever dependence.

    The union bound (Dunn 1961): correlated trials make it stricter than it says, never laxer.
    """
    return float(min(1.0, p_value * trials))


def holm(p_values: Sequence[float]) -> Array:
    """Return p-values corrected so that the chance of any false one is what they say.

    Uniformly stronger than Bonferroni's (Holm 1979).
    """
    p = np.asarray(p_values, dtype=float)
    order = np.argsort(p)
    stepped = np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1))
    corrected = np.empty_like(p)
    corrected[order] = np.minimum(stepped, 1.0)
    return corrected


def log_likelihood(mean_square: Array, known: Array, samples: Array, freedom: float) -> Array:
    """Return (n,) log-likelihoods, but for a constant, of errors of a variance known before.

    That makes them Student's: with few degrees of freedom, errors that are larger than they were
    say that the variance was underestimated (the moderated statistics of Smyth 2004, Statistical
    Applications in Genetics and Molecular Biology 3:3). Smaller ones are no evidence that it was
    overestimated: they are Gaussian. Where nothing is known, the variance is the one that makes the
    errors most likely.

    Args:
        mean_square: (n,) of errors.
        known: (n,) variance of the noise, known beforehand; zero: it is not.
        samples: (n,) independent ones.
        freedom: Degrees of freedom with which it is known.
    """
    told = known > 0.0
    ratio = np.maximum(mean_square, 1e-300) / np.where(told, known, 1.0)
    beyond = np.maximum(ratio, 1.0) - 1.0
    total = freedom + samples
    above = -0.5 * total * np.log1p(samples * beyond / total)
    below = -0.5 * samples * (np.minimum(ratio, 1.0) - 1.0)
    return np.asarray(np.where(told, above + below, -0.5 * samples * np.log(ratio)))


def of_student(normal: float, freedom: float) -> float:
    """Return a gain in the log-density of parameters whose covariance was estimated.

    What is ``u²/2`` where the covariance is known is the logarithm of Student's density where it
    was estimated: large deviations are less of a surprise (Lange, Little and Taylor 1989).

    Args:
        normal: The gain, were they normal.
        freedom: Degrees of freedom of the covariance.
    """
    size = 0.5 * (freedom + 1.0) * np.log1p(2.0 * abs(normal) / freedom)
    return float(np.copysign(size, normal))


def likelihood_ratio(gain: float, parameters: int) -> float:
    """Return the p-value of a gain in log-likelihood by some parameters (Wilks 1938).

    Of a gain on samples that the fit has not seen it is an upper bound: without an effect, that
    gain is negative in the mean.
    """
    from scipy.special import chdtrc

    return float(chdtrc(parameters, max(2.0 * gain, 0.0)))


def variance_ratio(gain: float, parameters: int, freedom: float, trials: float = 1.0) -> float:
    """Return the p-value of the best of some gains in log-likelihood of an estimated variance.

    Twice a gain is then no chi-square but ``parameters`` times Fisher's F: a variance that was
    underestimated makes gains that a known one would make in no recording. It is underestimated for
    all trials alike: the union bound holds for each true variance, and its mean is taken over
    those, weighed by the chi-square of the estimate.

    Args:
        gain: The gain by some parameters, in units of the estimated variance.
        parameters: Their number.
        freedom: Degrees of freedom of the variance.
        trials: Of how many gains it is the best.
    """
    from scipy.special import chdtrc

    ratio, weight = _ratios(freedom)
    alone = chdtrc(parameters, max(2.0 * gain, 0.0) * ratio)
    return float(weight @ np.minimum(trials * alone, 1.0))


@cache
def _ratios(freedom: float) -> tuple[Array, Array]:
    """Return ratios of an estimated variance to the true one, and how probable they are."""
    from scipy import stats

    edges = np.concatenate([[0.0], np.geomspace(1e-3, 10.0, 400), [np.inf]])
    weight = np.diff(stats.chi2.cdf(freedom * edges, freedom))
    middle = np.sqrt(edges[1:-2] * edges[2:-1])
    return np.concatenate([edges[:1], middle, edges[-2:-1]]), weight


def paired(gains: Array, settings: EvidenceSettings | None = None) -> list[float]:
    """Return the one-sided p-values of gains over blocks: Student's and Wilcoxon's.

    Gains that a few blocks dominate are clear to the latter only. None where too few decide.

    Args:
        gains: (k,) of independent blocks; zero where nothing could be said.
        settings: How many it takes.
    """
    from scipy import stats

    settings = settings or EvidenceSettings()
    gains = gains[gains != 0.0]
    if len(gains) < settings.fewest_blocks or np.std(gains) == 0.0:
        return []
    return [
        float(stats.ttest_1samp(gains, 0.0, alternative="greater").pvalue),
        float(stats.wilcoxon(gains, alternative="greater").pvalue),
    ]


def of_gain(
    gains: Array, likelihood: float, parameters: int, settings: EvidenceSettings | None = None
) -> float:
    """Return the one-sided p-value of a gain on samples that the fit had not seen.

    The best of three tests, times three for having looked at all: Student's and Wilcoxon's over the
    blocks, and the likelihood ratio, to which few blocks can still be clear.

    Args:
        gains: (k,) squared error that goes, by block.
        likelihood: Gain in log-likelihood, of as many samples as are independent.
        parameters: Number of parameters that it takes.
        settings: Of the tests.
    """
    tests = [likelihood_ratio(likelihood, parameters), *paired(gains, settings)]
    return bonferroni(min(tests), 3)


def bootstrap_interval(
    statistic: Callable[..., Array], samples: Sequence[Array],
    settings: EvidenceSettings | None = None,
) -> tuple[float, float]:  # fmt: skip
    """Return the 95 % percentile interval of a statistic of paired (k,) samples (Efron 1979).

    Args:
        statistic: Of the samples, with an ``axis``.
        samples: Of the same k blocks.
        settings: How often to draw.
    """
    from scipy.stats import bootstrap

    settings = settings or EvidenceSettings()
    if len(samples[0]) < 2:
        value = float(statistic(*samples, axis=-1))
        return value, value
    found = bootstrap(
        tuple(samples), statistic, paired=True, vectorized=True, method="percentile",
        n_resamples=settings.resampled, rng=np.random.default_rng(0),
    ).confidence_interval  # fmt: skip
    return float(found.low), float(found.high)
