"""What a monitor makes of messages as they come, good and bad ones, without ROS."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from dvrk_gravity.arms import Arm
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.monitoring import BackgroundTests, Listener, Monitor, MonitorSettings, Rows
from dvrk_gravity.planning import Multisine
from dvrk_gravity.simulate import PlantFile

ECM = Arm.load("ecm")
MODEL = PlantFile.of(ECM).model
QUICK = MonitorSettings(warm_up=3.0)
RATE = 100.0
EPOCH = 1_700_000_000_000_000_000


class Stream:
    """Messages of an arm that moves as its model says."""

    def __init__(self, model: TorqueModel = MODEL) -> None:
        self.model, self.motion = model, Multisine.draw(model.arm, 3)
        self.random = np.random.default_rng(5)
        self.listener = Listener(model, settings=QUICK)
        self.count, self.shift, self.now = 0, 0, 0.0  # samples, ns of the clock, monotonic s
        self.readings, self.found = [], []

    def send(self, external=0.0, **changed) -> None:
        """Send a message, some of its fields replaced."""
        arm, step = self.model.arm, 1e-4
        times = self.count / RATE + step * np.array([-1.0, 0.0, 1.0])
        (_, q, _), (before, qd, after) = self.motion.at(times)
        effort = self.model.torque(q, qd, (after - before) / (2 * step)) - external
        effort = effort + 1e-3 * arm.effort_limit * self.random.normal(size=arm.n)
        fields = {
            "stamp": EPOCH + self.shift + round(self.count / RATE * 1e9),
            "names": arm.joint_names, "position": q, "velocity": qd, "effort": effort,
        } | changed  # fmt: skip
        self.readings += self.listener.receive(**fields, now=self.now)
        self.count, self.now = self.count + 1, self.now + 1.0 / RATE

    def run(self, seconds: float, **given) -> None:
        """Send messages for a while, and wait for the tests of every second."""
        for number in range(1, 1 + round(seconds * RATE)):
            self.send(**given)
            if number % RATE == 0:
                self.found += self.listener.collect_events(wait=True)
        self.found += self.listener.collect_events(wait=True)


@pytest.fixture
def stream() -> Iterator[Stream]:
    made = Stream()
    yield made
    made.listener.close()


def test_expected_torque_band_and_wrench_are_known_after_the_first_seconds(stream):
    stream.run(2.0)
    assert stream.listener.state(stream.now)[0] == "learning"
    stream.run(5.0)
    assert stream.found == []
    assert stream.listener.state(stream.now)[0] == "as expected"
    last = stream.readings[-1]
    assert (np.abs(last.external) < 4.0 * last.deviation).all()
    assert len(last.wrench.unobservable) == 2  # of four joints
    assert len(stream.readings) == pytest.approx(7.0 * 50.0, abs=12)
    assert last.stamp == pytest.approx(EPOCH + 7.0e9, abs=0.25e9)
    assert stream.listener.dropped == {}


def test_a_torque_from_outside_is_published_with_its_sign(stream):
    stream.run(5.0)
    push = np.array([0.0, 0.0, 0.1 * ECM.effort_limit[2], 0.0])
    stream.run(0.5, external=push)
    assert stream.readings[-1].external == pytest.approx(push, abs=0.01 * ECM.effort_limit.max())
    state, words = stream.listener.state(stream.now)
    assert state == "external"
    assert ECM.joint_names[2] in words


@pytest.mark.parametrize(
    ("cause", "changed"),
    [
        ("no_stamp", {"stamp": 0}),
        ("not_finite", {"position": np.full(4, np.nan)}),
        ("no_effort", {"effort": np.full(4, np.inf)}),
        ("no_effort", {"effort": np.zeros(0)}),
        ("not_finite", {"velocity": np.full(4, np.nan)}),
        ("wrong_length", {"position": np.zeros(3)}),
        ("missing_joint", {"names": ("a", "b", "c", "d")}),
        ("duplicate_joint", {"names": (*ECM.joint_names[:3], ECM.joint_names[0])}),
        ("position_jump", {"position": np.full(4, 50.0)}),
        ("stamp_backwards", {"stamp": EPOCH - 5_000_000_000}),
    ],
)
def test_a_message_that_cannot_be_used_is_counted_and_changes_nothing(stream, cause, changed):
    stream.run(1.0)
    before = stream.readings[-1]
    for _ in range(3):
        stream.send(**changed)
    stream.run(0.5)
    assert stream.listener.dropped == {cause: 3}
    assert stream.listener.why_dropped
    assert stream.readings[-1].external == pytest.approx(before.external, abs=0.05)


def test_a_message_that_comes_twice_counts_once(stream):
    for _ in range(200):
        stream.send()
        stream.count -= 1
        stream.send()
    assert stream.listener.dropped == {"stamp_repeated": 200}


def test_joints_are_found_in_any_order_among_those_of_others(stream):
    stream.run(1.0)
    names = ("wheel", *reversed(ECM.joint_names))
    for _ in range(100):
        q, qd = (part[0] for part in stream.motion.at(np.array([stream.count / RATE])))
        effort = MODEL.torque(q, qd)
        fields = (np.r_[np.nan, each[::-1]] for each in (q, qd, effort))
        position, velocity, effort = fields
        stream.send(names=names, position=position, velocity=velocity, effort=effort)
    assert stream.listener.dropped == {}


def test_a_clock_that_is_set_back_or_a_publisher_that_begins_anew_is_followed(stream):
    stream.run(5.0)
    stream.shift = -3600 * 10**9
    stream.run(2.0)
    assert stream.listener.dropped.keys() <= {"stamp_backwards", "stamp_repeated"}
    assert stream.listener.dropped["stamp_backwards"] > 10
    count = len(stream.readings)
    stream.run(3.0)
    assert len(stream.readings) == pytest.approx(count + 150, abs=12)
    assert stream.found == []
    assert stream.readings[-1].stamp < EPOCH


def test_an_arm_that_falls_silent_is_said_to_be_and_comes_again(stream):
    stream.run(5.0)
    stream.now += 5.0
    assert stream.listener.state(stream.now)[0] == "silent"
    stream.count += round(5.0 * RATE)
    stream.run(2.0)
    assert stream.found == []
    assert stream.listener.state(stream.now)[0] == "as expected"


def test_at_rest_a_torque_that_friction_can_hold_is_no_push():
    model = PlantFile.of(Arm.load("mtmr")).model
    arm = model.arm
    listener, q = Listener(model, settings=QUICK), np.array([0.1, 0.2, 0.1, 0.3, 1.0, 0.1, 0.2])
    random = np.random.default_rng(1)

    def rest(seconds: float, first: int, external) -> float:
        for k in range(first, first + round(seconds * RATE)):
            effort = model.torque(q) - external + 1e-3 * random.normal(size=arm.n)
            stamp = EPOCH + round(k / RATE * 1e9)
            listener.receive(stamp, arm.joint_names, q, 0.0 * q, effort, k / RATE)
            listener.collect_events(wait=k % RATE == 0)
        listener.collect_events(wait=True)
        return (first + seconds * RATE) / RATE

    rest(5.0, 0, 0.0)
    rubs = np.abs(model.physical().torque(q, np.full(7, 0.3)) - model.torque(q))
    unit = np.eye(7)[1]
    now = rest(0.6, 500, 0.7 * rubs * unit)
    assert listener.state(now)[0] == "held by friction"
    now = rest(0.6, 560, 3.0 * rubs * unit)
    assert listener.state(now)[0] == "external"
    listener.close()


def test_rows_are_skipped_and_counted_where_the_tests_are_behind():
    class Slow(Monitor):
        def run_tests(self, rows, observed):
            started.append(len(rows))
            go.wait()
            return super().run_tests(rows, observed)

    from threading import Event

    started, go = [], Event()
    tests = BackgroundTests(Slow(MODEL))
    row = Rows(np.zeros(1), *np.zeros((3, 1, 4)))
    observed = tests.monitor.observe(row)
    for _ in range(14):
        tests.submit(Rows.empty(4), observed)
    assert tests.skipped == 0
    tests.submit(row, observed)
    assert tests.skipped == 1
    go.set()
    tests.close()


def test_tests_that_fail_begin_anew_and_say_why(stream, monkeypatch):
    def fail(*_):
        raise FloatingPointError("made up")

    monkeypatch.setattr(Monitor, "run_tests", fail)
    stream.run(2.2)
    monkeypatch.undo()
    failures = stream.listener.failures
    assert "made up" in stream.listener.why_failed
    stream.run(5.0)
    assert stream.found == []
    assert stream.listener.failures == failures
    assert stream.listener.state(stream.now)[0] == "as expected"


def test_a_model_that_cannot_be_monitored_with_is_refused():
    with pytest.raises(ConfigError, match="--params-file"):
        Listener(TorqueModel(ECM, ()))
    values = MODEL.parameters() | {"reading.effort_scale": (1.3, 1.0, 1.0, 1.0)}
    with pytest.raises(ConfigError, match=r"reading\.effort_scale"):
        Listener(TorqueModel.from_parameters(values, ECM))
    with pytest.raises(ConfigError, match="link"):
        Listener(MODEL, "no_such_link")
