"""Causes, and pushes of any kind, beside the samples of a window."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.diagnosis import LoadLikelihood, LoadPosterior, parameter_slopes
from dvrk_gravity.effects import Estimate, Hypothesis, Kind, PayloadHypothesis, heaviest
from dvrk_gravity.estimation import NORMAL_95
from dvrk_gravity.identification import OTHER_MOTION
from dvrk_gravity.monitoring.change_test import ChangeTest, Evidence
from dvrk_gravity.monitoring.events import Alternative
from dvrk_gravity.monitoring.window import SHAPE, Window
from dvrk_gravity.monitoring.wrench import Tip

Key = tuple[str, tuple[int, ...], str]

# By which gains grow in another motion than the calibration's, as the square of its known error.
_GAIN = OTHER_MOTION**2
_CONSTANT = 0.7  # of a torque's power, from which on it may be a push. Chosen
# Samples, of moments at which any torque may act: a third of a second to two.
_LENGTHS = (4, 8, 16, 25)
LONGEST_TRANSIENT = max(_LENGTHS)
_APART = 3  # samples between two such moments
# Of the mean square of errors as they are known, below which none is believed. Beside the uncertain
# directions, flights of eight simulated arms show .05 to .3 of it (benchmark/monitor.py, seeds 110
# to 112), since a known error is that of motions to which nothing was fitted. Chosen.
_LEAST = 1.0 / 12.0
_BEFORE = 12.0  # moments of a length, of gain one, that count as known before any. Chosen: 3 s
_FLAT = 1e-9  # of the largest information on a force, that is rounding: no joint feels that way
_AT_REST = 8  # samples of the longest moment in which friction may hold a joint. Chosen
_SAYS = 0.75  # part of a moment's samples that has to say something. Chosen
# Times the largest gain of the last minutes, below which another one is no push: of some arms rare
# errors (several joints that turn round at once) are far larger than their mean says. Chosen.
_ABOVE = 2.0


@dataclass(frozen=True, eq=False)
class Limits:
    """What gains a monitor expects without any change.

    Attributes:
        false_alarms: Tests of one second that may pass by chance, by white errors.
        of_causes: The largest gain that the calibration itself shows, by cause.
        of_pushes: (n + 1,) likewise of what acts for a moment, at each joint and at the tip.
        level: (n,) of errors: their mean square over that of errors as they are known.
    """

    false_alarms: float
    of_causes: Mapping[Key, float] = field(default_factory=dict)
    of_pushes: Array = field(default_factory=lambda: np.zeros(1))
    level: Array = field(default_factory=lambda: np.ones(1))

    def typical_gain(self, columns: Array) -> float:
        """Return the mean gain of (m, n, k) whitened columns without a change, over that expected.

        By the joints at which they act: of several parameters the largest.
        """
        power = np.sum(columns**2, axis=0)
        share = power / np.maximum(power.sum(axis=0), 1e-300)
        return float(np.sum(self.level[:, None] * share, axis=0).max())

    def cause_limit(self, hypothesis: Hypothesis, k: int, count: int, usual: float) -> float:
        """Return the gain from which on one of so many causes of k parameters is there.

        Args:
            hypothesis: The cause.
            k: Its parameters.
            count: How many there are.
            usual: Its gain where nothing happens, over that of known errors.
        """
        chance = float(chi2.isf(self.false_alarms / count, k))
        return max(chance * usual, _GAIN * self.of_causes.get(hypothesis.key, 0.0))

    def push_limit(self, gain: Array, usual: Array, largest: Array) -> Array:
        """Return (p, n + 1) limits from which on one of as many gains of moments is no chance.

        Args:
            gain: (p, n + 1) gains.
            usual: (p, n + 1) their mean where nothing happens, over the degrees of freedom.
            largest: (n + 1,) the largest of late.
        """
        chance = chi2.isf(self.false_alarms / max(gain.size, 1), _freedom(gain.shape[1] - 1))
        return np.maximum(np.maximum(chance * usual, _GAIN * self.of_pushes), _ABOVE * largest)


@dataclass(frozen=True, eq=False)
class ChangeCandidate:
    """A cause beside the residual of some last seconds.

    Attributes:
        hypothesis: The cause.
        evidence: What they say of it.
        since: When it begins, s.
        first: Index of the first sample that has something of it.
        limit: Gain from which on it is there.
        typical_gain: Its gain where nothing happens, over that of known errors.
        columns: (m, n, k) whitened torque in all samples.
        test: That gave the evidence.
    """

    hypothesis: Hypothesis
    evidence: Evidence
    since: float
    first: int
    limit: float
    typical_gain: float
    columns: Array
    test: ChangeTest

    @property
    def excess(self) -> float:
        """Gain over the limit."""
        return self.evidence.gain - self.limit

    @cached_property
    def _active_columns(self) -> Array:
        """(m, n, k) columns from its first sample on, zero before."""
        acts = np.arange(len(self.columns)) >= self.first
        return np.where(acts[:, None, None], self.columns, 0.0)

    @cached_property
    def torque(self) -> Array:
        """(m, n) whitened torque of the estimate."""
        return np.asarray(self._active_columns @ self.evidence.theta)

    def plausible_fit(self, window: Window) -> ChangeCandidate | None:
        """Return it if plausible, else refitted at the nearest plausible setting, or ``None``."""
        theta = self.evidence.theta
        if self.hypothesis.plausible(theta):
            return self
        hypothesis = self.hypothesis.clamped(theta)
        if hypothesis is None:
            return None
        columns = window.whiten(window.columns(hypothesis))
        return replace(self, hypothesis=hypothesis, columns=columns)._refit()

    def _refit(self) -> ChangeCandidate | None:
        """Return the candidate with parameters fitted again; ``None``: they are not plausible."""
        prior = prior_precision(self.hypothesis, self.columns.shape[2])
        evidence = self.test.evidence(self._active_columns, prior)
        if not self.hypothesis.plausible(evidence.theta):
            return None
        return replace(self, evidence=evidence)

    def onset(self, window: Window) -> float:
        """Return the likeliest time of its beginning, s, within about a second around its own."""
        found = self
        if self.first == 0:  # all samples have the cause
            return self.since
        for reach, step in ((1.0, window.step), (window.step, 0.25 * window.step)):
            around = found.since + np.arange(-reach, reach, step)
            begun = [self.refit_from(since, window) for since in around.tolist()]
            found = likeliest([found, *(each for each in begun if each is not None)])
        return found.since

    def refit_from(self, since: float, window: Window) -> ChangeCandidate | None:
        """Return the candidate refitted for an onset, s; ``None``: the fit is not plausible."""
        columns = window.whiten(window.columns(self.hypothesis, since))
        first = int(np.searchsorted(window.ends, since, "right"))
        return replace(self, since=since, first=first, columns=columns)._refit()

    def size(self, window: Window) -> float:
        """Return its RMS torque while it acts, over the errors', at the joint where it is most."""
        torque = (window.columns(self.hypothesis) @ self.evidence.theta)[self.first :]
        acts = np.any(torque != 0.0, axis=1)
        return float((np.sqrt(np.mean(torque[acts] ** 2, axis=0)) / window.error).max())

    def is_persistent(self) -> bool:
        """Return whether each half of its information shows it, with about the same size."""
        columns, k = self._active_columns, self.columns.shape[2]
        power = np.cumsum(np.sum(columns**2, axis=(1, 2)))
        middle = int(np.searchsorted(power, 0.5 * power[-1])) + 1
        halves = np.zeros((*columns.shape[:2], 2 * k))
        halves[:middle, :, :k], halves[middle:, :, k:] = columns[:middle], columns[middle:]
        found = self.test.evidence(halves, np.tile(prior_precision(self.hypothesis, k), 2))
        if not np.isfinite(found.covariance).all():
            return False
        early, late = found.theta[:k], found.theta[k:]
        for theta, own in ((early, slice(0, k)), (late, slice(k, None))):
            gain = theta @ np.linalg.solve(found.covariance[own, own], theta)
            if gain < NORMAL_95**2 * k * self.typical_gain:
                return False
        size = self.evidence.theta @ self.evidence.theta
        return bool(min(early @ self.evidence.theta, late @ self.evidence.theta) > 0.5 * size)

    def resembles_push(self) -> bool:
        """Return whether it is nearly constant at every joint, as the push of a hand is."""
        torque = self.torque[self.first :]
        acts = np.any(torque != 0.0, axis=1)
        constant = torque[acts].mean(axis=0) ** 2
        return bool(constant.sum() > _CONSTANT * np.mean(torque[acts] ** 2, axis=0).sum())

    def remaining_error(self, usable: Mask) -> float:
        """Return the largest mean square of whitened residuals that it leaves at its joints."""
        rows, torque = slice(self.first, None), self.torque
        left = self.test.remaining_residual(self.evidence, self._active_columns)[rows]
        count = np.maximum(usable[rows].sum(axis=0), 1)
        power, left = (np.sum(each**2, axis=0) / count for each in (torque, left))
        # A column is right to some per cent, which is more than the errors of a large change.
        return float(np.max((left - SHAPE**2 * power)[power > 0.1 * power.max()]))

    def joints(self) -> tuple[str, ...]:
        """Return the names of its joints, or of those that feel it, the most affected one first."""
        if self.hypothesis.of_joint:
            return self.hypothesis.names
        size = np.sum(self.torque**2, axis=0)
        names = self.hypothesis.arm.joint_names
        return tuple(names[j] for j in np.argsort(-size) if size[j] > 0.1 * size.max())

    def differs_by_link(self, other: ChangeCandidate) -> bool:
        """Return whether both are the same effect, at different links."""
        own = self.hypothesis
        return own.effect == other.hypothesis.effect and own.site.kind is Kind.LINK

    def alternative(self) -> Alternative:
        """Return effect, joints and site, to report as the alternative to another cause."""
        return Alternative(self.hypothesis.effect, self.joints(), self.hypothesis.where)

    def values(self) -> dict[str, Estimate]:
        """Return its parameters with their intervals, to first order."""
        hypothesis, theta = self.hypothesis, self.evidence.theta
        covariance, found = self.evidence.covariance, dict[str, Estimate]()
        slopes = parameter_slopes(hypothesis, theta, covariance)
        for name, value in hypothesis.parameters(theta).items():
            half = NORMAL_95 * float(np.sqrt(slopes[name] @ covariance @ slopes[name]))
            unit = hypothesis.unit(name)
            found[name] = Estimate(float(value), float(value - half), float(value + half), unit)
        return found

    def reported(self, window: Window) -> dict[str, Estimate]:
        """Return its parameters with their intervals; of a load those of all bodies and places."""
        hypothesis = self.hypothesis
        if not isinstance(hypothesis, PayloadHypothesis):
            return self.values()
        arm = hypothesis.arm
        loads = [window.load(body, self.since) for body in range(len(arm.bodies))]
        forms = [LoadLikelihood(*self.test.likelihood(load), heaviest(arm)) for load in loads]
        clamped = hypothesis.unclamped is not hypothesis
        best = None if clamped else hypothesis.parameters(self.evidence.theta)
        return LoadPosterior.drawn(forms, arm, best).estimates(hypothesis)

    def significant(self) -> bool:
        """Return whether any of the parameters that are reported differs from none."""
        effect, values = self.hypothesis.EFFECT, self.values()
        for name in effect.listed(values):
            neutral = effect.meaning(name).neutral
            if neutral is not None and not values[name].doubtful(neutral):
                return True
        return False


