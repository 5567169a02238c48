"""Hypotheses compared by cross-validation: gains on unseen folds, tests over blocks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.candidate import Candidate, Score, in_batches
from dvrk_gravity.diagnosis.data.filtered_data import ChoiceSamples, FilteredData
from dvrk_gravity.diagnosis.inference.significance import Significance
from dvrk_gravity.estimation import (
    FEWEST_BLOCKS,
    Regression,
    block_fit,
    combined_folds,
    design_effect,
    extended_products,
    intraclass_correlation,
    solve,
)

# Added to normal equations of unit diagonal: ten times the square root of a double's precision, so
# that columns that repeat others share their coefficient.
_TRACE = 1e-9
# Part of the most active block's energy from which on a candidate acts in a block. Chosen.
ACTIVE = 0.03
_LEAST_USABLE = 0.05  # of the samples, that a joint must have to be judged at all. Chosen
_SCREENED = 32  # columns screened at a time, on which no result depends: faster than one by one
# Correlation times of the model's known error in a block of the jackknife: of an exponential
# correlation four leave an eighth of the variance unseen (Künsch 1989).
_CLUSTER = 4.0
_ROUNDS = 2  # of fits and weights beside candidates: later ones change a hundredth. Chosen


@dataclass(frozen=True, eq=False)
class CrossValidation:
    """Scores sets of candidates on the samples that the choice may see.

    Attributes:
        data: Residuals, blocks and folds.
        choice: The samples that fit and choice may see.
        weight: (n,) one over the error of each joint, 1/(N·m); zero where it was not recorded.
        intraclass: (n,) correlation of a joint's errors in two copies of a motion.
        significance: p-values of gains.
        prior_inflation: Independent samples that count as one, by which the prior of the model's
            parameters is multiplied beside sums over all; see :meth:`evidence`.
    """

    data: FilteredData
    choice: ChoiceSamples
    weight: Array
    intraclass: Array
    significance: Significance
    prior_inflation: float = 1.0

    @classmethod
    def of(cls, data: FilteredData) -> CrossValidation:
        """Set up the folds, with joints weighted by the given model's error."""
        choice, zero = ChoiceSamples.of(data), np.zeros(data.residual.shape[1])
        return cls(data, choice, zero, zero, Significance(data))._weighted_by(choice.residual)

    def weighted(self, candidates: Sequence[Candidate], final: bool = False) -> CrossValidation:
        """Return the same with joints weighted by the errors beside some candidates.

        From the errors that the model leaves beside none, so that they depend on the candidates
        alone (feasible generalised least squares). The model itself is fitted once: a second fit
        sharpens a joint whose error a free model can absorb, and friction that grows with load
        alarms there.

        Args:
            candidates: The candidates.
            final: They are all causes: what recurs with the motion is then misfit, and copies of it
                count once. While causes are missing, it is theirs.
        """
        error = self._weighted_by(self.choice.residual).out_of_fold([])
        validation = self._weighted_by(error)
        for _ in range(_ROUNDS if candidates else 0):
            error = validation.out_of_fold(candidates)
            validation = self._weighted_by(error)
        if not final:
            return validation
        first, second = self.choice.pairs
        usable = self.choice.usable[first] & self.choice.usable[second]
        intraclass = intraclass_correlation(error[first], error[second], usable)
        return replace(validation, intraclass=intraclass)

    def _weighted_by(self, error: Array) -> CrossValidation:
        """Return the same with joints weighted by (R, n) errors, at least the known ones."""
        rms = np.sqrt(self._mean_square(error))
        rms = np.where(rms > 0.0, np.maximum(rms, self.known_error), 0.0)
        enough = self.choice.usable.sum(axis=0) > _LEAST_USABLE * len(self.choice.rows)
        present = self.data.motion.present & (rms > 0.0) & enough
        weight = np.where(present, 1.0 / np.where(present, rms, 1.0), 0.0)
        return replace(self, weight=weight, intraclass=np.zeros(self.joints))

    @cached_property
    def _weights(self) -> Array:
        """(R, n) 1/(N·m); zero where nothing can be said."""
        return np.asarray(self.choice.usable * self.weight)

    @cached_property
    def _target(self) -> Array:
        """(R n,) weighted residuals."""
        return (self.choice.residual * self._weights).reshape(-1)

    @cached_property
    def _model_by_fold(self) -> tuple[Array, Array]:
        """(F, d, d) and (F, d) weighted sums of the model's columns over each fold."""
        return combined_folds(self.choice.of_model, self.weight**2)

    @cached_property
    def _of_model(self) -> Regression:
        """The least squares of the model's own parameters alone."""
        design = self.choice.model.reshape(len(self._target), -1) * self._weights.reshape(-1, 1)
        products = self._model_by_fold[0].sum(axis=0)
        return Regression(design, self._ridge([], self.model_size), _TRACE, products)

    @property
    def joints(self) -> int:
        """Number of joints n."""
        return self.data.residual.shape[1]

    @property
    def model_size(self) -> int:
        """Number of directions in which the model may be off."""
        return int(self.choice.model.shape[2])

    @property
    def known_error(self) -> Array:
        """(n,) RMS error that the model is known to have, N·m."""
        return self.data.known_error

    @property
    def samples(self) -> Array:
        """(n,) independent samples of each joint, about."""
        # Copies of a misfit that recurs with the motion add no evidence.
        return self.choice.counts / self.redundancy

    @property
    def redundancy(self) -> Array:
        """(n,) samples that count as one."""
        return self.data.samples_per_independent * design_effect(self.data.copies, self.intraclass)

    def _mean_square(self, error: Array) -> Array:
        """Return (n,) mean squares of (R, n) errors over the usable samples."""
        return np.asarray((error**2 * self.choice.usable).sum(axis=0) / self.choice.counts)

    @property
    def _clustered(self) -> int:
        """Blocks that count as one: as long as errors are correlated, but ten of them at least."""
        uncertainty = self.data.motion.model.uncertainty
        if uncertainty is None or self.data.band is None:
            return 1
        span = _CLUSTER * float(np.max(np.nan_to_num(uncertainty.correlation_time)))
        most = self.data.count // FEWEST_BLOCKS
        return max(1, min(round(span / self.data.blocks.settings.duration), most))

    def design(self, candidates: Sequence[Candidate]) -> Array:
        """Return (R n, k) weighted columns of candidates."""
        return self.choice.design(candidates, self._weights)

    def _unweighted(self, error: Array) -> Array:
        """Return (R, n) errors, N·m, of (R n,) weighted ones."""
        return error.reshape(-1, self.joints) / np.where(self.weight > 0.0, self.weight, 1.0)

    def _ridge(self, candidates: Sequence[Candidate], own: int = 0) -> Array:
        """Return (own + k, own + k) what is known before any data, in units of samples.

        Args:
            candidates: Of k parameters.
            own: Parameters of the model itself before them, in units of their standard deviations.
        """
        ridges = [
            np.full(own, self.prior_inflation),
            *(candidate.ridge for candidate in candidates),
        ]
        return np.diag(self._prior_weight * np.concatenate(ridges))

    @property
    def _prior_weight(self) -> float:
        """Samples that count as one, by which a prior is multiplied beside sums over all."""
        return self.data.samples_per_independent * self.data.copies

    def regression(self, candidates: Sequence[Candidate]) -> Regression:
        """Return the least squares of the model's own parameters and then those of candidates."""
        return self._of_model.extended(self.design(candidates), self._ridge(candidates))

    def out_of_fold(self, candidates: Sequence[Candidate]) -> Array:
        """Return (R, n) errors of the choice's samples, each from a fit that left its fold out."""
        return self._cross_validated(candidates)[0]

    def _cross_validated(self, candidates: Sequence[Candidate]) -> tuple[Array, float]:
        """Return :meth:`out_of_fold` and minus the log prior of the model's parameters."""
        model, columns = self._of_model.design, self.design(candidates)
        target, error = self._target, self._target.copy()
        grams, sides = [], []
        for rows, gram, side in zip(self.choice.values, *self._model_by_fold, strict=True):
            grams.append(extended_products(gram, model[rows], columns[rows]))
            sides.append(np.concatenate([side, columns[rows].T @ target[rows]]))
        ridge = self._ridge(candidates, self.model_size)
        gram, side = np.sum(grams, axis=0), np.sum(sides, axis=0)
        for rows, own_gram, own_side in zip(self.choice.values, grams, sides, strict=True):
            theta = solve(gram - own_gram + ridge, side - own_side, _TRACE)
            own, further = np.split(theta, [self.model_size])
            error[rows] -= model[rows] @ own + columns[rows] @ further
        theta = solve(gram + ridge, side, _TRACE)
        return self._unweighted(error), self._negative_log_prior(theta)

    def _negative_log_prior(self, theta: Array) -> Any:
        """Return (…,) minus the log-density of the model's (d, …) parameters, but for a constant.

        Each is in units of its standard deviation.
        """
        return 0.5 * np.square(theta[: self.model_size]).sum(axis=0)

    def score(self, candidates: Sequence[Candidate]) -> Score:
        """Return the out-of-fold score of a set."""
        error, negative_log_prior = self._cross_validated(candidates)
        mean = self._mean_square(error)
        likelihood = float(self._log_likelihood(mean).sum())
        likelihood -= negative_log_prior + sum(candidate.cost for candidate in candidates)
        square = ((error * self._weights) ** 2).sum(axis=1)
        loss = np.bincount(self.choice.block, square, minlength=self.data.count).astype(float)
        return Score(error, np.sqrt(mean), loss, likelihood, negative_log_prior)

    def spread(self, first: Score, second: Score) -> float:
        """Return the standard error of the difference of two log-likelihoods (Vuong 1989).

        From its variation over blocks, joined as in :meth:`fit`. A logarithm of a mean square falls
        by about as much as that does over the geometric mean of both.
        """
        part = self.choice.block // self._clustered
        rms, other = (np.maximum(each.rms, self.known_error) for each in (first, second))
        square = np.maximum(rms * other * self.redundancy, 1e-300)
        slope = np.where(self.weight > 0.0, 0.5 / square, 0.0)
        by_block = np.bincount(part, (first.error**2 - second.error**2) @ slope)[np.unique(part)]
        return float(np.sqrt(len(by_block)) * np.std(by_block, ddof=1))

    def _log_likelihood(self, mean: Array) -> Array:
        """Return (n,) log-likelihoods of (n,) mean squared errors, but for a constant."""
        samples = np.where(self.weight > 0.0, self.samples, 0.0)
        return self.significance.log_likelihood(mean, samples)

    def _likelihood_of(self, error: Array) -> Any:
        """Return (…,) log-likelihoods of (R n, …) weighted errors."""
        return self._log_likelihood(self._rms(error) ** 2).sum(axis=-1)

    def _rms(self, weighted: Array) -> Array:
        """Return (…, n) RMS over the usable samples, N·m, of (R n, …) weighted values."""
        values = weighted.reshape(-1, self.joints, *weighted.shape[1:])
        square = np.einsum("rn...,rn...->...n", values, values) / self.choice.counts
        return np.asarray(np.sqrt(square) / np.where(self.weight > 0.0, self.weight, 1.0))

    def p_value(
        self, before: Score, after: Score, candidate: Candidate, inflation: Array,
        n_comparisons: int, changed: float = 1.0,
    ) -> float:  # fmt: skip
        """Return the one-sided p-value of the gain over the blocks where a candidate acts.

        It is the best of so many comparisons; only a fraction of the gain may be of a change.
        """
        acts = self._acting(candidate)
        return self.significance.p_value(
            (before.loss - after.loss)[acts], changed * self.gain(before, after, inflation),
            candidate.size, n_comparisons, candidate.hypothesis.transient,
        )  # fmt: skip

    def _acting(self, candidate: Candidate) -> NDArray[np.bool_]:
        """Return (blocks,) in which a candidate acts."""
        weight = self.weight[candidate.joints] ** 2
        square = (candidate.values[self.choice.rows] ** 2).sum(axis=2) @ weight
        energy = np.bincount(self.choice.block, square, minlength=self.data.count)
        return np.asarray(energy > ACTIVE * energy.max())

    def _lasts(self, candidate: Candidate) -> float:
        """Return which part of the samples of choice a candidate is there for.

        What depends on the state is there all the time, whether or not it acts.
        """
        if not candidate.hypothesis.transient:
            return 1.0
        part = float(np.mean(self._acting(candidate)[self.choice.block]))
        return max(part, 1.0 / len(self.choice.rows))

    def gain(self, before: Score, after: Score, inflation: Array) -> float:
        """Return the gain in log-likelihood that counts, of independent samples.

        Of the (n,) inflations so many samples count as one, see :meth:`inflation`.
        """
        samples = np.where(self.weight > 0.0, self.samples / inflation, 0.0)
        gained = self.significance.gain(before.rms**2, after.rms**2, samples).sum()
        spared = before.negative_log_prior - after.negative_log_prior
        return float(gained) + self.significance.of_model(spared)

    def evidence(
        self, candidates: Sequence[Candidate], others: Sequence[Candidate], inflation: float
    ) -> float:
        """Return the log-likelihood by which some candidates explain more than others do.

        Where errors are correlated, so many samples count as one of what is left; of what the
        model's parameters must be off by, what is known of them counts whole. So it is in the
        fits as well: else the parameters move, at a cost, for what counts little.

        Args:
            candidates: Some candidates.
            others: Others.
            inflation: Log-likelihood that counts as one unit.
        """
        shared = replace(self, prior_inflation=inflation)
        first, second = shared.score(candidates), shared.score(others)
        spared = second.negative_log_prior - first.negative_log_prior
        left = first.likelihood - second.likelihood - spared
        return left / inflation + self.significance.of_model(spared)

    def inflation(self, error: Array, torque: Array) -> Array:
        """Return (n,) inflations, see :meth:`Significance.inflation`, of (R, n) errors."""
        product = np.where(self.choice.usable, error * torque, 0.0)
        return self.significance.inflation(product, self.samples)

    def screen(
        self,
        selected: Sequence[Candidate],
        pool: Iterable[Candidate],
        keep: int,
        least: Array | float = 0.0,
    ) -> list[Candidate]:
        """Return the candidates of the pool that fit best beside the selected ones, best first.

        Args:
            selected: The selected ones.
            pool: Where they come from.
            keep: How many at most.
            least: (n,) RMS torque that one must have on some joint: what could not be selected,
                however well it fits, takes no place from what could.
        """
        base = self.regression(selected)
        theta = base.coefficients(self._target)
        target = self._target - base.design @ theta
        before = self._likelihood_of(target)
        found = []
        for batch in in_batches(pool, lambda candidate: candidate.size, _SCREENED):
            raws = self.design(batch)
            besides = base.coefficients(raws)
            all_columns = raws - base.design @ besides if len(theta) else raws
            cross, edges = raws.T @ target, np.cumsum([0, *(each.size for each in batch)])
            coefficients = np.zeros((len(cross), len(batch)))  # of each candidate alone
            for index, span in enumerate(map(slice, edges, edges[1:])):
                gram = raws[:, span].T @ all_columns[:, span] + self._ridge([batch[index]])
                coefficients[span, index] = solve(gram, cross[span], _TRACE)
            error = target[:, None] - all_columns @ coefficients
            adjusted = theta[:, None] - besides @ coefficients
            spared = self._negative_log_prior(theta) - self._negative_log_prior(adjusted)
            gains = self._likelihood_of(error) - before + spared
            lasts = np.sqrt([[self._lasts(candidate)] for candidate in batch])
            large = np.any(self._rms(raws @ coefficients) / lasts > least, axis=1)
            found += [
                (gain - candidate.cost, candidate)
                for gain, candidate, enough in zip(gains.tolist(), batch, large, strict=True)
                if enough
            ]
        found.sort(key=lambda pair: -pair[0])
        return [candidate for gain, candidate in found[:keep] if gain > 0.0]

    def residual(
        self, candidates: Sequence[Candidate], fitted_with: Sequence[Candidate] | None = None
    ) -> Array:
        """Return (T, n) what a fit of candidates to the samples of choice leaves everywhere.

        Args:
            candidates: The candidates.
            fitted_with: Candidates with which the model's own parameters are fitted, and then
                stay; by default these.
        """
        together = candidates if fitted_with is None else fitted_with
        theta = self.regression(together).coefficients(self._target)
        if fitted_with is not None:
            own_parameters = theta[: self.model_size]
            model = self._of_model.design @ own_parameters
            found = Regression(self.design(candidates), self._ridge(candidates), _TRACE)
            rest = found.coefficients(self._target - model)
            theta = np.concatenate([own_parameters, rest])
        columns = [self.data.model_columns, *(candidate.columns() for candidate in candidates)]
        return self.data.residual - np.concatenate(columns, axis=2) @ theta

    def solution(self, candidates: Sequence[Candidate]) -> tuple[Array, Array]:
        """Return the model's own parameters (d,) and those (k,) of candidates, fitted together."""
        theta = self.regression(candidates).coefficients(self._target)
        return theta[: self.model_size], theta[self.model_size :]

    def parameters(self, candidates: Sequence[Candidate]) -> Array:
        """Return parameters (k,) on all the samples of choice."""
        return self.solution(candidates)[1]

    def posterior(self, candidates: Sequence[Candidate]) -> tuple[Array, Array]:
        """Return mean (d + k,) and covariance of the model's directions and of parameters.

        Of Gaussian noise of which as many samples are independent as the residual's correlation
        leaves.
        """
        regression = self.regression(candidates)
        theta = regression.coefficients(self._target)
        error = self.out_of_fold(candidates)
        longer = float(
            np.max(self.significance.correlation(np.where(self.choice.usable, error, 0.0)))
        )
        return theta, self._prior_weight * longer * regression.inverse

    def fit(self, candidates: Sequence[Candidate]) -> tuple[Array, Array]:
        """Return parameters (k,) on all the samples of choice, and their covariance (k, k).

        See :func:`block_fit`; blocks are joined over four correlation times of the errors.
        """
        adds = [each.hypothesis.COHERENT_ERRORS for each in candidates for _ in range(each.size)]
        return block_fit(
            self.regression(candidates), self._target,
            np.repeat(self.choice.block // self._clustered, self.joints), self.choice.counts,
            own=self.model_size, prior=self._prior_weight,
            coherent=self.significance.settings.coherent * self.known_error * self.weight,
            adds=np.array(adds, dtype=bool),
        )  # fmt: skip

    def misfit(self, candidates: Sequence[Candidate]) -> float:
        """Return minus the log-likelihood of a fit to all the samples of choice."""
        regression = self.regression(candidates)
        theta = regression.coefficients(self._target)
        error = self._target - regression.design @ theta
        return self._negative_log_prior(theta) - self._likelihood_of(error)

    def of_choice(self, values: Array) -> Array:
        """Return the (R, n) rows of (T, n) values that the choice may see, zero where unusable."""
        return np.where(self.choice.usable, values[self.choice.rows], 0.0)

    def torque(self, candidate: Candidate, theta: Array) -> Array:
        """Return (R, n) torque of a candidate with (k,) parameters, zero where unusable."""
        torque = np.zeros((len(self.choice.rows), self.joints))
        torque[:, candidate.joints] = candidate.values[self.choice.rows] @ theta
        return torque * self.choice.usable

    def size(self, candidate: Candidate, theta: Array) -> Array:
        """Return (n,) RMS torque of a candidate with (k,) parameters over the samples of choice.

        Of what comes once over those in which it is there.
        """
        mean = (self.torque(candidate, theta) ** 2).sum(axis=0) / self.choice.counts
        return np.asarray(np.sqrt(mean / self._lasts(candidate)))
