"""Causes beside the samples of a window, each as it may have begun some seconds ago."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis import LoadLikelihood, LoadPosterior, parameter_slopes
from dvrk_gravity.effects import Estimate, Hypothesis, Kind, PayloadHypothesis, heaviest
from dvrk_gravity.estimation import NORMAL_95
from dvrk_gravity.monitoring.change_test import ChangeTest, Evidence
from dvrk_gravity.monitoring.events import Alternative
from dvrk_gravity.monitoring.limits import Limits
from dvrk_gravity.monitoring.window import SHAPE, Window

_CONSTANT = 0.7  # of a torque's power, from which on it may be a push. Chosen


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
        window: The samples.
        test: That gave the evidence.
    """

    hypothesis: Hypothesis
    evidence: Evidence
    since: float
    first: int
    limit: float
    typical_gain: float
    columns: Array
    window: Window
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

    @cached_property
    def plausible_fit(self) -> ChangeCandidate | None:
        """Itself if plausible, else refitted at the nearest plausible setting, or ``None``."""
        theta = self.evidence.theta
        if self.hypothesis.plausible(theta):
            return self
        hypothesis = self.hypothesis.clamped(theta)
        if hypothesis is None:
            return None
        columns = self.window.whiten(self.window.columns(hypothesis))
        return replace(self, hypothesis=hypothesis, columns=columns)._refit()

    def _refit(self) -> ChangeCandidate | None:
        """Return the candidate with parameters fitted again; ``None``: they are not plausible."""
        prior = prior_precision(self.hypothesis, self.columns.shape[2])
        evidence = self.test.evidence(self._active_columns, prior)
        if not self.hypothesis.plausible(evidence.theta):
            return None
        return replace(self, evidence=evidence)

    def onset(self) -> float:
        """Return the likeliest time of its beginning, s, within about a second around its own."""
        found, step = self, self.window.step
        if self.first == 0:  # all samples have the cause
            return self.since
        for reach, apart in ((1.0, step), (step, 0.25 * step)):
            around = found.since + np.arange(-reach, reach, apart)
            begun = [self.refit_from(since) for since in around.tolist()]
            found = likeliest([found, *(each for each in begun if each is not None)])
        return found.since

    def refit_from(self, since: float) -> ChangeCandidate | None:
        """Return the candidate refitted for an onset, s; ``None``: the fit is not plausible."""
        columns = self.window.whiten(self.window.columns(self.hypothesis, since))
        first = int(np.searchsorted(self.window.ends, since, "right"))
        return replace(self, since=since, first=first, columns=columns)._refit()

    def size(self) -> float:
        """Return its RMS torque while it acts, over the errors', at the joint where it is most."""
        torque = (self.window.columns(self.hypothesis) @ self.evidence.theta)[self.first :]
        acts = np.any(torque != 0.0, axis=1)
        return float((np.sqrt(np.mean(torque[acts] ** 2, axis=0)) / self.window.error).max())

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

    def remaining_error(self) -> float:
        """Return the largest mean square of whitened residuals that it leaves at its joints."""
        rows, torque = slice(self.first, None), self.torque
        left = self.test.remaining_residual(self.evidence, self._active_columns)[rows]
        count = np.maximum(self.window.usable[rows].sum(axis=0), 1)
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

    def reported(self) -> dict[str, Estimate]:
        """Return its parameters with their intervals; of a load those of all bodies and places."""
        hypothesis = self.hypothesis
        if not isinstance(hypothesis, PayloadHypothesis):
            return self.values()
        arm = hypothesis.arm
        loads = [self.window.load(body, self.since) for body in range(len(arm.bodies))]
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
    if not firsts or not causes:
        return
    columns = window.white_columns(causes)
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
                yield ChangeCandidate(
                    cause, evidence, since, first, limit, usual, own, window, test
                )  # fmt: skip
