"""The monitor: rows of measurements in, residuals and events out."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import Estimate, Hypothesis
from dvrk_gravity.estimation import NORMAL_95
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.monitoring.calibration import calibration_limits
from dvrk_gravity.monitoring.change_candidates import find_candidates
from dvrk_gravity.monitoring.change_choice import Choice, PlausibleChanges
from dvrk_gravity.monitoring.change_test import ChangeTest, Sums
from dvrk_gravity.monitoring.drift import RestPeriod
from dvrk_gravity.monitoring.events import Event
from dvrk_gravity.monitoring.limits import Limits
from dvrk_gravity.monitoring.observer import (
    FASTEST,
    MomentumObserver,
    ObserverOutput,
    gain_for,
    white_noise,
)
from dvrk_gravity.monitoring.pushes import Push, PushDetector
from dvrk_gravity.monitoring.rows import Rows
from dvrk_gravity.monitoring.settings import MonitorSettings
from dvrk_gravity.monitoring.window import Band, Window
from dvrk_gravity.monitoring.wrench import Tip

_MOVES = 0.01  # rad (Arm.scale), in a second or two, of an arm that moves. Chosen


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
        self._pushes = PushDetector(model.arm, self.settings, self._tip)
        self._unexplained_joints = frozenset[str]()  # at which something has no name

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
        return replace(self._limits, level=self._pushes.level)

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
        window = self._window(self._pushes.excluded_spans)
        names = self.model.arm.joint_names
        blind = [names.index(joint) for joint in self._unexplained_joints]
        self._pushes.look(window, new, self._baseline, self._limits, blind)
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
        plausible = PlausibleChanges(found, settings, self._unexplained_joints)
        if not plausible.passing:
            self._pending = None
            return
        if self._pending is None:
            self._pending = now
        choice = plausible.choose(now)
        if choice is None:
            return
        # What a named change leaves at first, some seconds of motion explain.
        if self.changes and now - self._pending < settings.min_duration:
            return
        if not choice.explains and now - self._pending < settings.give_up:
            return
        named = choice.named
        since_onset = [push for push in self._pushes.ended if push.begin >= named.since - 1.0]
        if not all(self._outlasts(push, named.hypothesis) for push in since_onset):
            return
        self._pending = None
        self._pushes.drop(since_onset)
        self._pushes.drop_acting()
        yield from self._accept(choice, now)

    def _accept(self, choice: Choice, now: float) -> Iterator[Event]:
        """Yield the event of a cause, and take its torque off what follows."""
        named, joints = choice.named, choice.named.joints()
        known = {change.hypothesis.key: change for change in self.changes}
        again = known.get(named.hypothesis.key)
        if choice.explains and again is not None:
            more = replace(again, theta=again.theta + named.evidence.theta)
            self.changes = tuple(more if each is again else each for each in self.changes)
            return
        if not choice.explains or joints[0] in (change.joint for change in self.changes):
            # Two names at one joint are none: the cause is one that has no name here.
            self._unexplained_joints |= {joints[0]}
            yield Event("unexplained", named.since, now, joints)
            return
        # What begins with a change that was reported may be the error of that one's torque.
        ambiguous = bool(self.changes) and self._baseline is None
        change = Change(named.hypothesis, named.evidence.theta, named.since, joints[0])
        self.changes, self._baseline = (*self.changes, change), None
        kept = slice(int(np.argmax(self._rows.time >= named.since)), None)
        self._rows = self._rows.at(kept)
        self._unexpected, self._momentum = self._unexpected[kept], self._momentum[kept]
        yield Event(
            "change", named.since, now, joints, named.hypothesis.effect, named.hypothesis.where,
            None, named.reported(), "perhaps" if choice.rivals or ambiguous else "certain",
            tuple(rival.alternative() for rival in choice.rivals),
        )  # fmt: skip

    def _outlasts(self, push: Push, cause: Hypothesis | None = None) -> bool:
        """Return whether what seems a push is a change: some cause shows without it as well."""
        window = self._window((*self._pushes.excluded_spans, push.span)).without_spikes()
        test = ChangeTest(window.uncertain, window.residual, self._baseline)
        first = int(np.searchsorted(window.time, push.begin))
        firsts = [first] if first else self._onsets(window)
        found = find_candidates(window, test, firsts, self._cause_limits)
        return any(
            candidate.excess > 0.0 and candidate.plausible_fit is not None
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
        for push in self._pushes.ended:
            if self._pending is not None and now - push.end <= self.settings.min_duration:
                continue  # it may be a change
            if self._pending is not None and self._outlasts(push):
                self._pushes.drop([push])
            else:
                yield self._pushes.report(push, now)
        self._pushes.forget_before(float(window.time[0]) - 2.0)
