"""Which motion separates competing explanations: the evidence that `diagnose` is expected to find.

Under either of two causes, torques are Gaussian: Y m_i in the mean, with covariance R + Y P_i Y',
Y the columns of what else is uncertain and of both causes, m_i and P_i what is known of their
factors. What was found of the first is then at some distance from all that the second explains: the
least of |d - L z|^2 + |z|^2 over z, d = m_1 - m_2 by G = integral of Y' R^-1 Y dt, and L L' = P_2.
Half of that is the log-likelihood that is expected to separate fits of them (Vuong 1989). A Bayes
factor would also count how widely each was spread before; `diagnose` does not.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis import FittedHypothesis
from dvrk_gravity.effects import Motion, State
from dvrk_gravity.planning.information import Knowledge, Objective

MotionFactory = Callable[[State, Array], Motion]
"""From (N, n) states at (M,) times, s, to the motion that passes them.

N is a multiple of M: motions one after the other. Poses have a direction, and any times.
"""
STRONG = float(np.log(20.0))
"""Log-likelihood of odds of 20 to one: strong evidence (Kass and Raftery 1995)."""
_CLEAR = 1.64  # standard errors of the evidence, as `diagnose` requires them (Vuong 1989)
# Evidence from which on more of it hardly counts: where its mean less 1.64 standard deviations,
# sqrt(2 K), is STRONG, so that it is clear in 95 %.
_ENOUGH = 10.5
# Steps to the nearest: of columns of 1e6 times the noise, a curve of degree 6 far beyond where it
# was fitted, the first is off by rounding, and four settle all digits shown. None leads away.
_REFINED = 4
_DRAWN = 1000  # sizes of a cause, of which chances are known to two per cent
# How much more of a motion than of random states in the same time: plans have 4.9 times as much
# information as the median of random motions (`benchmark/plan.py`).
_BEST = 5.0


@dataclass(frozen=True, eq=False)
class HypothesisPair:
    """Two explanations that recordings could not separate.

    Attributes:
        first: One.
        second: The other.
        required: Whether the first, and whether the second, is to be shown if it is true.
    """

    first: FittedHypothesis
    second: FittedHypothesis
    required: tuple[bool, bool] = (True, True)

    @property
    def names(self) -> tuple[str, str]:
        """The two in words."""
        return self.first.words, self.second.words


@dataclass(frozen=True, eq=False)
class Prediction:
    """What is known of the columns' factors if one cause is true, and what a motion makes of it.

    Attributes:
        root: (p, r) L, of whose product with L' the factors' covariance is.
        inverse: (r, r) of 1 + L' G L.
    """

    root: Array
    inverse: Array

    @classmethod
    def of(cls, gram: Array, root: Array) -> Prediction:
        """Return the prediction for a (p, p) Gram matrix G and (p, r) covariance root L."""
        # Of 1e12 times the noise a Cholesky factor may fail by rounding.
        values, vectors = np.linalg.eigh(np.eye(root.shape[1]) + root.T @ gram @ root)
        half = vectors / np.sqrt(np.maximum(values, 1.0))
        return cls(root, half @ half.T)

    def distance(self, gram: Array, factors: Array) -> tuple[Array, Array]:
        """Return (N,) squared distances of (p, N) factors from what is known, and what is left.

        In units of noise. Left are the factors at the nearest known ones, L z, z' z being what that
        costs: a least sum of squares, which an error of z by rounding hardly changes.
        """
        nearest = np.zeros((self.root.shape[1], factors.shape[1]))
        left = factors
        for _ in range(_REFINED):
            downhill = self.root.T @ (gram @ left) - nearest
            way = self.inverse @ downhill
            moved = self.root @ way
            bent = np.sum(moved * (gram @ moved), axis=0) + np.sum(way**2, axis=0)
            far = np.sum(way * downhill, axis=0) / np.maximum(bent, 1e-300)
            nearest = nearest + far * way
            left = factors - self.root @ nearest
        return np.sum(left * (gram @ left), axis=0) + np.sum(nearest**2, axis=0), left


@dataclass(frozen=True, eq=False)
class TrueHypothesis:
    """One of two causes that is true, and the other.

    Attributes:
        true: What is known if it is true.
        other: ... if the other is.
        mean_difference: (p,) difference of the factors' means.
        before: Evidence for the true one in the diagnosed recordings; negative: against it.
    """

    true: Prediction
    other: Prediction
    mean_difference: Array
    before: float = 0.0

    def expected_evidence(self, gram: Array) -> tuple[float, Array]:
        """Return the evidence that is expected of (p, p) G alone, and its (p, p) slope by G."""
        (far,), left = self.other.distance(gram, self.mean_difference[:, None])
        return 0.5 * float(far), 0.5 * left @ left.T

    def chance(self, gram: Array, scattered: float = 1.0) -> float:
        """Return the probability that all evidence together will be clear.

        Clear is what `diagnose` requires: odds of 20 to one, and 1.64 standard errors over blocks.
        For factors as the true one expects them the evidence is about normal. Its mean is half of
        how much farther they are from the other cause than from the true one, its standard
        deviation the distance.

        Args:
            gram: (p, p) G.
            scattered: Part of the variance that blocks show; the rest is the same in all of them.
        """
        from scipy.special import ndtr

        random = np.random.default_rng(0)
        off = self.true.root @ random.normal(size=(self.true.root.shape[1], _DRAWN))
        near, _ = self.true.distance(gram, off)
        far, _ = self.other.distance(gram, off + self.mean_difference[:, None])
        far = np.maximum(far, 1e-12)
        spread = np.sqrt(far)
        least = np.maximum(STRONG, _CLEAR * np.sqrt(scattered) * spread)
        return float(np.mean(ndtr((self.before + 0.5 * (far - near) - least) / spread)))


def _root(covariance: Array) -> Array:
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


class Separation(Objective):
    """The evidence that a motion is expected to give, in either sense of each pair.

    The value is the sum of K / (1 + K / 10.5): what is separated poorly counts most, and what
    nothing separates counts little.
    """

    def __init__(
        self,
        arm: Arm,
        pairs: Sequence[HypothesisPair],
        motion_of: MotionFactory,
        noise: Array,
        uncertain: Knowledge | None = None,
        time: Array | None = None,
        kept: float = 1.0,
        scattered: float = 1.0,
    ) -> None:
        """Lay out the columns.

        Args:
            arm: The arm.
            pairs: At least one.
            motion_of: What causes see of states.
            noise: (n,) variance of the mean torque of a second, (N·m)^2 s.
            uncertain: What a model is uncertain of; ``None``: nothing.
            time: (M,) times of states, s; ``None``: poses, each for itself.
            kept: Part of the evidence of the diagnosed recordings that counts beside more of them.
            scattered: See :meth:`TrueHypothesis.chance`.
        """
        self._kept, self._scattered = kept, scattered
        self.arm, self.noise, self.pairs, self._motion_of = arm, noise, pairs, motion_of
        self._uncertain, self._time = uncertain, time
        causes = {id(each): each for pair in pairs for each in (pair.first, pair.second)}
        self._causes = tuple(causes.values())
        shared = 0 if uncertain is None else uncertain.rows.shape[1]
        edges = (shared + np.cumsum([0, *(len(each.theta) for each in self._causes)])).tolist()
        self._roots, means = [], []
        for cause, own in zip(self._causes, map(slice, edges, edges[1:]), strict=True):
            root = np.zeros((edges[-1], shared + len(cause.theta)))
            root[:shared, :shared] = np.eye(shared)
            root[own, shared:] = _root(cause.covariance)
            self._roots.append(root)
            means.append(np.zeros(edges[-1]))
            means[-1][own] = cause.theta
        number = {key: k for k, key in enumerate(causes)}
        self._numbers = [(number[id(each.first)], number[id(each.second)]) for each in pairs]
        self._means = np.array(means)

    def over(self, time: Array) -> Separation:
        """Return the objective of motions that are looked at at (M,) times, s."""
        return Separation(
            self.arm, self.pairs, self._motion_of, self.noise, self._uncertain, time,
            self._kept, self._scattered,
        )  # fmt: skip

    def regressor(self, state: State) -> Array:
        """Return the torques of what the model is uncertain of, then those of the causes."""
        time = np.zeros(len(state.q)) if self._time is None else self._time
        parts = [] if self._uncertain is None else [self._uncertain.regressor(state)]
        motion = self._motion_of(state, time)
        parts += [cause.columns(motion) for cause in self._causes]
        return np.concatenate(parts, axis=-1) * self._counts(state)[..., None]

    def _counts(self, state: State) -> Array:
        """Return (N, n) the part of torques that shows: friction hides that of a joint at rest."""
        if state.qd is None or state.direction is not None:
            return np.ones(state.q.shape)
        return np.where(
            self.arm.has_friction, np.abs(state.qd) / np.hypot(state.qd, self.slow), 1.0
        )

    def score(self, gram: Array) -> tuple[float, Array]:
        """Return the sum of K / (1 + K / 10.5) over the senses of all pairs, and its slope."""
        total, slope = 0.0, np.zeros_like(gram)
        for sense in chain.from_iterable(self._senses(gram)):
            value, by = sense.expected_evidence(gram)
            more = 1.0 + value / _ENOUGH
            total += value / more
            slope += by / more**2
        return total, slope

    def expected(self, gram: Array) -> list[tuple[float, float]]:
        """Return of each pair the evidence expected, and the chance that it is clear.

        With that of the diagnosed recordings; the lesser of each, whichever of the two is true.
        """
        return [
            (
                min(sense.before + sense.expected_evidence(gram)[0] for sense in senses),
                min(sense.chance(gram, self._scattered) for sense in senses),
            )
            for senses in self._senses(gram)
        ]

    def hidden(self, state: State, duration: float) -> list[tuple[bool, bool]]:
        """Return of each pair whether no motion is expected to show the first, or the second.

        To the evidence a motion is the time that it spends in each state. It shows a cause where
        that, with what the diagnosed recordings say for it, is all but certain to be clear.

        Args:
            state: (N, n) random states of what a motion could pass.
            duration: Of the motion, s: it gives at most :data:`_BEST` times what these give.
        """
        gram = self.gram(state, np.full(len(state.q), _BEST * duration / len(state.q)))
        found = []
        for pair, senses in zip(self.pairs, self._senses(gram), strict=True):
            most = iter(
                [max(sense.before, 0.0) + sense.expected_evidence(gram)[0] for sense in senses]
            )
            first, second = (wanted and next(most) < _ENOUGH for wanted in pair.required)
            found.append((first, second))
        return found

    def _senses(self, gram: Array) -> Iterator[list[TrueHypothesis]]:
        """Yield the senses of each pair."""
        found = [Prediction.of(gram, root) for root in self._roots]
        for pair, numbers in zip(self.pairs, self._numbers, strict=True):
            causes = pair.first, pair.second
            yield [
                TrueHypothesis(
                    found[numbers[i]], found[numbers[1 - i]],
                    self._means[numbers[i]] - self._means[numbers[1 - i]],
                    self._kept * (causes[i].evidence - causes[1 - i].evidence),
                )
                for i in (0, 1)
                if pair.required[i]
            ]  # fmt: skip
