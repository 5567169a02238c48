"""Fits of many choices of columns with each of some folds left out in turn."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.estimation.normal_equations import (
    EXCHANGES,
    NormalEquations,
    prior_precision,
    solve_signed,
)
from dvrk_gravity.estimation.splits import Folds


@dataclass(frozen=True, eq=False)
class FoldSums:
    """Columns and values in folds, with sums of products over them when they are first asked for.

    Attributes:
        x: (n, m, p) columns.
        y: (n, m) values.
        folds: What is held out.
        weight: (n, m) weights of the samples in a fit.
        counted: (n, m) weights in the held-out errors; ``None``: those in a fit.
    """

    x: Array
    y: Array
    folds: Folds
    weight: Array
    counted: Array | None = None

    @cached_property
    def whole(self) -> NormalEquations:
        """Sums over all samples."""
        return NormalEquations.of(self.x, self.y, self.weight)

    @cached_property
    def test(self) -> list[NormalEquations]:
        """Sums over each fold's held-out samples."""
        return self.of(self.folds.tested, self.weight if self.counted is None else self.counted)

    @cached_property
    def held_out(self) -> HeldOutSums:
        """Errors on each fold's held-out samples."""
        return HeldOutSums(self.test)

    @cached_property
    def train(self) -> list[NormalEquations]:
        """Sums that each fold's fit sees."""
        same = self.counted is None and self.folds.excluded is self.folds.tested
        unseen = self.test if same else self.of(self.folds.excluded, self.weight)
        return [self.whole - part for part in unseen]

    def of(self, rows: Iterable[Mask], weight: Array) -> list[NormalEquations]:
        """Return the sums over the samples in each (n,) mask, with (n, m) weights."""
        return [NormalEquations.of(self.x[part], self.y[part], weight[part]) for part in rows]

    def predicted(
        self, solve: Callable[[NormalEquations], Array], chosen: Sequence[int] | None = None
    ) -> Array:
        """Return (n, m) values, each predicted by the fit that had not seen it.

        Args:
            solve: From the sums of columns to their coefficients.
            chosen: The columns; by default all.
        """
        predicted = np.empty_like(self.y)
        for rows, train in zip(self.folds.tested, self.train, strict=True):
            if chosen is None:
                predicted[rows] = self.x[rows] @ solve(train)
            else:
                predicted[rows] = self.x[rows][:, :, list(chosen)] @ solve(train.select(chosen))
        return predicted


def combined_folds(folds: Sequence[NormalEquations], weight: Array) -> tuple[Array, Array]:
    """Return (folds, p, p) and (folds, p) sums of each fold, channels added up by (m,) weights."""
    grams, crosses = zip(*(fold.combined(weight) for fold in folds), strict=True)
    return np.array(grams), np.array(crosses)


def fit_folds(
    gram: Array, cross: Array, chosen: NDArray[np.int64], scale: Array, mean: Array
) -> Array:
    """Return (folds, p) coefficients of k columns with a prior, those of others zero.

    Args:
        gram: (folds, p, p) what each fold's fit sees, see :func:`combined_folds`.
        cross: (folds, p) likewise.
        chosen: (k,) the columns.
        scale: (k,) prior standard deviations.
        mean: (k,) prior means.
    """
    part = gram[:, chosen[:, None], chosen]
    prior = prior_precision(part, scale)
    theta = np.zeros(cross.shape)
    right = cross[:, chosen] + prior @ mean
    theta[:, chosen] = np.linalg.solve(part + prior, right[:, :, None])[:, :, 0]
    return theta


class HeldOutSums:
    """Sums of products over the held-out samples of each fold, for the errors of many fits."""

    def __init__(self, folds: Sequence[NormalEquations]) -> None:
        """Keep the columns that are not zero in each channel: few are."""
        self._power = np.array([fold.power for fold in folds])
        self._channels = []
        for j in range(self._power.shape[1]):
            used = np.flatnonzero(np.any([np.diag(fold.gram[j]) for fold in folds], axis=0))
            gram = np.array([fold.gram[j][used[:, None], used] for fold in folds])
            cross = np.array([fold.cross[j][used] for fold in folds])
            self._channels.append((used, gram, cross))

    def error(self, theta: Array) -> Array:
        """Return (..., folds, m) weighted squared errors of (..., folds, p) coefficients."""
        many = theta.reshape(-1, *theta.shape[-2:])
        explained = np.empty((len(many), *self._power.shape))
        for j, (used, gram, cross) in enumerate(self._channels):
            coefficients = many[:, :, used].transpose(1, 2, 0)
            factor = 2.0 * cross[:, :, None] - np.matmul(gram, coefficients)
            explained[:, :, j] = (factor * coefficients).sum(axis=1).T
        errors = np.maximum(self._power - explained, 0.0)
        return errors.reshape(*theta.shape[:-1], errors.shape[-1])


