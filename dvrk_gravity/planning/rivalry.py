"""Which motion separates rival explanations: the log Bayes factor expected between them.

Under either of two rivals, torques are Gaussian: Y m_i in the mean, with covariance R + Y P_i Y',
Y the columns of what else is uncertain and of both rivals, m_i and P_i what is known of their
factors. The log Bayes factor that is expected if the first is true is the Kullback-Leibler
divergence of the second from it (Kullback 1959; for choosing experiments, Box and Hill 1967).
It depends on the motion through G = integral of Y' R^-1 Y dt alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import Motion, State
from dvrk_gravity.planning.information import Knowledge, Objective

Passing = Callable[[State, Array], Motion]
"""From (N, n) states at (M,) times, s, to the motion that passes them.

N is a multiple of M: motions one after the other. Poses have a direction, and any times.
"""
STRONG = float(np.log(20.0))
"""Log Bayes factor of odds of 20 to one: strong evidence (Kass and Raftery 1995)."""
_CLEAR = 1.64  # standard errors of the log Bayes factor, as `diagnose` requires them (Vuong 1989)
_DRAWN = 1000  # sizes of a cause, of which chances are known to two per cent


@dataclass(frozen=True, eq=False)
class Rival:
    """One of several explanations of what a model lacks.

    Attributes:
        words: Its effect and where, as ``coulomb_friction at elbow_pitch``.
        columns: From a motion of N samples to its (N, n, k) torque by parameter, N·m.
        theta: (k,) its parameters as they were found.
        covariance: (k, k) of them.
    """

    words: str
    columns: Callable[[Motion], Array]
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


@dataclass(frozen=True, eq=False)
class Prediction:
    """What is known of the columns' factors if one rival is true, and what a motion makes of it.

    Attributes:
        root: (p, r) L, of whose product with L' the factors' covariance is.
        inside: (p, p) B = L (1 + L' G L)^-1 L'.
        log_determinant: Of what is inverted in B.
    """

    root: Array
    inside: Array
    log_determinant: float

    @classmethod
    def of(cls, gram: Array, root: Array) -> Prediction:
        """Return it for (p, p) G and (p, r) L."""
        # Of 1e12 times the noise a Cholesky factor may fail by rounding.
        values, vectors = np.linalg.eigh(np.eye(root.shape[1]) + root.T @ gram @ root)
        values = np.maximum(values, 1.0)
        half = (root @ vectors) / np.sqrt(values)
        return cls(root, half @ half.T, float(np.log(values).sum()))


def divergence(
    gram: Array, first: Prediction, second: Prediction, apart: Array
) -> tuple[float, Array]:
    """Return the divergence of the second Gaussian from the first, and its (p, p) slope by G.

    Args:
        gram: (p, p) G.
        first: If the first is true.
        second: If the second is.
        apart: (p,) difference of the factors' means.
    """
    beyond = second.inside
    # What the first expects of squares of factors about the second's mean.
    square = first.root @ first.root.T + np.outer(apart, apart)
    left = np.eye(len(gram)) - beyond @ gram
    expected = left @ square
    value = np.sum(gram * expected) - np.sum(beyond * gram)
    slope = expected @ left.T + beyond @ gram @ beyond - first.inside
    return 0.5 * float(value + second.log_determinant - first.log_determinant), 0.5 * slope


def chance(gram: Array, first: Prediction, second: Prediction, apart: Array) -> float:
    """Return the probability that evidence will be clear if the first is true.

    Clear is what `diagnose` requires: odds of 20 to one, and 1.64 standard errors. For factors as
    the first expects them the log Bayes factor is about normal, its variance that of the noise
    along what the second cannot reproduce. Arguments as for :func:`divergence`.
    """
    from scipy.special import ndtr

    random = np.random.default_rng(0)
    off = first.root @ random.normal(size=(first.root.shape[1], _DRAWN))
    near, far = (
        np.sum(factors * ((gram - gram @ of.inside @ gram) @ factors), axis=0)
        for factors, of in ((off, first), (off + apart[:, None], second))
    )
    freedom = second.log_determinant - first.log_determinant
    freedom += float(np.sum(gram * (first.inside - second.inside)))
    spread = np.sqrt(np.maximum(far, 1e-12))
    beyond = 0.5 * (far - near + freedom) - np.maximum(STRONG, _CLEAR * spread)
    return float(np.mean(ndtr(beyond / spread)))


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
        passing: Passing,
        noise: Array,
        uncertain: Knowledge | None = None,
        time: Array | None = None,
    ) -> None:
        """Lay out the columns.

        Args:
            arm: The arm.
            rivalries: At least one.
            passing: What rivals see of states.
            noise: (n,) variance of the mean torque of a second, (N·m)^2 s.
            uncertain: What a model is uncertain of; ``None``: nothing.
            time: (M,) times of states, s; ``None``: poses, each for itself.
        """
        self.arm, self.noise, self.rivalries, self._passing = arm, noise, rivalries, passing
        self._uncertain, self._time = uncertain, time
        rivals = {id(each): each for pair in rivalries for each in (pair.first, pair.second)}
        self._rivals = tuple(rivals.values())
        shared = 0 if uncertain is None else uncertain.rows.shape[1]
        edges = (shared + np.cumsum([0, *(len(each.theta) for each in self._rivals)])).tolist()
        self._roots, means = [], []
        for rival, own in zip(self._rivals, map(slice, edges, edges[1:]), strict=True):
            root = np.zeros((edges[-1], shared + len(rival.theta)))
            root[:shared, :shared] = np.eye(shared)
            root[own, shared:] = _root(rival.covariance)
            self._roots.append(root)
            means.append(np.zeros(edges[-1]))
            means[-1][own] = rival.theta
        number = {key: k for k, key in enumerate(rivals)}
        self._pairs = [(number[id(each.first)], number[id(each.second)]) for each in rivalries]
        self._means = np.array(means)

    def over(self, time: Array) -> Separation:
        """Return the objective of motions that are looked at at (M,) times, s."""
        return Separation(
            self.arm, self.rivalries, self._passing, self.noise, self._uncertain, time
        )  # fmt: skip

    def regressor(self, state: State) -> Array:
        """Return the torques of what the model is uncertain of, then those of the rivals."""
        time = np.zeros(len(state.q)) if self._time is None else self._time
        parts = [] if self._uncertain is None else [self._uncertain.regressor(state)]
        motion = self._passing(state, time)
        parts += [rival.columns(motion) for rival in self._rivals]
        return np.concatenate(parts, axis=-1)

    def score(self, gram: Array) -> tuple[float, Array]:
        """Return the sum of log(1 + K) over both senses of all rivalries, and its slope."""
        total, slope = 0.0, np.zeros_like(gram)
        for sense in chain.from_iterable(self._senses(gram)):
            value, by = divergence(gram, *sense)
            total += float(np.log1p(max(value, 0.0)))
            slope += by / (1.0 + max(value, 0.0))
        return total, slope

    def expected(self, gram: Array) -> list[tuple[float, float]]:
        """Return of each rivalry the log Bayes factor expected, and the chance of clear evidence.

        The lesser of each, whichever of the two is true.
        """
        result = []
        for senses in self._senses(gram):
            values = [divergence(gram, *sense)[0] for sense in senses]
            result.append((min(values), min(chance(gram, *sense) for sense in senses)))
        return result

    def _senses(self, gram: Array) -> Iterator[list[tuple[Prediction, Prediction, Array]]]:
        """Yield of each rivalry what is true, the other, and what is between, in both senses."""
        found = [Prediction.of(gram, root) for root in self._roots]
        for first, second in self._pairs:
            apart = self._means[first] - self._means[second]
            yield [(found[first], found[second], apart), (found[second], found[first], apart)]
