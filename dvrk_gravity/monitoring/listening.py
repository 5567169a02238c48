"""A monitor that listens to an arm's messages: what is published of each row, and what was found.

Readings are checked as the compensator checks them. Torques are worked out a few rows at a time,
which costs hardly more than one; the tests, which take longer than a message may wait, run in a
thread of their own, two seconds of rows at a time.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.compensate import DroppedSampleError, InputGate, Sample, SampleReader
from dvrk_gravity.effects import stated_weight
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.monitoring.events import Event
from dvrk_gravity.monitoring.observer import ObserverOutput
from dvrk_gravity.monitoring.rows import RowMaker, Rows
from dvrk_gravity.monitoring.settings import MonitorSettings
from dvrk_gravity.monitoring.stream import Monitor, MonitorUpdate
from dvrk_gravity.monitoring.window import breakaway_torque
from dvrk_gravity.monitoring.wrench import Tip, Wrench
from dvrk_gravity.parameters import DEAD_BAND

# Looks that wait for the tests: a machine that stands still for longer skips some.
_WAITING = 10
_AT_ONCE = 10  # rows whose torques are worked out together: 0.2 s
_TESTED_FOR = 2.0  # s of rows that are tested together
_APART = 3.0  # standard deviations beyond which a state, which is no event, calls a torque external
_KEPT = 100  # events

State = Literal["silent", "learning", "as expected", "held by friction", "external", "changed"]


@dataclass(frozen=True, eq=False)
class Reading:
    """State, torques and wrench of one row.

    Attributes:
        stamp: Of its middle, by the clock of the arm's messages, ns.
        q: (n,) measured positions, rad or m.
        qd: (n,) measured velocities, rad/s or m/s.
        measured: (n,) measured torque, low-passed, N·m or N.
        expected: (n,) what the model expects, likewise, N·m or N.
        deviation: (n,) standard deviation that is expected of their difference; ``None``: not known
            before the first seconds.
        wrench: At the tip; ``None`` without a deviation.
    """

    stamp: int
    q: Array
    qd: Array
    measured: Array
    expected: Array
    deviation: Array | None
    wrench: Wrench | None

    @property
    def external(self) -> Array:
        """(n,) torque from outside, if the model is right, N·m or N."""
        return self.expected - self.measured


class BackgroundTests:
    """Runs a monitor's tests in a thread of their own.

    Attributes:
        monitor: The monitor.
        skipped: Rows that were never tested, because the tests were behind.
    """

    def __init__(self, monitor: Monitor) -> None:
        """Start the thread."""
        self.monitor = monitor
        self._pool = ThreadPoolExecutor(1, "monitor")
        self._pending: deque[Future[MonitorUpdate]] = deque()
        self.skipped = 0

    def submit(self, rows: Rows, observed: ObserverOutput) -> None:
        """Have rows tested that were observed, or skip them where too many wait."""
        if len(self._pending) >= _WAITING:
            self.skipped += len(rows)
            return
        self._pending.append(self._pool.submit(self.monitor.run_tests, rows, observed))

    def results(self, wait: bool = False) -> list[MonitorUpdate]:
        """Return what was found since the last call.

        Args:
            wait: For all that was asked.

        Raises:
            Exception: Whatever a test has raised.
        """
        found = []
        while self._pending and (wait or self._pending[0].done()):
            found.append(self._pending.popleft().result())
        return found

    def close(self) -> None:
        """End the thread after what it works on."""
        self._pool.shutdown(wait=True, cancel_futures=True)


class Listener:
    """Makes readings of an arm's messages.

    Attributes:
        model: The model.
        dropped: Messages that were left out, by cause.
        why_dropped: What was wrong with the last of them; ``""``: none was.
        events: The last ones, in the order in which they were reported. Their times are seconds of
            the clock of the arm's messages.
        last: The last reading.
        failures: How often tests have failed and started again.
        why_failed: What the last of these was; ``""``: none has.
    """

    def __init__(
        self, model: TorqueModel, tip: str = "", settings: MonitorSettings | None = None,
        timeout: float = 0.5,
    ) -> None:  # fmt: skip
        """Begin to listen.

        Args:
            model: The model.
            tip: Link at which wrenches act; by default the arm's last.
            settings: Of the tests.
            timeout: Silence after which a clock that was set back is believed, s.

        Raises:
            ConfigError: A model without terms, one that knows its arm's readings to be wrong, or a
                tip that is no link of the arm.
        """
        arm, self.model = model.arm, model
        _require_monitorable(model)
        self._settings = settings or MonitorSettings()
        self._tip = None if arm.read_in else Tip(arm, tip)
        self._read = SampleReader(arm).read
        self._timeout, sampling = timeout, self._settings.sampling
        self._gate = InputGate(arm)
        self._maker = RowMaker(sampling.row_rate)
        self._gap = 5.0 / sampling.row_rate  # s, after which torques begin again
        # Time and low-passed torque of the last row.
        self._smooth: tuple[float, Array] | None = None
        self._tests = BackgroundTests(Monitor(model, self._settings))
        self._origin: int | None = None  # ns, of the rows' time
        self._stamp, self._now = 0, 0.0  # of the last sample
        self.dropped = Counter[str]()
        self.why_dropped = self.why_failed = ""
        self.failures = 0
        self.events: deque[Event] = deque(maxlen=_KEPT)
        self.last: Reading | None = None
        self._deviation: Array | None = None
        self._rows: list[Rows] = []  # whose torques are not worked out yet
        self._untested: list[Rows] = []  # that are not yet given to the tests
        self._observed: list[ObserverOutput] = []  # of these
        self._listening_time = 0.0  # s of rows
        self._reported_changes: list[Event] = []

    @property
    def tip(self) -> str:
        """Name of the link at which wrenches act; ``""``: efforts are not in N·m."""
        return "" if self._tip is None else self._tip.link

    def receive(
        self, stamp: int, names: Sequence[str], position: Array, velocity: Array, effort: Array,
        now: float,
    ) -> list[Reading]:  # fmt: skip
        """Take the fields of a message; return readings of rows, whenever some are complete.

        A message that cannot be used is counted and left out.

        Args:
            stamp: ns.
            names: Of the joints, in any order, those of other mechanisms among them.
            position: rad or m.
            velocity: rad/s or m/s; empty: not measured.
            effort: N·m or N, or what the arm reads.
            now: Monotonic time of its arrival, s.
        """
        try:
            return self._take(self._read(stamp, names, position, velocity, effort), now)
        except DroppedSampleError as error:
            self.drop(error)
            return []

    def drop(self, error: DroppedSampleError) -> None:
        """Count a message that cannot be used."""
        self.dropped[error.cause] += 1
        self.why_dropped = str(error)

    def _take(self, sample: Sample, now: float) -> list[Reading]:
        if sample.effort is None:
            raise DroppedSampleError("no_effort", "no measured effort")
        if sample.stamp == self._stamp:
            raise DroppedSampleError("stamp_repeated", "a message that was there before")
        self._gate.admit(sample, now, sample.stamp, self._timeout, 0.0, False)
        if self._origin is None:
            self._origin = sample.stamp
        elif sample.stamp < self._stamp:  # the clock was set back: rows go on behind a gap
            passed = max(round((now - self._now) * 1e9), 1_000_000_000)
            self._origin -= self._stamp + passed - sample.stamp
        self._stamp, self._now = sample.stamp, now
        velocity = None if sample.velocity is None else self._gate.motion.velocity
        row = self._maker.add(
            (sample.stamp - self._origin) * 1e-9, sample.position, velocity, sample.effort
        )
        if row is not None:
            self._rows.append(row)
        if len(self._rows) < _AT_ONCE:
            return []
        rows, self._rows = Rows.joined(self._rows), []
        return self._advance(rows)

    def _advance(self, rows: Rows) -> list[Reading]:
        arm, rate = self.model.arm, self._settings.sampling.row_rate
        unread = None if arm.gravity_in_reading else stated_weight(arm, rows.q)
        if unread is not None:
            rows = replace(rows, effort=rows.effort + unread)
        observed = self._tests.monitor.observe(rows)
        self._listening_time += len(rows) / rate
        self._untested.append(rows)
        self._observed.append(observed)
        if sum(map(len, self._untested)) >= _TESTED_FOR * rate:
            self._tests.submit(Rows.joined(self._untested), ObserverOutput.joined(self._observed))
            self._untested, self._observed = [], []
        readings = [
            self._reading(*row)
            for row in zip(
                rows.time.tolist(), rows.q, rows.qd, rows.effort, observed.residual, strict=True
            )
        ]
        self.last = readings[-1]
        return readings

    def _reading(self, time: float, q: Array, qd: Array, effort: Array, residual: Array) -> Reading:
        """Return the reading of a row: its (n,) torques, their deviation, the wrench at the tip."""
        assert self._origin is not None  # there was a sample
        if self._smooth is not None and time - self._smooth[0] <= self._gap:
            keep = np.exp(-self._tests.monitor.gain * (time - self._smooth[0]))
            effort = keep * self._smooth[1] + (1.0 - keep) * effort
        self._smooth = time, effort
        wrench = None
        if self._tip is not None and self._deviation is not None:
            at = q - self.model.joint_offset
            wrench = self._tip.wrench(at, -residual, self._deviation)
        stamp = self._origin + round(time * 1e9)
        return Reading(stamp, q, qd, effort, effort - residual, self._deviation, wrench)

    def collect_events(self, wait: bool = False) -> list[Event]:
        """Return events that were found since the last call.

        Where a test fails, the tests start again: torques are published all the same.

        Args:
            wait: For the tests of all that was received.
        """
        found = []
        try:
            answers = self._tests.results(wait)
        except Exception as error:  # of any kind: a number that no test has met
            self.failures += 1
            self.why_failed = f"{type(error).__name__}: {error}"
            self._tests.close()
            self._tests = BackgroundTests(Monitor(self.model, self._settings))
            return []
        for seen in answers:
            if np.isfinite(seen.deviation).all():
                self._deviation = np.sqrt(np.mean(seen.deviation**2, axis=0))
            found += [self._at_clock(event) for event in seen.events]
        self.events.extend(found)
        self._reported_changes += [event for event in found if event.kind != "push"]
        return found

    def _at_clock(self, event: Event) -> Event:
        origin = 1e-9 * (self._origin or 0)
        end = None if event.end is None else event.end + origin
        return replace(event, onset=event.onset + origin, reported=event.reported + origin, end=end)

    def state(self, now: float) -> tuple[State, str]:
        """Return the state of an arm at a monotonic time, and what there is to say of it."""
        last, warm_up = self.last, self._settings.warm_up
        if last is None or now - self._now > 2.0 * self._timeout:
            return "silent", f"; {self.why_dropped}" if self.why_dropped else ""
        if last.deviation is None:
            return "learning", f"{min(self._listening_time, warm_up):.0f} of {warm_up:g} s"
        arm, size = self.model.arm, np.abs(last.external) / last.deviation
        joint = int(np.argmax(size))
        words = (
            f"{arm.joint_names[joint]} {last.external[joint]:+.3g} ± "
            f"{2.0 * last.deviation[joint]:.2g} {arm.effort_units[joint]}"
        )
        if self._reported_changes:
            return "changed", words
        if not (size > _APART).any():
            return "as expected", ""
        at_rest = (np.abs(last.qd) < DEAD_BAND * arm.scale).all()
        most = breakaway_torque(self.model, last.q) + _APART * last.deviation
        held = np.abs(last.external) < most
        return ("held by friction" if at_rest and held.all() else "external"), words

    @property
    def changes(self) -> tuple[Event, ...]:
        """What has changed since the monitor began."""
        return tuple(self._reported_changes)

    @property
    def skipped(self) -> int:
        """Rows that were not tested, because the tests were behind."""
        return self._tests.skipped

    def close(self) -> None:
        """End the tests."""
        self._tests.close()


def _require_monitorable(model: TorqueModel) -> None:
    if not model.terms:
        raise ConfigError("model", "no terms", "a model of the arm, from --params-file")
    wrong = model.of_readings()
    if model.reading_errors.any:
        name, value = next(iter(wrong.items()))
        raise ConfigError(name, value, "right readings: put them right and remove the parameter")
    arm = model.arm
    if not arm.gravity_in_reading and stated_weight(arm, np.zeros(arm.n)) is None:
        raise ConfigError(
            "effort_has_gravity.read", False, "true, or masses in the arm's file beside it"
        )
