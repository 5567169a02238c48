"""How sure a gain is where errors hang together and the model knows how large they are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.filtered_data import FilteredData
from dvrk_gravity.estimation import correlation_time, evidence


@dataclass(frozen=True)
class SignificanceSettings:
    """What a model's known error, and its covariance, are taken to be.

    Attributes:
        coherent: Part of the model's known error that may look like any one cause in all of another
            motion, as a standard deviation: what a state shows comes back with it, and blocks of
            one motion do not tell. Regions of causes that are not there then hold zero in 96 %,
            without it in 83 % (`benchmark/parameter_intervals.py --seeds 401 411`).
        least: Part of the known error, and what becomes smaller than that is no evidence: that an
            error is known to be there does not say that it must be. One, by that.
        freedom: Degrees of freedom of the posterior covariance of the model's parameters, and of
            its known error: so many stretches of half a minute's motion are independent where
            errors hang together for a second. Chosen; see `make sensitivity`.
    """

    coherent: float = 0.15
    least: float = 1.0
    freedom: float = 30.0


class Significance:
    """Likelihoods and p-values of errors.

    Attributes:
        settings: What the model's known error is taken to be.
    """

    def __init__(self, data: FilteredData, settings: SignificanceSettings | None = None) -> None:
        """Take what is known of errors before any fit."""
        self.settings = settings or SignificanceSettings()
        self._data = data

    def log_likelihood(self, mean: Array, samples: Array) -> Array:
        """Return (n,) log-likelihoods of (n,) mean squares of (n,) independent errors."""
        known = self._data.known_error**2
        return evidence.log_likelihood(mean, known, samples, self.settings.freedom)

    def gain(self, before: Array, after: Array, samples: Array) -> Array:
        """Return (n,) gains in log-likelihood that are evidence of a cause.

        An error that becomes smaller than the known one is none (:class:`SignificanceSettings`).

        Args:
            before: (n,) mean squares of errors without a cause.
            after: (n,) likewise with it.
            samples: (n,) independent ones.
        """
        least = (self.settings.least * self._data.known_error) ** 2
        with_it, without = (
            self.log_likelihood(np.maximum(mean, least), samples) for mean in (after, before)
        )
        return with_it - without

    def of_model(self, likelihood: float) -> float:
        """Return what a gain counts that is one in the log-density of the model's parameters."""
        return evidence.of_student(likelihood, self.settings.freedom)

    def p_value(
        self,
        by_block: Array,
        ratio: float,
        parameters: int,
        trials: float = 1.0,
        transient: bool = False,
    ) -> float:
        """Return the one-sided p-value of the best gain on samples that the fit had not seen.

        Where the model knows an error, blocks of one motion, which share a part of that, are no
        test, and of what comes back with the state the variance is known from as few stretches as
        the error is; else see :func:`evidence.of_gain`.

        Args:
            by_block: (k,) squared error that goes, by block.
            ratio: Gain in log-likelihood of independent samples; see :meth:`inflation`.
            parameters: That the gain takes.
            trials: Of how many gains it is the best.
            transient: What gains comes once, and not with a state.
        """
        if self._data.known_error.any():
            if not transient:
                return evidence.variance_ratio(ratio, parameters, self.settings.freedom, trials)
            return evidence.bonferroni(evidence.likelihood_ratio(ratio, parameters), trials)
        return evidence.bonferroni(evidence.of_gain(by_block, ratio, parameters), trials)

    def inflation(self, product: Array, samples: Array) -> Array:
        """Return (n,) how many times its variance for white noise a score's variance is.

        By the sum of the autocorrelations of the product of errors with a torque the variance of
        the torque's size grows (Newey and West 1987): slow errors are hardly in the way of one that
        changes its sign with each acceleration. Where the model knows an error, a part c of that
        may look like any cause in all of the motion, which adds c² for each of N independent
        samples (:class:`SignificanceSettings`).

        Args:
            product: (R, n) of what is left with the torque, N·m, zero where nothing counts.
            samples: (n,) independent ones.
        """
        known = np.where(self._data.known_error > 0.0, self.settings.coherent, 0.0)
        return self.correlation(product) + samples * known**2

    def correlation(self, error: Array) -> Array:
        """Return (n,) how many times longer than noise's a correlation is, at least 1.

        Args:
            error: (R, n), zero where nothing counts.
        """
        longer = np.ones(error.shape[1])
        looked = error.any(axis=0)
        if self._data.band is None or not looked.any():
            return longer
        part = np.zeros(len(error), dtype=np.int64)
        length = correlation_time(error[:, looked], part, len(error) // 4)
        longer[looked] = np.fmax(1.0, length / self._data.samples_per_independent)
        return longer
