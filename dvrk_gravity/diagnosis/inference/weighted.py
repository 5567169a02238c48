"""The samples that a choice may see, under one weighting of the joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.candidate import Candidate
from dvrk_gravity.estimation import NormalEquations, Regression


@dataclass(frozen=True, eq=False)
class WeightedSamples:
    """Weighted residuals and columns; those of the model itself are summed once, when asked for.

    Attributes:
        weights: (R, n) of R samples of n joints, 1/(N·m); zero where nothing can be said.
        residual: (R, n) N·m.
        model: (R, n, d) columns of the model's own parameters.
        rows: (R,) which of all samples these are.
        folds: Those of each fold, of R n values.
        ridge: (d, d) what is known of the model's parameters before any data.
        trace: See :func:`normal_equations.solve`.
    """

    weights: Array
    residual: Array
    model: Array
    rows: NDArray[np.int64]
    folds: Sequence[slice]
    ridge: Array
    trace: float

    @cached_property
    def target(self) -> Array:
        """(R n,) weighted residuals."""
        return (self.residual * self.weights).reshape(-1)

    @cached_property
    def of_model(self) -> Regression:
        """The least squares of the model's own parameters alone."""
        design = self.model.reshape(self.weights.size, -1) * self.weights.reshape(-1)[:, None]
        return Regression(design, self.ridge, self.trace)

    @cached_property
    def _folds_of_model(self) -> list[NormalEquations]:
        """The sums of the same over each fold."""
        design, target = self.of_model.design[:, None], self.target[:, None]
        return [NormalEquations.of(design[rows], target[rows]) for rows in self.folds]

    def design(self, candidates: Sequence[Candidate]) -> Array:
        """Return (R n, k) weighted columns of candidates."""
        width = sum(candidate.size for candidate in candidates)
        columns, first = np.zeros((*self.weights.shape, width)), 0
        for candidate in candidates:
            own = slice(first, first + candidate.size)
            weight = self.weights[:, candidate.joints, None]
            columns[:, candidate.joints, own] = candidate.values[self.rows] * weight
            first = own.stop
        return columns.reshape(self.weights.size, width)

    def by_fold(self, columns: Array) -> list[NormalEquations]:
        """Return the sums of the model's columns and then (R n, k) others over each fold."""
        design, target = self.of_model.design[:, None], self.target[:, None]
        return [
            fold.extended(design[rows], columns[rows, None], target[rows])
            for rows, fold in zip(self.folds, self._folds_of_model, strict=True)
        ]
