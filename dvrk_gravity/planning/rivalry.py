"""Which motion separates rival explanations: the log Bayes factor expected between them.

Under either of two rivals, torques are Gaussian: Y m_i in the mean, with covariance R + Y P_i Y',
Y the columns of what else is uncertain and of both rivals, m_i and P_i what is known of their
factors. The log Bayes factor that is expected if the first is true is the Kullback-Leibler
divergence of the second from it (Kullback 1959; for choosing experiments, Box and Hill 1967).
It depends on the motion through G = integral of Y' R^-1 Y dt alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import State
from dvrk_gravity.planning.information import Knowledge, Objective

STRONG = float(np.log(20.0))
"""Log Bayes factor of odds of 20 to one: strong evidence (Kass and Raftery 1995)."""


@dataclass(frozen=True, eq=False)
class Rival:
    """One of several explanations of what a model lacks.

    Attributes:
        words: Its effect and where, as ``coulomb_friction at elbow_pitch``.
        columns: From (N, n) states at (M,) times, s, to its (N, n, k) torque by parameter, N·m. N
            is a multiple of M: motions one after the other.
        theta: (k,) its parameters as they were found.
        covariance: (k, k) of them.
    """

    words: str
    columns: Callable[[State, Array], Array]
    theta: Array
    covariance: Array


@dataclass(frozen=True, eq=False)
class Rivalry:
    """Two explanations that recordings could not separate.

    Attributes:
        first: One.
        second: The other.
        again: Log Bayes factor that the diagnosed motion is expected to give if it is recorded
            again; ``None``: not known.
    """

    first: Rival
    second: Rival
    again: float | None = None

    @property
    def words(self) -> str:
        """The two in words."""
        return f"{self.first.words} or {self.second.words}"


def divergence(gram: Array, first: Array, second: Array, apart: Array) -> tuple[float, Array]:
    """Return the divergence of the second Gaussian from the first, and its (p, p) slope by G.

    Args:
        gram: (p, p) G.
        first: (p, r) L, of the covariance L L' of the columns' factors if the first is true.
        second: (p, s) likewise of the second.
        apart: (p,) difference of their means.
    """
    inside, log_first = _inside(gram, first)
    beyond, log_second = _inside(gram, second)
    # What the first expects of squares of factors about the second's mean.
    square = first @ first.T + np.outer(apart, apart)
    left = np.eye(len(gram)) - beyond @ gram
    value = np.sum(gram * (left @ square)) - np.sum(beyond * gram)
    slope = left @ square @ left.T + beyond @ gram @ beyond - inside
    return 0.5 * float(value + log_second - log_first), 0.5 * slope


def _inside(gram: Array, root: Array) -> tuple[Array, float]:
    """Return B = L (1 + L' G L)^-1 L', and the logarithm of the determinant in it."""
    factor = np.linalg.cholesky(np.eye(root.shape[1]) + root.T @ gram @ root)
    half = np.linalg.solve(factor, root.T)
    return half.T @ half, 2.0 * float(np.log(np.diag(factor)).sum())


def _root(covariance: Array) -> Array:
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


class Separation(Objective):
    """The log Bayes factors that a motion is expected to give, in either sense of each rivalry.

    The value is the sum of log(1 + K): what separates poorly counts most, and what nothing
    separates counts little.
    """

    def __init__(
        self,
        arm: Arm,
        rivalries: Sequence[Rivalry],
        noise: Array,
        uncertain: Knowledge | None = None,
        time: Array | None = None,
    ) -> None:
        """Lay out the columns.

        Args:
            arm: The arm.
            rivalries: At least one.
            noise: (n,) variance of the mean torque of a second, (N·m)^2 s.
            uncertain: What a model is uncertain of; ``None``: nothing.
            time: (M,) times of states, s; ``None``: poses, each for itself.
        """
        self.arm, self.noise, self.rivalries = arm, noise, tuple(rivalries)
        self._uncertain, self._time = uncertain, time
        rivals = {id(each): each for pair in rivalries for each in (pair.first, pair.second)}
        self._rivals = tuple(rivals.values())
        shared = 0 if uncertain is None else uncertain.rows.shape[1]
        edges = shared + np.cumsum([0, *(len(each.theta) for each in self._rivals)])
        own = dict(zip(rivals, map(np.arange, edges[:-1], edges[1:]), strict=True))
        self._pairs = [
            _Pair.of(pair, shared, own[id(pair.first)], own[id(pair.second)]) for pair in rivalries
        ]

    def over(self, time: Array) -> Separation:
        """Return the objective of motions that are looked at at (M,) times, s."""
        return Separation(self.arm, self.rivalries, self.noise, self._uncertain, time)

    def regressor(self, state: State) -> Array:
        """Return the torques of what the model is uncertain of, then those of the rivals."""
        time = np.zeros(len(state.q)) if self._time is None else self._time
        parts = [] if self._uncertain is None else [self._uncertain.regressor(state)]
        parts += [rival.columns(state, time) for rival in self._rivals]
        return np.concatenate(parts, axis=-1)

    def score(self, gram: Array) -> tuple[float, Array]:
        """Return the sum of log(1 + K) over both senses of all rivalries, and its slope."""
        total, slope = 0.0, np.zeros_like(gram)
        for pair in self._pairs:
            for value, by in pair.divergences(gram):
                total += float(np.log1p(max(value, 0.0)))
                slope[pair.grid] += by / (1.0 + max(value, 0.0))
        return total, slope

    def expected(self, gram: Array) -> list[float]:
        """Return of each rivalry the lesser of both log Bayes factors that are expected."""
        return [min(value for value, _ in pair.divergences(gram)) for pair in self._pairs]


@dataclass(frozen=True, eq=False)
class _Pair:
    """Where a rivalry's columns are among all, and what is known of their factors."""

    grid: tuple[NDArray[np.int_], NDArray[np.int_]]
    first: Array
    second: Array
    apart: Array

    @classmethod
    def of(
        cls, pair: Rivalry, shared: int, first: NDArray[np.int_], second: NDArray[np.int_]
    ) -> _Pair:
        columns = np.concatenate([np.arange(shared), first, second])
        split = shared + len(first)
        roots = []
        for rival, own in ((pair.first, slice(shared, split)), (pair.second, slice(split, None))):
            size = len(rival.theta)
            root = np.zeros((len(columns), shared + size))
            root[:shared, :shared] = np.eye(shared)
            root[own, shared:] = _root(rival.covariance)
            roots.append(root)
        apart = np.concatenate([np.zeros(shared), pair.first.theta, -pair.second.theta])
        a, b = np.ix_(columns, columns)
        return cls((a, b), roots[0], roots[1], apart)

    def divergences(self, gram: Array) -> list[tuple[float, Array]]:
        """Return the divergence and its slope if the first is true, and if the second is."""
        own = gram[self.grid]
        return [
            divergence(own, self.first, self.second, self.apart),
            divergence(own, self.second, self.first, self.apart),
        ]
