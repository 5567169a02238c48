"""The samples that a choice may see."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.candidate import Candidate
from dvrk_gravity.diagnosis.data.filtered_data import FilteredData
from dvrk_gravity.estimation import NormalEquations


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
    def values(self) -> list[slice]:
        """Which of R n values, those of n joints in turn, are each fold's."""
        n = self.usable.shape[1]
        return [slice(rows.start * n, rows.stop * n) for rows in self.folds]

    @cached_property
    def of_model(self) -> list[NormalEquations]:
        """Sums of the model's columns over each fold, joint by joint."""
        usable = self.usable.astype(float)
        return [
            NormalEquations.of(self.model[rows], self.residual[rows], usable[rows])
            for rows in self.folds
        ]

    def weighted_sums(self, weight: Array) -> list[NormalEquations]:
        """Return the sums of the model's columns over each fold, with (n,) weights."""
        square, zero = weight**2, np.zeros(1)
        sums = (fold.combined(square) for fold in self.of_model)
        return [NormalEquations(gram[None], cross[None], zero, zero) for gram, cross in sums]

    def design(self, candidates: Sequence[Candidate], weights: Array) -> Array:
        """Return (R n, k) columns of candidates with (R, n) weights."""
        width = sum(candidate.size for candidate in candidates)
        columns, first = np.zeros((*weights.shape, width)), 0
        for candidate in candidates:
            own = slice(first, first + candidate.size)
            weight = weights[:, candidate.joints, None]
            columns[:, candidate.joints, own] = candidate.values[self.rows] * weight
            first = own.stop
        return columns.reshape(weights.size, width)