def likeliest(found: Sequence[ChangeCandidate]) -> ChangeCandidate:
    """Return the one with the largest excess; of samples that say nothing it begins with the last.

    Raises:
        ValueError: There is none.
    """
    return max(found, key=lambda candidate: (candidate.excess, candidate.first))


def prior_precision(hypothesis: Hypothesis, k: int) -> Array:
    """Return the (k,) prior precision of a cause's parameters."""
    return np.asarray(1.0 / np.square(hypothesis.prior_std or (np.inf,) * k))


def find_candidates(
    window: Window, test: ChangeTest, firsts: Sequence[int], limits: Limits
) -> Iterator[ChangeCandidate]:
    """Yield every cause as it may have begun with each of some samples, plausible or not."""
    causes = list(window.causes())
    columns = [window.whiten(window.columns(cause)) for cause in causes]
    if not firsts or not causes:
        return
    priors = [
        prior_precision(cause, own.shape[2]) for cause, own in zip(causes, columns, strict=True)
    ]
    found = test.evidence_by_onset(np.concatenate(columns, axis=2), priors, firsts)
    for cause, own, evidences in zip(causes, columns, found, strict=True):
        usual = limits.typical_gain(own)
        limit = limits.cause_limit(cause, own.shape[2], len(causes) * len(firsts), usual)
        for first, evidence in zip(firsts, evidences, strict=True):
            if evidence.gain > 0.0:
                since = float(window.ends[first]) - window.step
                yield ChangeCandidate(cause, evidence, since, first, limit, usual, own, test)


