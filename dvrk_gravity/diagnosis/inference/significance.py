"""Significance of a gain where errors are correlated and the model knows how large they are."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.candidate import Candidate
from dvrk_gravity.diagnosis.data.filtered_data import FilteredData
from dvrk_gravity.estimation import correlation_time, evidence


@dataclass(frozen=True)
class SignificanceSettings:
    """What a model's known error, and its covariance, are taken to be.

    Attributes:
        coherent: Part of the model's known error that may look like any one cause in all of another
            motion, as a standard deviation: what a state shows recurs with it, and blocks of
            one motion do not show it. Regions of causes that are not there then hold zero in 96 %,
            without it in 83 % (`benchmark/parameter_intervals.py --seeds 401 411`).
        least: Part of the known error, and what becomes smaller than that is no evidence: that an
            error is known to be there does not say that it must be. One, by that.
        dof: Degrees of freedom of the posterior covariance of the model's parameters, and of
            its known error: so many stretches of half a minute's motion are independent where
            errors are correlated for a second. Chosen; see `make sensitivity`.
    """

    coherent: float = 0.15
    least: float = 1.0
    dof: float = 30.0


@dataclass(frozen=True, eq=False)
class Significance:
    """Likelihoods and p-values of errors.

    Attributes:
        data: What is known of errors before any fit.
        settings: What the model's known error is taken to be.
    """

    data: FilteredData
    settings: SignificanceSettings = field(default_factory=SignificanceSettings)

    def log_likelihood(self, mean: Array, samples: Array) -> Array:
        """Return (n,) log-likelihoods of (n,) mean squares of (n,) independent errors."""
        known = self.data.known_error**2
        return evidence.log_likelihood(mean, known, samples, self.settings.dof)

    def gain(self, before: Array, after: Array, samples: Array) -> Array:
        """Return (n,) gains in log-likelihood that are evidence of a cause.

        An error that becomes smaller than the known one is none (:class:`SignificanceSettings`).

        Args:
            before: (n,) mean squares of errors without a cause.
            after: (n,) likewise with it.
            samples: (n,) independent ones.
        """
        least = (self.settings.least * self.data.known_error) ** 2
        with_it, without = (
            self.log_likelihood(np.maximum(mean, least), samples) for mean in (after, before)
        )
        return with_it - without

    def of_model(self, likelihood: float) -> float:
        """Return what a gain counts that is one in the log-density of the model's parameters."""
        return evidence.of_student(likelihood, self.settings.dof)

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
        test, and of what depends on the state the variance is known from as few stretches as
        the error is; else see :func:`evidence.of_gain`.

        Args:
            by_block: (k,) squared error that goes, by block.
            ratio: Gain in log-likelihood of independent samples; see :meth:`inflation`.
            parameters: That the gain takes.
            trials: Of how many gains it is the best.
            transient: What gains comes once, and not with a state.
        """
        if self.data.known_error.any():
            if not transient:
                return evidence.variance_ratio(ratio, parameters, self.settings.dof, trials)
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
        known = np.where(self.data.known_error > 0.0, self.settings.coherent, 0.0)
        return self.correlation(product) + samples * known**2

    def correlation(self, error: Array) -> Array:
        """Return (n,) how many times longer than noise's a correlation is, at least 1.

        Args:
            error: (R, n), zero where nothing counts.
        """
        longer = np.ones(error.shape[1])
        looked = error.any(axis=0)
        if self.data.band is None or not looked.any():
            return longer
        part = np.zeros(len(error), dtype=np.int64)
        length = correlation_time(error[:, looked], part, len(error) // 4)
        longer[looked] = np.fmax(1.0, length / self.data.samples_per_independent)
        return longer


@dataclass(frozen=True)
class Multiplicity:
    """The number of torques compared, for Bonferroni's correction.

    A search compares hundreds for one cause. Half of the chance of an error is theirs, half that of
    hypotheses that need no search, so that neither kind pays for the other.

    Attributes:
        alone: Hypotheses without a search.
        searched: Torques of those that are searched for.
    """

    alone: int
    searched: int

    @classmethod
    def of(cls, pool: Iterable[Candidate]) -> Multiplicity:
        """Return how many hypotheses stand for, whether or not their search is over."""
        pool = list(pool)
        found = Counter(candidate.hypothesis.key for candidate in pool)
        stands_for = {each.hypothesis.key: each.hypothesis.n_comparisons for each in pool}
        alone = sum(count for key, count in found.items() if stands_for[key] == 1)
        searched = sum(
            max(count, stands_for[key]) for key, count in found.items() if stands_for[key] > 1
        )
        return cls(alone, searched)

    def n_comparisons(self, candidate: Candidate) -> int:
        """Return of how many torques one is the best, of either kind."""
        of_its_kind = self.searched if candidate.hypothesis.n_comparisons > 1 else self.alone
        return 2 * max(of_its_kind, candidate.hypothesis.n_comparisons)
