"""Hypotheses against each other: cross-validated gain, paired block tests, continuous settings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity import effects
from dvrk_gravity.arm import N_JOINTS
from dvrk_gravity.diagnosis.bench import FOLDS, Bench
from dvrk_gravity.diagnosis.candidate import Candidate, Score
from dvrk_gravity.effects.effect import Effect, Hypothesis

Array = NDArray[np.float64]

_RIDGE = 1e-9
_NOTHING = 1e-12  # squared, of a weighted column: its parameter would have to be a million
_SAMPLES_PER_INDEPENDENT = 2.5
_FEWEST_BLOCKS = 10
_ACTIVE = 0.03  # of the most active block's energy
_LEAST_USABLE = 0.05  # part of the samples that a joint must have to be judged at all
_CONTAINED = 1e-3  # part of a torque that may lie outside another's columns
EDGE_STEP = 0.03  # s
_REACH = 0.6  # s, of the search for an edge
_PROFILE = 1.92  # log-likelihood: half the 95 % point of chi-squared


class Contest:
    """Scores sets of candidates on the samples that the choice may see.

    Attributes:
        bench: The bench.
        weight: (7,) one over the error of each joint, 1/(N·m); zero where it was not recorded.
    """

    def __init__(self, bench: Bench) -> None:
        """Set up the folds."""
        self.bench = bench
        order = np.argsort(bench.fold, kind="stable")  # in time within a fold
        self._rows = order[np.searchsorted(bench.fold[order], 0) :]
        fold = bench.fold[self._rows]
        edges = np.searchsorted(fold, np.arange(FOLDS + 1))
        self._folds = [
            slice(int(a) * N_JOINTS, int(b) * N_JOINTS) for a, b in pairwise(edges) if b > a
        ]
        self._block = bench.block[self._rows]
        self._residual = bench.residual[self._rows]
        self._usable = bench.usable[self._rows]
        self._counts = np.maximum(self._usable.sum(axis=0), 1)
        self._pairs = bench.pairs(self._rows)
        self._alike = np.zeros(N_JOINTS)  # (7,) correlation of what two copies leave
        self.weight = np.zeros(N_JOINTS)
        self.weigh(self._residual)

    @property
    def samples(self) -> Array:
        """(7,) independent samples of each joint, about."""
        # Of what comes back with the motion, the copies are no news (Kish's design effect).
        return self._counts / (self._part * (1.0 + (self.bench.copies - 1.0) * self._alike))

    @property
    def _part(self) -> float:
        return 1.0 if self.bench.band is None else _SAMPLES_PER_INDEPENDENT

    def _mean_square(self, error: Array) -> Array:
        """Return (7,) mean squares of (R, 7) errors over the usable samples."""
        return (error**2 * self._usable).sum(axis=0) / self._counts

    def weigh(self, residual: Array, final: bool = False) -> None:
        """Weigh the joints by (R, 7) residuals.

        Args:
            residual: What is left, N·m.
            final: All causes are in, so that what comes back with the motion is there to stay:
                copies of it count once. While causes are missing, it is theirs.
        """
        rms = np.sqrt(self._mean_square(residual))
        enough = self._usable.sum(axis=0) > _LEAST_USABLE * len(self._rows)
        present = self.bench.motion.present & (rms > 0.0) & enough
        self.weight = np.where(present, 1.0 / np.where(present, rms, 1.0), 0.0)
        self._alike = self._alike_copies(residual) if final else np.zeros(N_JOINTS)

    def _alike_copies(self, residual: Array) -> Array:
        """Return (7,) correlation of (R, 7) residuals with those a period later, at least 0."""
        mine, later = residual[self._pairs[0]], residual[self._pairs[1]]
        both = self._usable[self._pairs[0]] & self._usable[self._pairs[1]]
        square = np.where(both, 0.5 * (mine**2 + later**2), 0.0).sum(axis=0)
        alike = np.where(both, mine * later, 0.0).sum(axis=0) / np.maximum(square, 1e-300)
        return np.clip(alike, 0.0, 1.0)

    @cached_property
    def search_bases(self) -> Mapping[type[Effect], Any]:
        """What effects need to be searched for in a residual, by effect."""
        return {effect: effect.search_basis(self.bench) for effect in effects.effects()}

    def release(self) -> None:
        """Drop what is large and can be computed again: named effects have been searched for."""
        self.__dict__.pop("search_bases", None)
        self.bench.motion.release()

    def candidate(self, hypothesis: Hypothesis) -> Candidate:
        """Return a hypothesis with its columns."""
        columns = hypothesis.build(self.bench.motion, hypothesis.setting)
        return Candidate.of(hypothesis, self.bench.reduce(columns))

    def _design(self, candidates: Sequence[Candidate]) -> Array:
        columns = [c.columns(self._rows).reshape(-1, c.size) for c in candidates]
        weight = self._weights.reshape(-1)
        if not columns:
            return np.zeros((len(weight), 0))
        return np.hstack(columns) * weight[:, None]

    @property
    def _target(self) -> Array:
        return (self._residual * self._weights).reshape(-1)

    @property
    def _weights(self) -> Array:
        return self._usable * self.weight

    def _ridge(self, candidates: Sequence[Candidate]) -> Array:
        """Return (k, k) what is known of parameters before any data, in units of samples."""
        ridges = [np.zeros(0), *(one.ridge for one in candidates)]
        return np.diag(self._part * self.bench.copies * np.concatenate(ridges))

    def out_of_fold(self, candidates: Sequence[Candidate]) -> Array:
        """Return (R, 7) errors of the choice's samples, each from a fit that left its fold out."""
        design, target = self._design(candidates), self._target
        error = target.copy()
        if design.shape[1]:
            grams = [design[rows].T @ design[rows] for rows in self._folds]
            sides = [design[rows].T @ target[rows] for rows in self._folds]
            gram, side = sum(grams, self._ridge(candidates)), sum(sides)
            for rows, one_gram, one_side in zip(self._folds, grams, sides, strict=True):
                theta = _solve(gram - one_gram, side - one_side)
                error[rows] -= design[rows] @ theta
        weight = np.where(self.weight > 0.0, self.weight, 1.0)
        return error.reshape(-1, N_JOINTS) / weight

    def score(self, candidates: Sequence[Candidate]) -> Score:
        """Return the out-of-fold score of a set."""
        error = self.out_of_fold(candidates)
        mean = self._mean_square(error)
        used = self.weight > 0.0
        likelihood = -0.5 * float(self.samples[used] @ np.log(mean[used]))
        likelihood -= sum(candidate.cost for candidate in candidates)
        square = ((error * self._weights) ** 2).sum(axis=1)
        loss = np.bincount(self._block, square, minlength=self.bench.count).astype(float)
        return Score(error, np.sqrt(mean), loss, likelihood)

    def p_value(self, before: Score, after: Score, candidate: Candidate) -> float:
        """Return the one-sided p-value of the gain over the blocks where a candidate acts.

        The best of three tests, times three for having looked at all: a paired t-test and
        Wilcoxon's signed ranks over the blocks (gains that a few fast or loaded blocks dominate
        are clear to the latter only), and the likelihood ratio on unseen samples, counting as
        many of them as what is left unexplained leaves independent: few blocks can still be
        clear to it.
        """
        from scipy import stats

        ratio = after.likelihood + candidate.cost - before.likelihood
        ratio /= self._correlation(after.error, candidate.acts)
        p_values = [float(stats.chi2.sf(max(2.0 * ratio, 0.0), candidate.size))]
        square = (candidate.columns(self._rows) ** 2).sum(axis=2) * self.weight**2
        energy = np.bincount(self._block, square.sum(axis=1), minlength=self.bench.count)
        gain = (before.loss - after.loss)[energy > _ACTIVE * energy.max()]
        gain = gain[gain != 0.0]  # blocks in which friction holds the joint decide nothing
        if len(gain) >= _FEWEST_BLOCKS and np.std(gain) > 0.0:
            spread = np.std(gain, ddof=1) / np.sqrt(len(gain))
            p_values.append(float(stats.t.sf(np.mean(gain) / spread, len(gain) - 1)))
            p_values.append(float(stats.wilcoxon(gain, alternative="greater").pvalue))
        return min(1.0, 3.0 * min(p_values))

    def _correlation(self, error: Array, joints: NDArray[np.bool_]) -> float:
        """Return how many times longer than noise's the correlation of errors is, at least 1."""
        if self.bench.band is None:
            return 1.0
        longest = 1.0
        for column in (error * self._usable)[:, joints & (self.weight > 0.0)].T:
            power = np.abs(np.fft.rfft(column, 2 * len(column))) ** 2
            correlation = np.fft.irfft(power)[: len(column) // 4]
            correlation = correlation / max(correlation[0], 1e-300)
            end = int(np.argmax(correlation < 0.05)) or len(correlation)
            length = float(1.0 + 2.0 * correlation[1:end].sum())
            longest = max(longest, length / _SAMPLES_PER_INDEPENDENT)
        return longest

    def screen(
        self, accepted: Sequence[Candidate], pool: Iterable[Candidate], keep: int
    ) -> list[Candidate]:
        """Return the candidates of the pool that fit best beside the accepted ones, best first."""
        base, target = self._design(accepted), self._target
        gram = base.T @ base + self._ridge(accepted)
        if base.shape[1]:
            target = target - base @ _solve(gram, base.T @ target)
        square = (target**2).reshape(-1, N_JOINTS).sum(axis=0)
        found = []
        for candidate in pool:
            columns = self._design([candidate])
            if base.shape[1]:
                columns = columns - base @ _solve(gram, base.T @ columns)
            own = columns.T @ columns + self._ridge([candidate])
            error = target - columns @ _solve(own, columns.T @ target)
            left = (error**2).reshape(-1, N_JOINTS).sum(axis=0)
            used = (square > 0.0) & (left > 0.0)
            gain = 0.5 * float(self.samples[used] @ np.log(square[used] / left[used]))
            found.append((gain - candidate.cost, candidate))
        found.sort(key=lambda pair: -pair[0])
        return [candidate for gain, candidate in found[:keep] if gain > 0.0]

    def left(self, candidates: Sequence[Candidate]) -> Array:
        """Return (T, 7) what a fit of candidates to the samples of choice leaves everywhere."""
        left = self.bench.residual.copy()
        if candidates:
            theta = self.parameters(candidates)
            left -= np.concatenate([one.columns() for one in candidates], axis=2) @ theta
        return left

    def parameters(self, candidates: Sequence[Candidate]) -> Array:
        """Return parameters (k,) on all the samples of choice."""
        design = self._design(candidates)
        return _solve(design.T @ design + self._ridge(candidates), design.T @ self._target)

    def fit(self, candidates: Sequence[Candidate]) -> tuple[Array, Array]:
        """Return parameters (k,) on all the samples of choice, and their covariance (k, k).

        The covariance is the jackknife's over blocks: errors may be correlated within one, and
        parameters may be many beside the blocks (MacKinnon and White 1985, "HC3").
        """
        design, target = self._design(candidates), self._target
        block = np.repeat(self._block, N_JOINTS)
        order = np.argsort(block, kind="stable")
        edges = np.flatnonzero(np.diff(block[order], prepend=-1))[1:]
        pieces = list(
            zip(np.split(design[order], edges), np.split(target[order], edges), strict=True)
        )
        grams = [x.T @ x for x, _ in pieces]
        sides = [x.T @ y for x, y in pieces]
        gram, side = sum(grams, self._ridge(candidates)), np.sum(sides, axis=0)
        theta = _solve(gram, side)
        apart = np.array(
            [_solve(gram - g, side - s) - theta for g, s in zip(grams, sides, strict=True)]
        )
        return theta, (len(pieces) - 1) / len(pieces) * apart.T @ apart

    def contains(self, larger: Candidate, smaller: Candidate, rest: Sequence[Candidate]) -> bool:
        """Tell whether a larger hypothesis is a smaller one with needless parameters."""
        needless = larger.size > smaller.size
        return needless and self.overlap(smaller, larger, rest) > 1.0 - _CONTAINED

    def overlap(self, mine: Candidate, other: Candidate, rest: Sequence[Candidate]) -> float:
        """Return the part of a hypothesis' torque that another one's columns reproduce.

        Both are taken beside the rest: what that reproduces anyway does not count.
        """
        theta = self.parameters([*rest, mine])
        return self.reproduced(mine, theta[-mine.size :], other, rest)[0]

    def reproduced(
        self, mine: Candidate, theta: Array, other: Candidate, rest: Sequence[Candidate]
    ) -> tuple[float, Array]:
        """Return which part of a torque another's columns reproduce, and its (k,) parameters there.

        Args:
            mine: The hypothesis.
            theta: Its parameters.
            other: Another one.
            rest: What both are taken beside.
        """
        torque = self._design([mine]) @ theta
        columns, base = self._design([other]), self._design(rest)
        if base.shape[1]:
            gram = base.T @ base + self._ridge(rest)
            torque = torque - base @ _solve(gram, base.T @ torque)
            columns = columns - base @ _solve(gram, base.T @ columns)
        found = _solve(columns.T @ columns, columns.T @ torque)
        left = torque - columns @ found
        return 1.0 - float(left @ left) / max(float(torque @ torque), 1e-300), found

    def misfit(self, candidates: Sequence[Candidate]) -> float:
        """Return minus the log-likelihood of a fit to all the samples of choice."""
        design, target = self._design(candidates), self._target
        gram = design.T @ design + self._ridge(candidates)
        error = target - design @ _solve(gram, design.T @ target)
        mean = (error.reshape(-1, N_JOINTS) ** 2).sum(axis=0) / self._counts
        used = mean > 0.0
        return 0.5 * float(self.samples[used] @ np.log(mean[used]))

    def refined(self, candidate: Candidate, others: Sequence[Candidate]) -> Candidate:
        """Return a candidate with its non-linear settings at their best beside the others."""
        from scipy.optimize import minimize_scalar

        hypothesis = candidate.hypothesis
        for _ in range(3 if hypothesis.fixed_point else 0):
            theta, _covariance = self.fit([*others, candidate])
            named = hypothesis.describe(theta[-candidate.size :], hypothesis.setting)
            setting = dict(hypothesis.setting) | {n: named[n] for n in hypothesis.fixed_point}
            hypothesis = replace(hypothesis, setting=setting)
            candidate = self.candidate(hypothesis)
        for name in hypothesis.refine:
            if name in hypothesis.edges:
                middle = 0.5 * sum(self.plateau(candidate, others, name))
                candidate = self.rebuilt(hypothesis, name, middle)
                hypothesis = candidate.hypothesis
                continue
            centre = hypothesis.setting[name]
            low, high = hypothesis.search_range(name, self.bench.motion)

            def cost(value: float, hypothesis: Hypothesis = hypothesis, name: str = name) -> float:
                return self.misfit([*others, self.rebuilt(hypothesis, name, value)])

            best = minimize_scalar(
                cost, bounds=(low, high), method="bounded",
                options={"maxiter": 12, "xatol": 1e-3 * (high - low)},
            )  # fmt: skip
            if best.fun < cost(centre):
                hypothesis = replace(
                    hypothesis, setting={**hypothesis.setting, name: float(best.x)}
                )
                candidate = self.candidate(hypothesis)
        return candidate

    def plateau(
        self, candidate: Candidate, others: Sequence[Candidate], name: str
    ) -> tuple[float, float]:
        """Return the times, s, between which an edge explains as well: its 95 % profile interval.

        An edge within a block that is held out may be anywhere in it.
        """
        centre = candidate.hypothesis.setting[name]
        grid = centre + np.arange(-_REACH, _REACH + 0.5 * EDGE_STEP, EDGE_STEP)
        costs = np.array(
            [self.misfit([*others, self.rebuilt(candidate.hypothesis, name, t)]) for t in grid]
        )
        best = int(np.argmin(costs))
        # Only what hangs together with the best.
        outside = np.flatnonzero(costs > costs[best] + _PROFILE)
        low = int(outside[outside < best].max(initial=-1)) + 1
        high = int(outside[outside > best].min(initial=len(grid))) - 1
        return float(grid[low]), float(grid[high])

    def rebuilt(self, hypothesis: Hypothesis, name: str, value: float) -> Candidate:
        """Return a hypothesis with one setting changed."""
        return self.candidate(replace(hypothesis, setting={**hypothesis.setting, name: value}))


def _solve(gram: Array, side: Array) -> Array:
    """Return the least-squares solution of normal equations, scaled, with a trace of ridge."""
    if not len(gram):
        return np.zeros((0, *side.shape[1:]))
    # A column of nothing but round-off gets a parameter of zero.
    size = np.diag(gram)
    scale = np.where(size > _NOTHING, np.sqrt(np.maximum(size, _NOTHING)), np.inf)
    scaled = gram / np.outer(scale, scale)
    scaled[np.diag_indices_from(scaled)] += _RIDGE
    right = side / (scale if side.ndim == 1 else scale[:, None])
    solution = np.linalg.solve(scaled, right)
    return solution / (scale if side.ndim == 1 else scale[:, None])


def readiest(candidates: Sequence[tuple[float, Candidate]], tolerance: float) -> Candidate:
    """Return the simplest and most readily believed of those as good as the best.

    Args:
        candidates: (likelihood, candidate), any order.
        tolerance: How much worse than the best still counts as equal.
    """
    best = max(likelihood for likelihood, _ in candidates)
    equal = [(value, one) for value, one in candidates if value >= best - tolerance]
    return min(equal, key=lambda pair: (*readiness(pair[1]), -pair[0]))[1]


def readiness(candidate: Candidate) -> tuple[int, int]:
    """Return what orders causes that explain as well: the simplest and readiest come first."""
    return candidate.size, effects.rank(candidate.hypothesis.effect)
