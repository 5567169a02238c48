"""A hypothesis with its columns, and how a set of them does."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity import effects
from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.effects import MAX_REMOVED, Hypothesis
from dvrk_gravity.errors import EffectError

T = TypeVar("T")

# Log-likelihood that a parameter has to bring: half the logarithm of the number of independent
# samples (Schwarz 1978), 30 s of seven joints below 8 Hz: 0.5 ln(30 * 2 * 8 * 7) = 4.1.
PENALTY = 4.0


@dataclass(frozen=True, eq=False)
class Candidate:
    """A hypothesis with its reduced columns.

    Attributes:
        hypothesis: The claim.
        joints: (m,) indices of the joints that its torque acts on.
        values: (T, m, k) columns of torque at these, as filtered data compare them. Most act on one
            joint, and there are thousands of them.
        width: Number of joints n.
    """

    hypothesis: Hypothesis
    joints: NDArray[np.int_]
    values: Array
    width: int

    @classmethod
    def of(cls, hypothesis: Hypothesis, columns: Array) -> Candidate:
        """Return a hypothesis with its (T, n, k) columns, of all joints.

        Raises:
            EffectError: Columns of another shape, or not finite.
        """
        n = hypothesis.arm.n
        if np.ndim(columns) != 3 or columns.shape[1] != n:
            raise EffectError(
                hypothesis.effect,
                f"`regressor` returns shape {np.shape(columns)}, expected (N, {n}, k)",
            )
        acting = not_zero(columns.reshape(len(columns), -1)).reshape(n, -1)
        joints = np.flatnonzero(acting.any(axis=1))
        values = columns if len(joints) == columns.shape[1] else columns[:, joints]
        if not np.isfinite(values).all():
            raise EffectError(hypothesis.effect, f"`regressor` is not finite: {hypothesis}")
        return cls(hypothesis, joints, values, columns.shape[1])

    def with_values(self, values: Array) -> Candidate:
        """Return the same with (T', m k) other values of its columns, filtered and thinned out."""
        return replace(self, values=values.reshape(len(values), *self.values.shape[1:]))

    def columns(self, rows: NDArray[np.int_] | NDArray[np.bool_] | slice = slice(None)) -> Array:
        """Return (R, n, k) columns at some samples, by default at all."""
        values = self.values[rows]
        result = np.zeros((len(values), self.width, self.size))
        result[:, self.joints] = values
        return result

    @property
    def size(self) -> int:
        """Number of linear parameters."""
        return self.values.shape[2]

    @property
    def parameters(self) -> int:
        """Number of parameters, with those that are searched for."""
        return self.size + len(self.hypothesis.refine)

    @property
    def ridge(self) -> Array:
        """(k,) inverse variances of the parameters before any data."""
        size = self.hypothesis.prior_std
        return 1.0 / np.square(size) if size else np.zeros(self.size)

    @property
    def cost(self) -> float:
        """Log-likelihood that it has to bring before it is worth having."""
        return PENALTY * self.parameters + float(np.log(self.hypothesis.n_comparisons))

    @property
    def acts(self) -> NDArray[np.bool_]:
        """(n,) joints that its torque acts on."""
        return np.isin(np.arange(self.width), self.joints)


@dataclass(frozen=True, eq=False)
class Score:
    """How a set of candidates does on samples that each fit has not seen.

    Attributes:
        rms: (n,) out-of-fold error, N·m.
        loss: (blocks,) squared error of each block in units of the weights.
        likelihood: Sum over joints of -n/2 log(mean squared error), costs taken off.
        error: (R, n) the errors, N·m.
        negative_log_prior: Minus the log-density of the model's own parameters, taken off, too.
    """

    error: Array
    rms: Array
    loss: Array
    likelihood: float
    negative_log_prior: float


def most_parsimonious(equal: Sequence[tuple[float, Candidate]], clearly: float) -> Candidate:
    """Return one with the fewest parameters of those that are as good as each other.

    Of several with as few it is the best one, or the commonest of those hardly worse.

    Args:
        equal: (likelihood, candidate), any order.
        clearly: How much better one must be than a commoner one.
    """
    fewest = min(candidate.parameters for _, candidate in equal)
    simple = [(value, candidate) for value, candidate in equal if candidate.parameters == fewest]
    least = max(value for value, _ in simple) - clearly
    near = [(value, candidate) for value, candidate in simple if value >= least]
    return min(near, key=lambda pair: (effects.rank(pair[1].hypothesis.effect), -pair[0]))[1]


def slices_of(candidates: Sequence[Candidate]) -> list[slice]:
    """Return which of the parameters that all have together are each one's own."""
    edges = np.cumsum([0, *(candidate.size for candidate in candidates)]).tolist()
    return [slice(a, b) for a, b in pairwise(edges)]


def split(candidates: Sequence[Candidate], theta: Array) -> list[tuple[Candidate, Array]]:
    """Return each candidate with its own of the (k,) parameters that all have together."""
    return [(c, theta[rows]) for c, rows in zip(candidates, slices_of(candidates), strict=True)]


def are_possible(candidate: Candidate, fitted: Sequence[tuple[Candidate, Array]]) -> bool:
    """Return whether the parameters of a candidate are possible beside those of others.

    Dry and viscous friction may each be less than a model has; both together do not drive.
    """
    theta = next(values for other, values in fitted if other is candidate)
    hypothesis = candidate.hypothesis
    if hypothesis.removed_fraction(theta) == 0.0:
        return hypothesis.plausible(theta)
    less = sum(
        other.hypothesis.removed_fraction(values)
        for other, values in fitted
        if other.hypothesis.joints == hypothesis.joints
    )
    return hypothesis.plausible(theta) and less <= MAX_REMOVED


def not_zero(signals: Array) -> Mask:
    """Return (k,) which columns of (N, k) signals are not zero throughout: most soon show it."""
    found = np.asarray(np.any(signals[::100], axis=0))
    silent = np.flatnonzero(~found)
    found[silent] = np.any(signals[:, silent], axis=0)
    return found


def in_batches(items: Iterable[T], width: Callable[[T], int], columns: int) -> Iterator[list[T]]:
    """Yield items in their order, in batches of so many columns or a few more."""
    batch: list[T] = []
    wide = 0
    for item in items:
        batch.append(item)
        wide += width(item)
        if wide >= columns:
            yield batch
            batch, wide = [], 0
    if batch:
        yield batch
