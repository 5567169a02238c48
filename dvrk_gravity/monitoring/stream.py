"""The monitor: rows of measurements in, residuals and events out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.stats import chi2

from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.effects import Hypothesis
from dvrk_gravity.estimation import NORMAL_95
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.monitoring.change_test import ChangeTest, Evidence, Sums
from dvrk_gravity.monitoring.events import Event, Value
from dvrk_gravity.monitoring.observer import MomentumObserver
from dvrk_gravity.monitoring.rows import Rows
from dvrk_gravity.monitoring.window import Band, Sampling, Window


_CONSTANT = 0.7  # of a torque's power, from which on it may be a push. Chosen
_SHAPE = 0.02  # of a cause's power: a column that is off by 14 % of itself. Chosen


@dataclass(frozen=True)
class MonitorSettings:
    """When a monitor reports something.

    Attributes:
        sampling: Of the observer and of the tests.
        false_alarms: An hour, of all tests together, were the errors as the model knows them.
        shortest_span: s, of the last seconds in which something may have begun.
        longest_span: s, likewise.
        longest: s, of the rows that are kept. The longest span and what serves to know the
            uncertain directions before it.
        forget: s, after which a part 1/e of what is known of the directions is left: friction warms
            up in minutes.
        warm_up: s of motion, before which the directions are not known, and nothing is reported.
        size: Torque of a change, in RMS of what the model is known to be off by, below which it is
            minor.
        margin: Twice the log-likelihood by which a cause must excel others: e^5 to one.
        patience: s for which a cause that does not excel them is waited for.
        push: s, which the longest push lasts.
        remains: Mean square of whitened residuals beside a cause, from which on it does not explain
            them.
    """

    sampling: Sampling = field(default_factory=Sampling)
    false_alarms: float = 0.1
    shortest_span: float = 2.0
    longest_span: float = 12.0
    longest: float = 20.0
    forget: float = 600.0
    warm_up: float = 10.0
    size: float = 1.0
    margin: float = 10.0
    patience: float = 6.0
    push: float = 5.0
    remains: float = 2.25


@dataclass(frozen=True, eq=False)
class Seen:
    """What a monitor makes of (K, n) rows.

    Attributes:
        residual: (K, n) low-passed measured minus expected torque, N·m.
        unexpected: (K, n) the same before the low-pass, N·m.
        deviation: (K, n) standard deviation that is expected of the residual, N·m.
        events: What was found out by these rows.
    """

    residual: Array
    unexpected: Array
    deviation: Array
    events: tuple[Event, ...]


@dataclass(frozen=True, eq=False)
class Change:
    """A change that was reported, and that what follows is compared with.

    Attributes:
        hypothesis: The cause.
        theta: (k,) its parameters.
        since: Its onset, s.
        joints: Names of joints at which no second one is named.
    """

    hypothesis: Hypothesis
    theta: Array
    since: float
    joints: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Trial:
    """A cause beside the residual of some last seconds.

    Attributes:
        hypothesis: The cause.
        evidence: What they say of it.
        first: Index of the sample with which it begins.
        excess: Gain over the threshold.
        columns: (m, n, k) whitened torque in all samples.
        test: That gave the evidence.
    """

    hypothesis: Hypothesis
    evidence: Evidence
    first: int
    excess: float
    columns: Array
    test: ChangeTest

    @property
    def _begun(self) -> Array:
        columns = self.columns.copy()
        columns[: self.first] = 0.0
        return columns

    @property
    def torque(self) -> Array:
        """(m, n) whitened torque of the estimate."""
        return np.asarray(self._begun @ self.evidence.theta)

    def rms(self) -> float:
        """Return the whitened RMS torque at the joint where it is largest, while it acts."""
        torque = self.torque[self.first :]
        acts = np.any(torque != 0.0, axis=1)
        return float(np.sqrt(np.mean(torque[acts] ** 2, axis=0)).max())

    def lasts(self) -> bool:
        """Return whether either half of its information shows it, in one size."""
        columns, k = self._begun, self.columns.shape[2]
        power = np.cumsum(np.sum(columns**2, axis=(1, 2)))
        middle = int(np.searchsorted(power, 0.5 * power[-1])) + 1
        halves = np.zeros((*columns.shape[:2], 2 * k))
        halves[:middle, :, :k], halves[middle:, :, k:] = columns[:middle], columns[middle:]
        found = self.test.evidence(halves, np.tile(_prior(self.hypothesis, k), 2))
        if not np.isfinite(found.covariance).all():
            return False
        early, late = found.theta[:k], found.theta[k:]
        for theta, own in ((early, slice(0, k)), (late, slice(k, None))):
            gain = theta @ np.linalg.solve(found.covariance[own, own], theta)
            if gain < NORMAL_95**2 * k:
                return False
        size = self.evidence.theta @ self.evidence.theta
        return bool(min(early @ self.evidence.theta, late @ self.evidence.theta) > 0.5 * size)

    def like_push(self) -> bool:
        """Return whether it is nearly constant at every joint, as the push of a hand is."""
        torque = self.torque[self.first :]
        acts = np.any(torque != 0.0, axis=1)
        constant = torque[acts].mean(axis=0) ** 2
        return bool(constant.sum() > _CONSTANT * np.mean(torque[acts] ** 2, axis=0).sum())

    def left(self, usable: Mask) -> float:
        """Return the largest mean square of whitened residuals that it leaves at its joints."""
        rows, torque = slice(self.first, None), self.torque
        left = self.test.left(self.evidence, self._begun)[rows]
        count = np.maximum(usable[rows].sum(axis=0), 1)
        power, left = (np.sum(each**2, axis=0) / count for each in (torque, left))
        # A column is right to some per cent, which is more than the errors of a large change.
        return float(np.max((left - _SHAPE * power)[power > 0.1 * power.max()]))


class Monitor:
    """Listens to an arm, second by second.

    Attributes:
        model: The model.
        settings: When it reports something.
        changes: What has changed so far.
    """

    def __init__(self, model: TorqueModel, settings: MonitorSettings | None = None) -> None:
        """Begin to listen."""
        self.model, self.settings = model, settings or MonitorSettings()
        sampling, n = self.settings.sampling, model.arm.n
        self._observer = MomentumObserver(model, sampling.gain, 5.0 / sampling.row_rate)
        self._rows, self._residual = Rows.none(n), np.zeros((0, n))
        self._band: Band | None = None
        self._baseline: Sums | None = None
        self._moved = 0.0  # s, seen so far
        self._pending: float | None = None  # since when a cause has passed
        self._pushing: list[Array] = []
        self._push_since: float | None = None
        self._pushes: list[Event] = []  # not yet reported: they may be changes
        self._left_out: list[tuple[float, float]] = []
        self._given_up: set[str] = set()  # joints at which something has no name
        self.changes: list[Change] = []

    debug = False

    def add(self, rows: Rows) -> Seen:
        """Listen to the next rows, about a second of them."""
        observed = self._observer.advance(rows)
        most = round(self.settings.longest * self.settings.sampling.row_rate)
        self._rows = self._rows.followed_by(rows).at(slice(-most, None))
        self._residual = np.concatenate([self._residual, observed.residual])[-most:]
        self._moved += len(rows) / self.settings.sampling.row_rate
        deviation, events = self._judge(len(rows))
        return Seen(observed.residual, observed.unexpected, deviation, tuple(events))

    def _judge(self, new: int) -> tuple[Array, list[Event]]:
        """Return (new, n) standard deviations of the last rows' residuals, and events."""
        unknown = np.full((new, self.model.arm.n), np.nan)
        if self._moved < self.settings.warm_up:
            return unknown, []
        if self._band is None:
            self._band = Band.of(self.model, np.sqrt(np.mean(self._residual**2, axis=0)))
        window = Window.of(
            self.model, self._rows, self._residual, self._band, self.settings.sampling,
            self._left_out,
        )  # fmt: skip
        return self._tested(self._beside_changes(window), new)

    def _beside_changes(self, window: Window) -> Window:
        """Return the window without the torque of reported changes, whose sizes stay uncertain."""
        for change in self.changes:
            columns = window.columns(change.hypothesis)
            columns = columns * (window.time >= change.since)[:, None, None]
            window = replace(
                window,
                torque=window.torque - columns @ change.theta,
                residual=window.residual - window.white(columns) @ change.theta,
                open=np.concatenate(
                    [
                        window.open,
                        columns * np.abs(change.theta),
                        window.rubbed(columns @ change.theta),
                    ],
                    axis=2,
                ),
            )
        return window

    def _tested(self, window: Window, new: int) -> tuple[Array, list[Event]]:
        """Return (new, n) standard deviations of the last rows' residuals, and events."""
        settings, sampling = self.settings, self.settings.sampling
        uncertain = window.white(window.open)
        if self._baseline is None:
            self._baseline = Sums.nothing(window.fixed)
        test = ChangeTest(uncertain, window.residual, self._baseline)
        # As long as nothing is known from before the window, a cause may have been there then.
        trials = list(self._trials(window, test, since_before=not self._baseline.gram.any()))
        events = list(self._changed(window, trials))
        events += () if events else self._pushed(window, test, float(window.time[-1]))
        # What leaves the window is kept as what is known of the directions.
        leaving = window.time < window.time[0] + new / sampling.row_rate
        full = len(self._rows) >= round(settings.longest * sampling.row_rate)
        if full and self._baseline is not None:
            rows = uncertain[leaving, :, : window.fixed].reshape(-1, window.fixed)
            sums = Sums.of(rows, window.residual[leaving].reshape(-1))
            kept = float(np.exp(-new / sampling.row_rate / settings.forget))
            self._baseline = self._baseline.plus(sums, kept)
        last = slice(-(-(-new // sampling.stride)), None)
        return np.repeat(window.deviation(test, last), sampling.stride, axis=0)[-new:], events

    def _trials(self, window: Window, test: ChangeTest, since_before: bool) -> Iterator[Trial]:
        """Yield every cause as it may have begun in the last seconds, or before the window."""
        settings, now = self.settings, float(window.time[-1])
        causes = list(window.causes())
        each = [window.white(window.columns(cause)) for cause in causes]
        priors = [
            _prior(cause, columns.shape[2]) for cause, columns in zip(causes, each, strict=True)
        ]
        spans = np.arange(settings.longest_span, settings.shortest_span - 0.5, -1.0)
        firsts = np.searchsorted(window.time, now - spans)
        firsts = np.unique(firsts if since_before else firsts[firsts > 0]).tolist()
        firsts = sorted({0, *firsts}) if since_before else firsts
        if not firsts:
            return
        count = len(causes) * (len(spans) + 1) * 3600.0
        limits = {
            k: float(chi2.isf(settings.false_alarms / count, k)) for k in set(map(len, priors))
        }
        found = test.of_spans(np.concatenate(each, axis=2), priors, firsts)
        for cause, columns, evidences in zip(causes, each, found, strict=True):
            for first, evidence in zip(firsts, evidences, strict=True):
                if evidence.gain > 0.0 and cause.plausible(evidence.theta):
                    excess = evidence.gain - limits[len(evidence.theta)]
                    yield Trial(cause, evidence, first, excess, columns, test)

    def _changed(self, window: Window, trials: Sequence[Trial]) -> Iterator[Event]:
        settings, now = self.settings, float(window.time[-1])
        passing = [
            trial
            for trial in trials
            if trial.excess > 0.0 and _significant(trial)
            and not self._given_up.intersection(self._joints(trial)[:1])
        ]  # fmt: skip
        if not passing:
            self._pending = None
            return
        if self._pending is None:
            self._pending = now
        best = max(passing, key=lambda trial: trial.excess)
        rivals = [
            trial
            for trial in passing
            if trial.first == best.first and trial.hypothesis.key != best.hypothesis.key
            and trial.excess > best.excess - settings.margin
        ]  # fmt: skip
        onset = float(window.time[best.first])
        if not best.lasts() or best.rms() < settings.size:
            return
        if best.like_push() and now - onset <= settings.push + 1.0:
            return
        explains = best.left(window.usable) < settings.remains
        waited = now - self._pending >= settings.patience
        if (rivals or not explains) and not waited:
            return
        self._pending, self._push_since, self._pushing = None, None, []
        self._pushes = [push for push in self._pushes if push.onset < onset - 1.0]
        again = [c for c in self.changes if c.hypothesis.key == best.hypothesis.key]
        if explains and again:
            theta = again[0].theta + best.evidence.theta
            self.changes[self.changes.index(again[0])] = replace(again[0], theta=theta)
            return
        joints = self._joints(best)
        before = {name for change in self.changes for name in change.joints}
        if not explains or before.intersection(joints[:1]):
            # Two names at one joint are none: the cause is one that has no name here.
            self._given_up.add(joints[0])
            yield Event("unexplained", onset, now, joints)
            return
        self.changes.append(Change(best.hypothesis, best.evidence.theta, onset, joints[:1]))
        self._baseline = None
        keep = self._rows.time >= onset
        self._rows = self._rows.at(slice(int(np.argmax(keep)), None))
        self._residual = self._residual[-len(self._rows) :]
        yield Event(
            "change", onset, now, joints, best.hypothesis.effect, best.hypothesis.place, None,
            _values(best), "perhaps" if rivals else "certain",
            tuple((t.hypothesis.effect, t.hypothesis.names) for t in rivals),
        )  # fmt: skip

    def _joints(self, trial: Trial) -> tuple[str, ...]:
        """Return the joints of a cause, or those that feel it, the one that feels it most first."""
        return trial.hypothesis.names if trial.hypothesis.of_joint else self._most(trial)

    def _most(self, trial: Trial) -> tuple[str, ...]:
        """Return the joints, the one whose torque is largest first."""
        size = np.sum(trial.torque**2, axis=0)
        order = np.argsort(-size)
        return tuple(self.model.arm.joint_names[j] for j in order if size[j] > 0.1 * size.max())

    def _pushed(self, window: Window, test: ChangeTest, now: float) -> Iterator[Event]:
        settings = self.settings
        found = self._free_torque(window, test)
        if found and self._push_since is None:
            self._push_since = found[0][0]
        self._pushing += [each for _, each in found]
        if not found and self._push_since is not None:
            begin, self._push_since = self._push_since, None
            peaks = np.max(np.abs(np.array(self._pushing)), axis=0)
            self._pushing = []
            if now - begin < settings.push + 2.0:
                inside = (window.time >= begin) & (window.time <= now)
                torque = np.linalg.norm(window.torque[inside], axis=1)
                step = settings.sampling.stride / settings.sampling.row_rate
                order = np.argsort(-peaks)
                names = self.model.arm.joint_names
                joints = tuple(names[j] for j in order if peaks[j] > 0.2 * peaks.max())
                values = {
                    names[j]: Value(float(peaks[j]), (float(peaks[j]),) * 2, "N·m")
                    for j in order
                    if peaks[j] > 0
                }
                self._pushes.append(
                    Event(
                        "push",
                        begin,
                        now,
                        joints,
                        end=now - 1.0,
                        values=values,
                        impulse=float(torque.sum() * step),
                    )
                )
        waiting = list[Event]()
        for push in self._pushes:
            if self._pending is not None and now - push.reported < settings.patience:
                waiting.append(push)
                continue
            self._left_out.append(
                (push.onset - 0.5, now - 0.5 if push.end is None else push.end + 1.0)
            )
            yield replace(push, reported=now)
        self._pushes = waiting
        self._left_out = [span for span in self._left_out if span[1] > window.time[0] - 2.0]

    def _free_torque(self, window: Window, test: ChangeTest) -> list[tuple[float, Array]]:
        """Return time and (n,) torque of moments of the last second at which any torque acts."""
        settings, n, m = self.settings, self.model.arm.n, len(window.time)
        first = int(np.searchsorted(window.time, window.time[-1] - 1.0))
        parts = [
            slice(start, start + length)
            for start in range(max(first - 4, 0), m - 3, 3)
            for length in (4, 8)
            if start + length <= m
        ]
        threshold = float(chi2.isf(settings.false_alarms / (len(parts) * n * 3600.0), 1))
        columns, places = [], []
        for part in parts:
            for joint in np.flatnonzero(window.usable[part].all(axis=0)).tolist():
                if self.model.arm.joint_names[joint] in self._given_up:
                    continue
                column = np.zeros((m, n, 1))
                column[part, joint] = 1.0
                white = window.white(column)
                white[part.stop :] = 0.0
                columns.append(white)
                places.append((part, joint))
        if not columns:
            return []
        found = dict[float, Array]()
        of_all = test.of_spans(np.concatenate(columns, axis=2), [np.zeros(1)] * len(columns), [0])
        for (part, joint), (evidence,) in zip(places, of_all, strict=True):
            if evidence.gain > threshold:
                torque = found.setdefault(float(window.time[part.start]), np.zeros(n))
                torque[joint] = evidence.theta[0]
        return sorted(found.items(), key=lambda pair: pair[0])


def _significant(trial: Trial) -> bool:
    """Return whether any of the parameters that are reported differs from none."""
    effect = trial.hypothesis.EFFECT
    values = _values(trial)
    for name in effect.listed(values):
        neutral = effect.meaning(name).neutral
        low, high = values[name].ci95
        if neutral is not None and not low <= neutral <= high:
            return True
    return False


def _prior(hypothesis: Hypothesis, k: int) -> Array:
    """Return the (k,) prior precision of a cause's parameters."""
    return 1.0 / np.square(hypothesis.prior_std or (np.inf,) * k)


def _values(trial: Trial) -> dict[str, Value]:
    """Return the parameters of a change with their intervals."""
    hypothesis, theta = trial.hypothesis, trial.evidence.theta
    deviation = np.sqrt(np.diag(trial.evidence.covariance))
    middle = hypothesis.parameters(theta)
    found = {}
    for name, value in middle.items():
        slopes = [
            (hypothesis.parameters(theta + row)[name] - value)
            for row in np.diag(np.maximum(deviation, 1e-12))
        ]
        slopes = np.array(slopes) / np.maximum(deviation, 1e-12)
        error = NORMAL_95 * float(np.sqrt(slopes @ trial.evidence.covariance @ slopes))
        found[name] = Value(
            float(value), (float(value - error), float(value + error)), hypothesis.unit(name)
        )
    return found