class SignedFits:
    """Fits with a prior and with sign constraints, each fold left out in turn.

    Attributes:
        precision: (folds, p, p) normal equations' matrices, prior included.
        right: (folds, p) their right sides.
        positive: (p,) coefficients that must not be negative.
    """

    def __init__(
        self, gram: Array, cross: Array, scale: Array, positive: NDArray[np.bool_]
    ) -> None:
        """Add the prior, of (p,) standard deviations about zero, to what each fold's fit sees.

        See :func:`combined_folds`.
        """
        self.precision = gram + prior_precision(gram, scale)
        self.right = cross
        self.positive = positive
        # The active set rarely changes from one fit to the next.
        self._free = np.ones(self.right.shape, dtype=bool)

    def fit(self, chosen: Sequence[int]) -> Array:
        """Return (folds, p) coefficients of some columns, those of others zero."""
        index = np.array(chosen)
        return np.array([self._fit_fold(fold, index) for fold in range(len(self.right))])

    def fit_near(self, chosen: Sequence[int], others: Sequence[Sequence[int]]) -> Array:
        """Return (others, folds, p) coefficients of choices of columns close to ``chosen``.

        Each follows from those of ``chosen`` by a principal pivot; it is solved again only if its
        sign constraints are not satisfied then.
        """
        pivoted = _Pivoted(self.precision, self.right, self.fit(chosen))
        theta = np.empty((len(others), *self.right.shape))
        for found, other in zip(theta, others, strict=True):
            inside = np.zeros(self.right.shape[1], dtype=bool)
            inside[list(other)] = True
            come = inside.copy()
            come[list(chosen)] = False
            free = pivoted.free & inside | come
            for _ in range(EXCHANGES):
                found[:], slope = pivoted.exchanged(free)
                wrong = self.positive & inside & np.where(free, found < 0.0, slope > 0.0)
                if not wrong.any():
                    break
                free ^= wrong
            for fold in np.flatnonzero(wrong.any(axis=1)):
                found[fold] = self._fit_fold(int(fold), np.flatnonzero(inside))
        return theta

    def _fit_fold(self, fold: int, index: NDArray[np.int64]) -> Array:
        theta = np.zeros(self.right.shape[1])
        precision = self.precision[fold, index[:, None], index]
        theta[index], self._free[fold, index] = solve_signed(
            precision, self.right[fold, index], self.positive[index], self._free[fold, index]
        )
        return theta


class _Pivoted:
    """Normal equations of folds, solved for some of the columns.

    Of a coefficient theta and the slope s = right - precision theta of its column, one is zero:
    theta if the column is out, s if it is in. The others are affine functions ``value - table x``
    of these zeros x. A column that enters or leaves exchanges the roles of its theta and s: a
    principal pivot (Tsatsomeros 2000, "Principal pivot transforms").
    """

    def __init__(self, precision: Array, right: Array, theta: Array) -> None:
        """Solve for the columns whose (folds, p) coefficients theta are not zero.

        In units in which the precision's diagonals are ones: coefficients differ by powers of ten.
        """
        self.unit = np.sqrt(np.diagonal(precision, axis1=1, axis2=2))
        scaled = precision / (self.unit[:, :, None] * self.unit[:, None, :])
        self.free = theta != 0.0
        self.value = np.where(self.free, theta * self.unit, 0.0)
        slope = right / self.unit - np.matmul(scaled, self.value[:, :, None])[:, :, 0]
        self.value = np.where(self.free, self.value, slope)
        self.table = np.empty(scaled.shape)
        for table, gram, free in zip(self.table, scaled, self.free, strict=True):
            inside, out = np.flatnonzero(free)[:, None], np.flatnonzero(~free)[:, None]
            inverse = np.linalg.inv(gram[inside, inside.T])
            through = inverse @ gram[inside, out.T]
            table[inside, inside.T] = inverse
            table[inside, out.T] = through
            table[out, inside.T] = -through.T
            table[out, out.T] = gram[out, out.T] - gram[out, inside.T] @ through

    def exchanged(self, free: NDArray[np.bool_]) -> tuple[Array, Array]:
        """Return (folds, p) coefficients of the columns in a mask, and slopes of others."""
        swap = free ^ self.free
        which = np.flatnonzero(swap.any(axis=0))
        swap = swap[:, which]
        # A fold in which a column stays where it is has an equation x = 0 in its place.
        among = np.where(swap[:, :, None], self.table[:, which[:, None], which], np.eye(len(which)))
        target = np.where(swap, self.value[:, which], 0.0)
        new = np.linalg.solve(among, target[:, :, None])
        value = self.value - np.matmul(self.table[:, :, which], new)[:, :, 0]
        value[:, which] = np.where(swap, new[:, :, 0], value[:, which])
        return np.where(free, value, 0.0) / self.unit, np.where(free, 0.0, value) * self.unit
