"""The monitor: rows of measurements in, residuals and events out."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import Estimate, Hypothesis, is_friction
from dvrk_gravity.estimation import NORMAL_95
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.monitoring.calibration import calibration_limits
from dvrk_gravity.monitoring.change_candidates import (
    LONGEST_TRANSIENT,
    ChangeCandidate,
    Limits,
    TypicalGains,
    find_candidates,
    likeliest,
    transient_torques,
)
from dvrk_gravity.monitoring.change_test import ChangeTest, Sums
from dvrk_gravity.monitoring.drift import RestPeriod
from dvrk_gravity.monitoring.events import Event
from dvrk_gravity.monitoring.observer import (
    FASTEST,
    MomentumObserver,
    ObserverOutput,
    gain_for,
    white_noise,
)
from dvrk_gravity.monitoring.rows import Rows
from dvrk_gravity.monitoring.window import Band, Sampling, Window
from dvrk_gravity.monitoring.wrench import Tip

_MOVES = 0.01  # rad (Arm.scale), in a second or two, of an arm that moves. Chosen
# Of the mean square of errors as they are known, that counts at least where causes are compared:
# small errors, too, may look like one of them. Chosen.
_LIKE_CAUSE = 1.0 / 3.0
_ASIDE = 0.3  # s, before a push seems to begin, that may have something of it. Chosen


@dataclass(frozen=True)
class MonitorSettings:
    """When a monitor reports something.

    Attributes:
        sampling: Of the observer and of the tests.
        false_alarms: An hour, of changes and of pushes, were the errors as the model knows them.
        spans: s, of last seconds with which something may have begun, the longest first: friction
            of twice the noise takes ten to twenty to show.
        window: s, of the rows that are kept: the longest span, and what serves to know the
            uncertain directions before it.
        min_history: s, of rows from which on they serve so.
        min_duration: s that a cause has lasted when it is named: in less, others look like it.
            Chosen.
        forgetting_time: s, after which a part 1/e of what is known of the directions is left:
            friction warms up in minutes.
        warm_up: s of motion, before which the directions are not known, and nothing is reported.
        min_relative_size: Torque of a change, in RMS of what the model is known to be off by, below
            which it is minor.
        margin: Twice the log-likelihood by which a cause must excel others: e^5 to one; and
        margin_fraction: of its own, since a cause's torque is known to some per cent.
        patience: s since its onset for which a cause that does not excel them is waited for.
        give_up: s, after which something that no cause explains is reported.
        level_delay: s, after which the size of errors counts as the arm's own, and not as a
            change's.
        longest_push: s, which the longest push lasts.
        misfit_limit: Mean square of whitened residuals beside a cause, from which on it does not
            explain them: 1.5 squared.
    """

    sampling: Sampling = field(default_factory=Sampling)
    false_alarms: float = 0.1
    spans: tuple[float, ...] = (24.0, 20.0, 16.0, *map(float, range(12, 1, -1)))
    window: float = 36.0
    min_history: float = 20.0
    min_duration: float = 4.0
    forgetting_time: float = 600.0
    warm_up: float = 10.0
    min_relative_size: float = 1.0
    margin: float = 10.0
    margin_fraction: float = 0.1
    patience: float = 7.0
    give_up: float = 10.0
    level_delay: float = 12.0
    longest_push: float = 5.0
    misfit_limit: float = 2.25


@dataclass(frozen=True, eq=False)
class MonitorUpdate:
    """Result of the tests on (K, n) rows.

    Attributes:
        residual: (K, n) low-passed measured minus expected torque, N·m.
        deviation: (K, n) standard deviation that is expected of the residual, N·m; NaN as long as
            it is not known.
        events: What was found out by these rows.
    """

    residual: Array
    deviation: Array
    events: tuple[Event, ...]


@dataclass(frozen=True, eq=False)
class Change:
    """A change that was reported, and that what follows is compared with.

    Attributes:
        hypothesis: The cause.
        theta: (k,) its parameters.
        since: Its onset, s.
        joint: Name of the joint at which no second one is named.
    """

    hypothesis: Hypothesis
    theta: Array
    since: float
    joint: str


@dataclass(frozen=True, eq=False)
class _Push:
    """A push that goes on, or is over and not yet reported, since it may be a change.

    Attributes:
        begin: s.
        peak: (n,) largest torque, N·m.
        end: s, so far.
        impulse: Integral of the torque's norm, N·m·s.
    """

    begin: float
    peak: Array
    end: float
    impulse: float = 0.0

    @property
    def span(self) -> tuple[float, float]:
        """From when to when it may act, s."""
        return self.begin - 0.5, self.end + 0.5


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
        self.changes: tuple[Change, ...] = ()
        sampling, n = self.settings.sampling, model.arm.n
        gain = np.full(n, FASTEST)  # until noise is known
        self._tip = None if model.arm.read_in else Tip(model.arm)
        self._observer = MomentumObserver(model, gain, 5.0 / sampling.row_rate)
        self._rows, self._unexpected, self._momentum = Rows.empty(n), *np.zeros((2, 0, n))
        self._listening_time, self._moving_time = 0.0, 0.0  # s, and s of motion
        self._rest: RestPeriod | None = None
        self._drifting = False  # and reported
        self._band: Band | None = None
        self._limits = Limits(self.settings.false_alarms / 3600.0)
        self._baseline: Sums | None = None  # of what has left the window since the last change
        self._pending: float | None = None  # since when a cause has passed
        self._typical_gains = TypicalGains.begin(n)
        self._levels: tuple[tuple[float, Array], ...] = ()  # at the last looks
        self._push: _Push | None = None
        self._ended_pushes: tuple[_Push, ...] = ()
        self._excluded_spans: tuple[tuple[float, float], ...] = ()
        self._unexplained_joints: frozenset[str] = (
            frozenset()
        )  # joints at which something has no name

    @property
    def gain(self) -> Array:
        """(n,) of the observer, 1/s: the fastest until noise is known."""
        return self._observer.gain

    def add(self, rows: Rows) -> MonitorUpdate:
        """Listen to the next (K, n) rows, one or two seconds of them.

        The residual does not depend on how many come at a time; what is reported is looked for once
        for all of them.
        """
        return self.run_tests(rows, self.observe(rows))

    def observe(self, rows: Rows) -> ObserverOutput:
        """Return the residual of the next (K, n) rows, at once; they are tested later."""
        return self._observer.advance(rows)

    def run_tests(self, rows: Rows, observed: ObserverOutput) -> MonitorUpdate:
        """Look for what the next (K, n) rows, which were observed, show."""
        most = round(self.settings.window * self.settings.sampling.row_rate)
        self._rows = Rows.joined([self._rows, rows]).at(slice(-most, None))
        self._unexpected = np.concatenate([self._unexpected, observed.unexpected])[-most:]
        self._momentum = np.concatenate([self._momentum, observed.momentum])[-most:]
        seconds = len(rows) / self.settings.sampling.row_rate
        before = self.ready
        self._listening_time += seconds
        moves = bool(np.any(np.ptp(rows.q, axis=0) > _MOVES * self.model.arm.scale))
        self._moving_time += seconds * moves
        if self.ready and not before:
            self._band, self._baseline = None, None  # at rest there is less noise
        deviation, events = np.full(rows.q.shape, np.nan), list[Event]()
        if self._listening_time >= self.settings.warm_up:
            deviation, events = self._test_window(len(rows))
            events += self._find_drift(None if moves else RestPeriod.of(rows, observed.unexpected))
        return MonitorUpdate(observed.residual, deviation, tuple(events))

    def _find_drift(self, rest: RestPeriod | None) -> Iterator[Event]:
        """Yield the drift of a torque while the arm rests, once."""
        if rest is None or self._rest is None:
            self._rest, self._drifting = rest, False
            return
        self._rest = self._rest.extended_by(rest, _MOVES * self.model.arm.scale)
        assert self._band is not None  # since the window was tested
        trend = self._rest.trend(self._limits.false_alarms, self._band.error)
        if trend is None or self._drifting:
            return
        self._drifting = True
        arm, half = self.model.arm, NORMAL_95 * trend.error
        unit = arm.effort_units[trend.joint]
        value = Estimate(trend.change, trend.change - half, trend.change + half, unit)
        name = arm.joint_names[trend.joint]
        yield Event("drift", trend.since, float(rest.time[0]), (name,), values={"change": value})

    @property
    def _cause_limits(self) -> Limits:
        """Limits of causes, by the errors before what may have changed of late."""
        if not self._levels:
            return self._limits
        return replace(self._limits, level=self._levels[0][1])

    @property
    def ready(self) -> bool:
        """Whether there was enough motion to know the arm as it usually is."""
        return self._moving_time >= self.settings.warm_up

    def _test_window(self, new: int) -> tuple[Array, list[Event]]:
        """Return (new, n) standard deviations of the last rows' residuals, and events."""
        sampling = self.settings.sampling
        if self._band is None:
            noise = (white_noise(each) for each in (self._rows.effort, self._momentum))
            gain = gain_for(1.0 / sampling.row_rate, *noise)
            self._observer.gain = gain
            measured = np.sqrt(np.mean(self._unexpected**2, axis=0))
            self._band = Band.of(self.model, measured, gain)
            self._limits = calibration_limits(
                self.model, self._band, sampling, self.settings.window, self._limits, self._tip
            )
        window = self._window(self._excluded_spans)
        self._look_for_push(window, new)
        window = window.without_spikes()
        test = ChangeTest(window.uncertain, window.residual, self._baseline)
        events = list(self._find_change(window, test)) if self.ready else []
        events = events or list(self._finished_pushes(window))
        if len(self._rows) >= round(self.settings.window * sampling.row_rate):
            self._baseline = self._extended_baseline(window, new)
        each = sampling.rows_per_sample
        last = slice(-max(1, new // each), None)
        deviation = np.repeat(window.deviation(test, last), each, axis=0)[-new:]
        return np.pad(deviation, ((new - len(deviation), 0), (0, 0)), mode="edge"), events

    def _window(self, without: tuple[tuple[float, float], ...]) -> Window:
        """Return the rows without some spans of time and the torque of reported changes."""
        assert self._band is not None  # since the window was tested
        window = Window.of(
            self.model, self._rows, self._unexpected, self._band, self.settings.sampling, without
        )
        for change in self.changes:
            window = window.without_change(change.hypothesis, change.theta, change.since)
        return window

    def _extended_baseline(self, window: Window, new: int) -> Sums:
        """Return the sums over all samples that left the window, or are about to."""
        settings, rate = self.settings, self.settings.sampling.row_rate
        leaving = window.time < window.time[0] + new / rate
        rows = window.uncertain[leaving, :, : window.n_fixed].reshape(-1, window.n_fixed)
        sums = Sums.of(rows, window.residual[leaving].reshape(-1))
        if self._baseline is None:
            return sums
        return self._baseline.plus(sums, float(np.exp(-new / rate / settings.forgetting_time)))

    def _find_change(self, window: Window, test: ChangeTest) -> Iterator[Event]:
        """Yield the change that the last seconds show, if it has lasted and has a cause."""
        settings, now = self.settings, float(window.time[-1])
        found = list(find_candidates(window, test, self._onsets(window), self._cause_limits))
        passing = [each for each in self._plausible(found, window, 0.0) if each.significant()]
        if not passing:
            self._pending = None
            return
        if self._pending is None:
            self._pending = now
        first = likeliest(passing)
        if not first.is_persistent() or first.size(window) < settings.min_relative_size:
            return
        least = settings.longest_push + 1.0 if first.resembles_push() else settings.min_duration
        if now - first.since < least:
            return
        # Samples before the onset, taken for some with a cause, speak for one of another shape.
        onset = first.onset(window)
        choice = self._choose(found, window, first, onset)
        if choice is None:
            return
        best, rivals = choice
        # Which link carries a load, a motion may never show.
        others = [each for each in rivals if not each.differs_by_link(best)]
        if others and now - onset < settings.patience:
            return
        # What a named change leaves at first, some seconds of motion explain.
        if self.changes and now - self._pending < settings.min_duration:
            return
        explains = best.remaining_error(window.usable) < settings.misfit_limit
        if not explains and now - self._pending < settings.give_up:
            return
        since_onset = [push for push in self._ended_pushes if push.begin >= onset - 1.0]
        if not all(self._outlasts(push, best.hypothesis) for push in since_onset):
            return
        self._pending, self._push = None, None
        self._ended_pushes = tuple(push for push in self._ended_pushes if push not in since_onset)
        joints = best.joints()
        known = {change.hypothesis.key: change for change in self.changes}
        again = known.get(best.hypothesis.key)
        if explains and again is not None:
            more = replace(again, theta=again.theta + best.evidence.theta)
            self.changes = tuple(more if each is again else each for each in self.changes)
            return
        if not explains or joints[0] in (change.joint for change in self.changes):
            # Two names at one joint are none: the cause is one that has no name here.
            self._unexplained_joints |= {joints[0]}
            yield Event("unexplained", onset, now, joints)
            return
        # What begins with a change that was reported may be the error of that one's torque.
        ambiguous = bool(self.changes) and self._baseline is None
        change = Change(best.hypothesis, best.evidence.theta, onset, joints[0])
        self.changes, self._baseline = (*self.changes, change), None
        since = int(np.argmax(self._rows.time >= onset))
        self._rows = self._rows.at(slice(since, None))
        self._unexpected, self._momentum = self._unexpected[since:], self._momentum[since:]
        yield Event(
            "change", onset, now, joints, best.hypothesis.effect, best.hypothesis.where, None,
            best.reported(window), "perhaps" if rivals or ambiguous else "certain",
            tuple(each.alternative() for each in rivals),
        )  # fmt: skip

    def _choose(
        self, found: Sequence[ChangeCandidate], window: Window, first: ChangeCandidate, onset: float
    ) -> tuple[ChangeCandidate, list[ChangeCandidate]] | None:
        """Return the cause to be named, as it begins at an onset, and what is as likely.

        ``None``: there is none of significant size that passes.
        """
        near = self._plausible(found, window, min(0.0, first.excess - self._margin(first)))
        causes = {candidate.hypothesis.key: candidate for candidate in near}
        fits = (candidate.refit_from(onset, window) for candidate in causes.values())
        begun = [candidate for candidate in fits if candidate is not None]
        likely = [candidate for candidate in begun if candidate.significant()]
        if not likely or likeliest(likely).excess <= 0.0:
            return None
        best = likeliest(likely)
        least = best.excess - self._margin(best)
        equal = [candidate for candidate in begun if candidate is best or candidate.excess > least]
        # Friction changes from day to day, and warms up: the commonest of causes as likely.
        friction = [
            candidate
            for candidate in likely
            if candidate in equal and candidate.excess > 0.0
            and is_friction(candidate.hypothesis.effect)
        ]  # fmt: skip
        named = likeliest(friction or [best])
        return named, [candidate for candidate in equal if candidate is not named]

    def _plausible(
        self, found: Iterable[ChangeCandidate], window: Window, excess: float
    ) -> list[ChangeCandidate]:
        """Return plausible fits with more excess, where not all is unexplained anyway."""
        fits = (candidate.plausible_fit(window) for candidate in found if candidate.excess > excess)
        return [
            candidate
            for candidate in fits
            if candidate is not None and candidate.excess > excess
            and candidate.joints()[0] not in self._unexplained_joints
        ]  # fmt: skip

    def _margin(self, candidate: ChangeCandidate) -> float:
        """Return by how much gain a cause must excel others."""
        settings = self.settings
        return max(
            settings.margin * max(candidate.typical_gain, _LIKE_CAUSE),
            settings.margin_fraction * candidate.evidence.gain,
        )

    def _outlasts(self, push: _Push, cause: Hypothesis | None = None) -> bool:
        """Return whether what seems a push is a change: some cause shows without it as well."""
        window = self._window((*self._excluded_spans, push.span)).without_spikes()
        test = ChangeTest(window.uncertain, window.residual, self._baseline)
        first = int(np.searchsorted(window.time, push.begin))
        firsts = [first] if first else self._onsets(window)
        found = find_candidates(window, test, firsts, self._cause_limits)
        return any(
            candidate.excess > 0.0 and candidate.plausible_fit(window) is not None
            for candidate in found
            if cause is None or candidate.hypothesis.key == cause.key
        )

    def _onsets(self, window: Window) -> list[int]:
        """Return the samples with which a cause may have begun, rising."""
        settings, now = self.settings, float(window.time[-1])
        if (
            self._baseline is None
            and len(self._rows) < settings.min_history * settings.sampling.row_rate
        ):
            # Too little is known from before the last seconds: all has the cause, or nothing has.
            return [0]
        firsts = np.searchsorted(window.time, now - np.array(settings.spans))
        return np.unique(firsts[firsts > 0]).tolist()

    def _finished_pushes(self, window: Window) -> Iterator[Event]:
        """Yield pushes that are over, and are no change."""
        now = float(window.time[-1])
        for push in self._ended_pushes:
            if self._pending is not None and now - push.end <= self.settings.min_duration:
                continue  # it may be a change
            self._ended_pushes = tuple(other for other in self._ended_pushes if other is not push)
            if self._pending is None or not self._outlasts(push):
                self._excluded_spans = (*self._excluded_spans, push.span)
                yield self._push_event(push, now)
        self._excluded_spans = tuple(s for s in self._excluded_spans if s[1] > window.time[0] - 2.0)

    def _look_for_push(self, window: Window, new: int) -> None:
        """Begin a push, go on with it, or end it, by what the last rows show."""
        settings, now = self.settings, float(window.time[-1])
        rate = settings.sampling.row_rate
        first_new = int(np.searchsorted(window.time, now - new / rate))
        earliest = float(window.time[max(first_new - LONGEST_TRANSIENT, 0)])
        # What a push adds must not pass for what is uncertain anyway.
        pushes = self._ended_pushes if self._push is None else (*self._ended_pushes, self._push)
        until = min([earliest, *(push.begin - _ASIDE for push in pushes)])
        before = (window.time < until)[:, None]
        uncertain = window.uncertain * before[:, :, None]
        known = ChangeTest(uncertain, window.residual * before, self._baseline)
        blind = [self.model.arm.joint_names.index(name) for name in self._unexplained_joints]
        found = transient_torques(window.with_rests(), known, first_new, self._tip, blind)
        limit = self._limits.push_limit(
            found.gain, self._typical_gains.for_transients(found), self._typical_gains.largest
        )
        over = max((push.end for push in self._ended_pushes), default=-np.inf)
        begins = window.time[found.begin]
        excess = np.where(begins[:, None] > over, found.gain / limit, 0.0)
        acts = excess > 1.0
        goes_on = acts[begins > window.time[first_new] - _ASIDE].any()
        forgotten = new / rate / settings.forgetting_time
        self._typical_gains = self._typical_gains.updated(found, limit, float(np.exp(-forgotten)))
        self._levels = (*self._levels, (now, self._typical_gains.level))
        self._levels = tuple(each for each in self._levels if each[0] > now - settings.level_delay)
        if acts.any():
            clearest = int(excess.max(axis=1).argmax())
            begin, end = float(begins[clearest]), found.end[clearest] - 1
            felt = np.any(acts, axis=1, keepdims=True) & (found.gain[:, :-1] > NORMAL_95**2)
            peak = np.max(np.abs(np.where(felt, found.torque, 0.0)), axis=0)
            if not peak.any():  # a little at several
                peak = np.abs(window.torque[found.begin[clearest] : end].mean(axis=0))
            old = self._push or _Push(begin, peak, now)
            inside = window.time >= max(begin, now - new / rate)
            step = 1.0 / settings.sampling.sample_rate
            torque = np.linalg.norm(window.torque[inside], axis=1)
            self._push = replace(
                old, peak=np.maximum(old.peak, peak), end=float(window.time[end]),
                impulse=old.impulse + step * torque.sum(),
            )  # fmt: skip
        if self._push is not None and not goes_on:
            if now - self._push.begin < settings.longest_push + 2.0:
                self._ended_pushes = (*self._ended_pushes, self._push)
            self._push = None

    def _push_event(self, push: _Push, now: float) -> Event:
        arm, order = self.model.arm, np.argsort(-push.peak)
        names = arm.joint_names
        joints = tuple(names[j] for j in order if push.peak[j] > 0.2 * push.peak.max())
        values = {
            names[j]: Estimate(float(push.peak[j]), np.nan, np.nan, arm.effort_units[j])
            for j in order
            if push.peak[j] > 0.0
        }
        return Event(
            "push", push.begin, now, joints, end=push.end, values=values, impulse=push.impulse
        )
