"""The samples that a choice may see, and parameters with their covariance from blocks."""

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
from dvrk_gravity.estimation import NORMAL_95, NormalEquations, Regression, block_jackknife


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