@dataclass(frozen=True, eq=False)
class TransientTorques:
    """Torque of any origin that acts for a moment: at one joint, or of a force at the tip.

    Attributes:
        begin: (p,) index of each moment's first sample.
        end: (p,) of the one after its last.
        gain: (p, n + 1) of torque at each joint alone, then of a force; 0 where it is not known.
        torque: (p, n) torque at each joint alone, N·m; 0 where it is not known.
    """

    begin: NDArray[np.int64]
    end: NDArray[np.int64]
    gain: Array
    torque: Array


@dataclass(frozen=True, eq=False)
class TypicalGains:
    """Mean gains of moments in which nothing happens, which are one where errors are as known.

    A model's error may last longer than it knows: the longer a moment, the larger its gain then.

    Attributes:
        total: (lengths, n + 1) sums of gains.
        count: (lengths, n + 1) how many that are known.
        largest: (n + 1,) the largest one, which is forgotten as the others are.
    """

    total: Array
    count: Array
    largest: Array

    @classmethod
    def begin(cls, n: int) -> TypicalGains:
        """Return the prior of n joints: as if some moments of gain one had been seen."""
        count = np.full((len(_LENGTHS), n + 1), _BEFORE)
        return cls(count * _freedom(n), count, np.zeros(n + 1))

    def updated(self, found: TransientTorques, limit: Array, kept: float) -> TypicalGains:
        """Return the means with p further moments, up to their (p, n + 1) limits; old ones fade."""
        length = _length_of(found)
        total, count = kept * self.total, kept * self.count
        gain = np.minimum(found.gain, limit)
        np.add.at(total, length, gain)
        np.add.at(count, length, gain > 0.0)
        return TypicalGains(
            total, count, np.maximum(kept * self.largest, gain.max(axis=0, initial=0.0))
        )

    @property
    def level(self) -> Array:
        """(n,) mean square of each joint's errors over that of errors as they are known.

        By the moments whose gains are largest; between a twelfth and one.
        """
        usual = np.max(self.total / self.count, axis=0)[:-1]
        return np.asarray(np.clip(usual, _LEAST, 1.0))

    def for_transients(self, found: TransientTorques) -> Array:
        """Return (p, n + 1) mean gains of moments of these lengths, over the degrees of freedom.

        At least one: where it is less, rare errors (after reversals) are as large all the same.
        """
        usual = self.total / self.count / _freedom(self.total.shape[1] - 1)
        return np.maximum(usual, 1.0)[_length_of(found)]


