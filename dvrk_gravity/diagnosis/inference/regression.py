"""Weighted least squares of columns, and parameters with their covariance from blocks."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.candidate import Candidate
from dvrk_gravity.diagnosis.data.filtered_data import FilteredData
from dvrk_gravity.effects import Estimate, Hypothesis
from dvrk_gravity.estimation import NORMAL_95, NormalEquations, Regression, block_jackknife

_DRAWS = 400  # of parameters, for intervals of what is derived from them: ten lie beyond either end
_WIDEST = 100.0  # times a positive setting: as wide an interval says that nothing is known. Chosen


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


@dataclass(frozen=True, eq=False)
class ChoiceSamples:
    """The samples that fit and choice may see, fold by fold.

    Attributes:
        rows: (R,) which of all samples these are.
        folds: Those of each fold.
        block: (R,) number of the block.
        residual: (R, n) N·m.
        usable: (R, n) of which something can be said.
        model: (R, n, d) columns of the model's own parameters.
        pairs: (P,) and (P,) samples that are whole periods apart.
    """

    rows: NDArray[np.int64]
    folds: tuple[slice, ...]
    block: NDArray[np.int64]
    residual: Array
    usable: NDArray[np.bool_]
    model: Array
    pairs: tuple[NDArray[np.int64], NDArray[np.int64]]

    @classmethod
    def of(cls, data: FilteredData) -> ChoiceSamples:
        """Take the samples of all folds."""
        order = np.argsort(data.fold, kind="stable")  # in time within a fold
        rows = order[np.searchsorted(data.fold[order], 0) :]
        edges = np.searchsorted(data.fold[rows], np.arange(data.blocks.settings.folds + 1))
        return cls(
            rows, tuple(slice(int(a), int(b)) for a, b in pairwise(edges) if b > a),
            data.block[rows], data.residual[rows], data.usable[rows], data.model_columns[rows],
            data.pairs(rows),
        )  # fmt: skip

    @cached_property
    def counts(self) -> Array:
        """(n,) usable samples, at least one."""
        return np.asarray(np.maximum(self.usable.sum(axis=0), 1))

    @cached_property
    def of_model(self) -> list[NormalEquations]:
        """Sums of the model's columns over each fold, joint by joint."""
        usable = self.usable.astype(float)
        return [
            NormalEquations.of(self.model[rows], self.residual[rows], usable[rows])
            for rows in self.folds
        ]


@dataclass(frozen=True, eq=False)
class WeightedSamples:
    """The same with a weight for each joint.

    Attributes:
        samples: The samples.
        weight: (n,) 1/(N·m); zero where nothing can be said.
        ridge: (d, d) what is known of the model's parameters before any data.
        trace: See :func:`normal_equations.solve`.
    """

    samples: ChoiceSamples
    weight: Array
    ridge: Array
    trace: float

    @cached_property
    def weights(self) -> Array:
        """(R, n) 1/(N·m); zero where nothing can be said."""
        return np.asarray(self.samples.usable * self.weight)

    @cached_property
    def folds(self) -> list[slice]:
        """Which of the R n values are each fold's."""
        n = len(self.weight)
        return [slice(rows.start * n, rows.stop * n) for rows in self.samples.folds]

    @cached_property
    def target(self) -> Array:
        """(R n,) weighted residuals."""
        return (self.samples.residual * self.weights).reshape(-1)

    @cached_property
    def of_model(self) -> Regression:
        """The least squares of the model's own parameters alone."""
        design = self.samples.model.reshape(self.weights.size, -1) * self.weights.reshape(-1, 1)
        products = NormalEquations.total(self._folds_of_model).gram[0]
        return Regression(design, self.ridge, self.trace, products)

    @cached_property
    def _folds_of_model(self) -> list[NormalEquations]:
        square, zero = self.weight**2, np.zeros(1)
        sums = (fold.combined(square) for fold in self.samples.of_model)
        return [NormalEquations(gram[None], cross[None], zero, zero) for gram, cross in sums]

    def design(self, candidates: Sequence[Candidate]) -> Array:
        """Return (R n, k) weighted columns of candidates."""
        width = sum(candidate.size for candidate in candidates)
        columns, first = np.zeros((*self.weights.shape, width)), 0
        for candidate in candidates:
            own = slice(first, first + candidate.size)
            weight = self.weights[:, candidate.joints, None]
            columns[:, candidate.joints, own] = candidate.values[self.samples.rows] * weight
            first = own.stop
        return columns.reshape(self.weights.size, width)

    def by_fold(self, columns: Array) -> list[NormalEquations]:
        """Return the sums of the model's columns and then (R n, k) others over each fold."""
        design, target = self.of_model.design[:, None], self.target[:, None]
        return [
            fold.extended(design[rows], columns[rows, None], target[rows])
            for rows, fold in zip(self.folds, self._folds_of_model, strict=True)
        ]


def estimates(
    hypothesis: Hypothesis, theta: Array, covariance: Array, spread: Mapping[str, float]
) -> dict[str, Estimate]:
    """Return the named parameters with 95 % intervals.

    Args:
        hypothesis: The hypothesis.
        theta: (k,) linear parameters.
        covariance: (k, k) of them.
        spread: Standard deviations of the settings that were searched for.
    """
    random = np.random.default_rng(0)
    drawn = random.multivariate_normal(theta, covariance, _DRAWS, method="eigh")
    middle = hypothesis.parameters(theta)
    draws = [hypothesis.parameters(draw) for draw in drawn]
    result = {}
    for name, value in middle.items():
        if not hypothesis.meaning(name).reported:
            continue
        if name in spread and name in hypothesis.refine:
            low, high = _interval(value, spread[name], hypothesis.meaning(name).positive)
        else:
            low, high = np.percentile([draw[name] for draw in draws], [2.5, 97.5])
        unit = hypothesis.unit(name)
        result[name] = Estimate(value, float(min(low, value)), float(max(high, value)), unit)
    return result


def _interval(value: float, spread: float, positive: bool) -> tuple[float, float]:
    """Return the 95 % interval of a setting with a standard deviation.

    That of a positive one is even in its logarithm (Meeker and Escobar 1998, Statistical Methods
    for Reliability Data, chapter 7): no time constant is below zero.
    """
    if positive and value > 0.0:
        factor = math.exp(min(NORMAL_95 * spread / value, math.log(_WIDEST)))
        return value / factor, value * factor
    return value - NORMAL_95 * spread, value + NORMAL_95 * spread