def _freedom(n: int) -> Array:
    """Return (n + 1,) degrees of freedom of a gain at each joint, and of a force's: components."""
    return np.append(np.ones(n), 3.0)


def _length_of(found: TransientTorques) -> NDArray[np.int64]:
    """Return (p,) the indices of moments' lengths."""
    return np.searchsorted(_LENGTHS, found.end - found.begin)


def transient_torques(
    window: Window, known: ChangeTest, since: int, tip: Tip | None, blind: Sequence[int] = ()
) -> TransientTorques:
    """Return gains and torques of moments that end after a sample.

    Args:
        window: The samples.
        known: The uncertain directions as samples before the moments determine them.
        since: Index of the sample.
        tip: Where a force may act; ``None``: nowhere.
        blind: Indices of joints that are not looked at.
    """
    m, n = window.usable.shape
    parts = [
        slice(start, start + length)
        for length in _LENGTHS
        for start in range(max(since - length + 1, 0), m - length + 1, _APART)
    ]
    at_joints = np.ones((m, n, 1))
    by_force = np.zeros((m, n, 3))
    if tip is not None:
        recent = slice(max(since - LONGEST_TRANSIENT, 0), m)
        jacobians = tip.velocity_jacobian(window.motion.true_q[recent])
        by_force[recent] = jacobians.transpose(0, 2, 1)
    columns = np.concatenate([at_joints, by_force], axis=2)
    columns[:, list(blind)] = 0.0
    uncertain = window.uncertain
    unexpected = window.residual - uncertain @ known.directions
    gain, torque = np.zeros((len(parts), n + 1)), np.zeros((len(parts), n))
    for index, part in enumerate(parts):
        # Samples beside many that say nothing say little; what friction holds, at several joints
        # at once, lasts.
        rests = np.mean(window.motion.stuck[part], axis=0) > 0.5
        usable = np.mean(window.usable[part], axis=0) >= _SAYS
        if part.stop - part.start > _AT_REST:
            usable &= ~rests
        # What comes after may go on.
        white = np.where(usable[:, None], window.whiten(columns[part], part), 0.0)
        joint, force = white[:, :, 0], white[:, :, 1:]
        directions, rest = uncertain[part], unexpected[part]
        held = np.einsum("mn,mnd->nd", joint, directions)
        power, score = np.sum(joint**2, axis=0), np.sum(joint * rest, axis=0)
        power = np.where(power > 0.0, power, 1.0)
        gain[index, :n] = score**2 / (power + known.deviation_of(held) ** 2)
        torque[index] = score / power
        if tip is None:
            continue
        force = np.where(rests[:, None], 0.0, force)
        square = np.einsum("mnk,mnl->kl", force, force)
        shared = np.einsum("mnk,mnd->kd", force, directions)
        pull = np.einsum("mnk,mn->k", force, rest)
        spread = np.linalg.pinv(square + known.covariance_of(shared), _FLAT, hermitian=True)
        gain[index, n] = pull @ spread @ pull
    begin, end = (np.array([getattr(part, side) for part in parts], dtype=np.int64)
                  for side in ("start", "stop"))  # fmt: skip
    return TransientTorques(begin, end, gain, torque)
