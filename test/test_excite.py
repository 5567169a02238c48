"""Motions that excite, the limits that they keep, and driving an arm through ROS."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from arm_side import TIMEOUT

from dvrk_gravity.arms import JOINT_NAMES, Arm
from dvrk_gravity.command_line import run
from dvrk_gravity.planning import (
    Move,
    Multisine,
    PlanLimits,
    careful,
    covering_motion,
    exciting_motion,
)
from dvrk_gravity.recording import Recording
from dvrk_gravity.ros import PRIVATE

POSE = np.array([0.0, 0.2, 0.1, 0.0, 1.5, 0.0, 0.0])
ASLEEP = 2.0  # s that a busy machine may suspend what moves the arm


@pytest.mark.parametrize("name", ["mtmr", "mtml"])
@pytest.mark.parametrize(("seed", "duration"), [(0, 60.0), (1, 60.0), (2, 8.0), (3, 20.0)])
def test_an_exciting_motion_keeps_all_limits(name: str, seed: int, duration: float) -> None:
    arm = Arm.load(name)
    limits = PlanLimits.of(arm)
    step = 1e-3
    position, velocity = exciting_motion(limits, duration, seed).at(np.arange(0, duration, step))
    acceleration = np.diff(velocity, axis=0) / step
    slack = 1e-4  # rad, rad/s: limits are kept on a grid of 5 ms
    assert (arm.lower < limits.lower).all()
    assert (limits.upper < arm.upper).all()
    assert (position > limits.lower - slack).all()
    assert (position < limits.upper + slack).all()
    motor = np.degrees(position[:, 1] + position[:, 2])
    assert motor.min() > -9.01
    assert motor.max() < 39.01
    assert (np.abs(velocity) < limits.velocity + slack).all()
    assert (np.abs(acceleration) < 1.01 * limits.acceleration).all()


def test_it_goes_as_far_or_as_hard_as_the_limits_let_it() -> None:
    limits = PlanLimits.of(Arm.load("mtmr"))
    position, velocity = exciting_motion(limits, 60.0, 1).at(np.arange(0, 60.0, 5e-3))
    far = np.ptp(position, axis=0) / (limits.upper - limits.lower)
    hard = np.abs(np.diff(velocity, axis=0) / 5e-3).max(axis=0) / limits.acceleration
    assert (np.maximum(far, hard)[[0, 2, 3, 4, 5, 6]] > 0.7).all()
    # The shoulder shares its limits with the elbow.
    assert far[1] > 0.25


@pytest.mark.parametrize("name", ["mtmr", "psm", "ecm"])
def test_a_covering_motion_keeps_all_limits_and_another_one_stays_within_what_it_has_shown(
    name: str,
) -> None:
    limits = PlanLimits.of(Arm.load(name))
    step, time = 1e-3, np.arange(0.0, 60.0, 1e-3)
    shown, again = (covering_motion(limits, 60.0, seed).at(time) for seed in (1, 2))
    slack = 1e-4  # rad, rad/s: limits are kept on a grid of 5 ms
    for position, velocity in (shown, again):
        assert (position > limits.lower - slack).all()
        assert (position < limits.upper + slack).all()
        assert (np.abs(velocity) < limits.velocity + slack).all()
        acceleration = np.diff(velocity, axis=0) / step
        assert (np.abs(acceleration) < 1.01 * limits.acceleration).all()
        if limits.pair is not None:
            both = position[:, limits.pair.first] + position[:, limits.pair.second]
            assert limits.pair.lower - slack < both.min()
            assert both.max() < limits.pair.upper + slack
    lowest, highest = shown[0].min(axis=0), shown[0].max(axis=0)
    part = (highest - lowest) / (limits.used * (limits.upper - limits.lower))
    assert (part > 0.7).all()  # of a joint with more than a turn what its velocity allows
    outside = ((again[0] < lowest) | (again[0] > highest)).mean(axis=0)
    assert (outside < 0.25).all()
    exciting = exciting_motion(limits, 60.0, 1).at(time)[0]
    assert (np.ptp(exciting, axis=0) <= (highest - lowest) + 0.1).all()


def test_it_begins_and_ends_at_rest_in_the_same_place() -> None:
    motion = exciting_motion(PlanLimits.of(Arm.load("mtmr")), 20.0, 5)
    for moment in (0.0, 20.0, 30.0):
        position, velocity = motion.at(moment)
        np.testing.assert_allclose(position, motion.middle, atol=1e-12)
        np.testing.assert_allclose(velocity, 0.0, atol=1e-12)


def test_the_velocity_of_a_multisine_is_its_derivative() -> None:
    motion = exciting_motion(PlanLimits.of(Arm.load("mtmr")), 20.0, 5)
    time = np.arange(0.0, 20.0, 1e-3)
    position, velocity = motion.at(time)
    np.testing.assert_allclose(np.gradient(position, 1e-3, axis=0)[1:-1], velocity[1:-1], atol=2e-3)


def test_multisines_of_simulated_arms_are_those_of_old() -> None:
    """Recordings by seed, of tests and of the documentation's figures, stay what they were."""
    motion = Multisine.draw(Arm.load("mtmr"), 3)
    for moment, yaw, roll_speed in (
        (2.5, -0.5924698652202719, -0.22707961444104924),
        (0.5, -0.2883279324424135, 0.6310056843544205),
    ):
        position, velocity = motion.at(moment)
        assert position[0] == pytest.approx(yaw, abs=1e-12)
        assert velocity[6] == pytest.approx(roll_speed, abs=1e-12)


def test_a_velocity_limit_that_the_arm_s_file_states_binds(tmp_path: Path) -> None:
    urdf = tmp_path / "arm.urdf"
    joint = (
        '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/>'
        '<axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="10" velocity="{3}"/></joint>'
    )
    link = (
        '<link name="{0}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" '
        'ixz="0" iyz="0"/></inertial></link>'
    )
    urdf.write_text(
        f'<robot name="two">{"".join(map(link.format, "abc"))}'
        f"{joint.format('slow', 'a', 'b', 0.1)}{joint.format('fast', 'b', 'c', 5.0)}</robot>"
    )
    limits = PlanLimits.of(Arm.load(urdf))
    np.testing.assert_allclose(limits.velocity, [0.1, np.radians(60.0)])
    _, velocity = exciting_motion(limits, 30.0, 1).at(np.arange(0.0, 30.0, 1e-3))
    assert np.abs(velocity[:, 0]).max() < 0.1 + 1e-4
    assert np.abs(careful(Arm.load(urdf))[0][0]) <= 0.1


def test_one_seed_is_one_motion() -> None:
    limits = PlanLimits.of(Arm.load("mtmr"))
    first, again, other = (exciting_motion(limits, 20.0, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.at(7.0)[0], again.at(7.0)[0])
    assert np.abs(first.at(7.0)[0] - other.at(7.0)[0]).max() > 0.1


def test_a_move_keeps_the_limits_that_it_is_given() -> None:
    limits = PlanLimits.of(Arm.load("mtmr"))
    move = Move(POSE, POSE + 0.4, limits.velocity, limits.acceleration)
    time = np.linspace(0.0, move.duration, 2000)
    velocity = np.array([move.at(moment)[1] for moment in time])
    acceleration = np.diff(velocity, axis=0) / (time[1] - time[0])
    assert (np.abs(velocity) <= limits.velocity).all()
    assert (np.abs(acceleration) <= limits.acceleration).all()
    assert np.max(np.abs(acceleration) / limits.acceleration) > 0.99


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--duration", "3"], "--duration: got 3.0, expected 8 to 600"),
        (["--rate", "nan"], "--rate: got nan, expected 50 to 500"),
        (["--seed", "-1"], "--seed: got -1"),
        (["--timeout", "0"], "--timeout: got 0.0"),
        (["--namespace", "a b"], "--namespace: got '/a b', expected a ROS namespace"),
        (["--namespace", "/MTML"], "namespace: got '/MTML', expected that of arm mtmr, as /MTMR"),
        (["--namespace", "/left/PSM2"], "expected that of arm mtmr"),
        (["--ros-args", "-r", "__ns:=/MTML"], "--ros-args: got '--ros-args -r __ns:=/MTML'"),
        (["--motions", "0"], "--motions: got 0, expected 1 to 20"),
        (["--arm", "mtmx"], "arm: got 'mtmx'"),
        (["--out", "."], ".: --out: got 'a folder that exists already', expected a new name"),
        (["--out", "no/such/bag"], "expected an existing folder"),
    ],
)
def test_a_wrong_argument_is_one_line_and_status_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], says: str
) -> None:
    pytest.importorskip("rclpy")
    assert (
        run("dvrk_gravity.cli.excite", ["--arm", "mtmr", "--out", str(tmp_path / "bag"), *words])
        == 2
    )
    error = capsys.readouterr().err
    assert says in error
    assert error.count("\n") == 1


# --- through ROS ---------------------------------------------------------------------------


class FakeArm:
    """An arm that goes where it is told, at once; its node spins in a thread."""

    def __init__(self) -> None:
        from rclpy.time import Time
        from sensor_msgs.msg import JointState
        from std_msgs.msg import Empty

        from dvrk_gravity.ros import Client

        self.client, self.time = Client(name="fake_arm"), Time
        self.position = POSE.copy()
        self.follows, self.speaks = True, True
        self.order = list(range(7))  # of the joints in what it measures
        self.told: list[np.ndarray] = []
        self.holds = 0
        self.slow = 1.0
        self.effort: list[float] = []
        node = self.client.node
        self.message = JointState
        self.measured = node.create_publisher(JointState, "measured_js", 100)
        self.servo_jf = node.create_publisher(JointState, "servo_jf", 10)
        self.servo_jp = node.create_subscription(
            JointState, "servo_jp", lambda m: self.on_servo_jp(m), 100
        )
        node.create_subscription(Empty, "hold", self.on_hold, 10)
        self.speak_timer = node.create_timer(0.01, self.speak)

    def on_servo_jp(self, message) -> None:
        self.told.append(np.array(message.position))
        if self.follows:
            self.position = self.told[-1]

    def on_hold(self, _) -> None:
        self.holds += 1

    def speak(self) -> None:
        """Measure, where all commands lead that have arrived, however late this thread is."""
        while taken := self.servo_jp.handle.take_message(self.message, False):
            self.on_servo_jp(taken[0])
        if self.speaks:
            names = [JOINT_NAMES[i] for i in self.order]
            message = self.message(name=names, position=self.position[self.order].tolist())
            message.effort = self.effort
            message.header.stamp = self.stamp()
            self.measured.publish(message)

    def stamp(self):
        """The arm's clock, which may be slower than ours."""
        ns = time.time_ns()
        self.origin = getattr(self, "origin", ns)
        return self.time(nanoseconds=self.origin + round((ns - self.origin) * self.slow)).to_msg()

    def __enter__(self) -> FakeArm:
        self.ends = threading.Event()
        self.thread = threading.Thread(target=self.spin)
        self.thread.start()
        return self

    def spin(self) -> None:
        while not self.ends.is_set():
            self.client.spin_once()

    def __exit__(self, *_: object) -> None:
        self.ends.set()
        self.thread.join()
        self.client.__exit__()

    def held(self) -> bool:
        end = time.monotonic() + 10.0
        while not self.holds and time.monotonic() < end:
            self.ends.wait(0.01)
        return bool(self.holds)


@pytest.fixture
def fake(domain: int, monkeypatch: pytest.MonkeyPatch) -> Iterator[FakeArm]:
    pytest.importorskip("rclpy")
    from dvrk_gravity.ros import mover

    monkeypatch.setattr(mover, "ASLEEP", ASLEEP)
    with FakeArm() as arm:
        yield arm


@contextlib.contextmanager
def mover(fake: FakeArm):
    from dvrk_gravity.ros import Client, Mover

    with Client(name="excite") as client, Mover(client, Arm.load("mtmr"), 200.0, TIMEOUT) as moving:
        yield moving


def to(goal: np.ndarray, duration: float = 1.0):
    move = Move(POSE, goal, *careful(Arm.load("mtmr")))
    return lambda time: move.at(time * move.duration / duration)


def test_the_arm_is_driven_along_the_path_and_held_in_the_end(fake: FakeArm) -> None:
    recorded: list[bytes] = []
    with mover(fake) as moving:
        np.testing.assert_array_equal(moving.connect(), POSE)
        moving.follow(to(POSE + 0.1), 1.0, recorded.append)
        assert not fake.holds
    assert fake.held()
    np.testing.assert_allclose(fake.told[0], POSE, atol=1e-3)
    np.testing.assert_allclose(fake.told[-2], POSE + 0.1)
    # Held where it was measured, the last readings of the end of the motion among them.
    np.testing.assert_allclose(fake.told[-1], POSE + 0.1, atol=1e-3)
    assert len(fake.told) > 50
    assert len(recorded) > 20


def test_the_motion_runs_by_the_arm_s_clock(fake: FakeArm) -> None:
    """As of a simulator whose machine is too slow: its motion is no other, it takes longer."""
    fake.slow = 0.5
    with mover(fake) as moving:
        moving.connect()
        begin = time.monotonic()
        moving.follow(to(POSE + 0.1), 1.0)
        assert time.monotonic() - begin > 1.7
    assert np.abs(np.diff(fake.told, axis=0)).max() < 0.02


def test_after_a_pause_of_ours_the_arm_is_not_sent_after_the_motion(fake: FakeArm) -> None:
    paused = []

    def path(t: float) -> tuple[np.ndarray, np.ndarray]:
        if t > 0.5 and not paused:
            paused.append(t)
            time.sleep(0.2)
        return POSE + 0.5 * t, np.full(7, 0.5)

    with mover(fake) as moving:
        moving.connect()
        longer = moving.follow(path, 1.0)
    assert paused
    assert longer > 0.1  # of the pause, but for what one step makes up for
    # 0.5 rad/s for the 20 ms that a step is at most; the last holds the arm where it was measured.
    assert np.abs(np.diff(fake.told[:-1], axis=0)).max() < 0.011


@pytest.mark.parametrize(
    ("topic", "says"),
    [
        ("servo_jf", f"commands {PRIVATE}/servo_jf: stop it first"),
        ("hold", "sent hold"),
    ],
)
def test_an_arm_that_somebody_else_commands_is_left_alone(
    fake: FakeArm, topic: str, says: str
) -> None:
    from std_msgs.msg import Empty

    from dvrk_gravity.ros import MotionError

    other = fake.client.node.create_publisher(Empty, "hold", 10)
    send = {
        "servo_jf": lambda: fake.servo_jf.publish(fake.message(effort=[0.0] * 7)),
        "hold": lambda: other.publish(Empty()),
    }[topic]
    fake.client.node.create_timer(0.1, send)
    with (
        mover(fake) as moving,
        pytest.raises(MotionError, match=f"another node.* {says}"),
    ):
        moving.connect()
    assert not fake.told


def fault(fake: FakeArm, name: str) -> None:
    """Do it in the middle of a motion."""

    def now() -> None:
        timer.cancel()
        if name == "silent":
            fake.speaks = False
        elif name == "stopped":
            fake.slow = 0.0
        elif name == "frozen":
            stamp = fake.stamp()
            fake.stamp = lambda: stamp
        elif name == "stuck":
            fake.follows = False
        elif name == "invalid":
            fake.position = np.full(7, np.nan)
            fake.follows = False
        elif name == "rival":
            fake.servo_jf.publish(fake.message(effort=[0.0] * 7))
        else:
            os.kill(os.getpid(), signal.Signals[name])

    timer = fake.client.node.create_timer(0.5, now)


def second_arm(fake: FakeArm, position: np.ndarray, ahead: float = 0.0) -> None:
    """Let somebody else measure an arm that stands elsewhere, its stamps ahead by some s."""
    other = fake.client.node.create_publisher(fake.message, "measured_js", 100)

    def speak() -> None:
        message = fake.message(name=JOINT_NAMES, position=position.tolist())
        stamp = fake.time.from_msg(fake.stamp()).nanoseconds + round(ahead * 1e9)
        message.header.stamp = fake.time(nanoseconds=stamp).to_msg()
        other.publish(message)

    fake.client.node.create_timer(0.013, speak)


@pytest.mark.parametrize("ahead", [0.0, 0.03])
@pytest.mark.parametrize("when", ["before", "on the way"])
def test_two_arms_on_one_topic_are_not_driven(fake: FakeArm, when: str, ahead: float) -> None:
    from dvrk_gravity.ros import MotionError

    elsewhere = POSE + np.radians(30.0)
    with mover(fake) as moving:
        if when == "before":
            second_arm(fake, elsewhere, ahead)
            with pytest.raises(MotionError, match=rf"several nodes .*{PRIVATE}/fake_arm"):
                moving.connect()
            assert not fake.told
            return
        moving.connect()
        begin = len(fake.told)

        def appear() -> None:
            timer.cancel()
            second_arm(fake, elsewhere, ahead)

        timer = fake.client.node.create_timer(0.3, appear)
        with pytest.raises(MotionError, match=r"several nodes .* stop all but the arm"):
            moving.follow(to(POSE + 0.1, 2.0), 2.0)
    assert fake.held()
    assert np.abs(np.array(fake.told[begin:]) - POSE).max() < 0.1
    assert np.abs(np.diff(fake.told, axis=0)).max() < np.radians(2.0)


@pytest.mark.parametrize("wrong", [1, 5, 60])
def test_wrong_readings_at_the_start_command_nothing_wrong(fake: FakeArm, wrong: int) -> None:
    """An encoder that reads 123 deg off for a moment, as when an arm is homed."""
    from dvrk_gravity.ros import MotionError

    off = np.radians(123.0) * np.eye(7)[3]
    speak, spoken = fake.speak, []

    def speak_wrongly() -> None:
        spoken.append(time.monotonic())
        right = fake.position
        if spoken[-1] - spoken[0] < 0.01 * (wrong - 0.5):  # however few a late machine sends
            fake.position = POSE + off
        speak()
        fake.position = right

    with mover(fake) as moving:
        moving.connect()
        fake.speak_timer.cancel()
        fake.client.node.create_timer(0.01, speak_wrongly)
        # Many are an arm that moves, unless they end soon enough not to count.
        with contextlib.suppress(MotionError):
            np.testing.assert_allclose(moving.connect(), POSE)
            moving.follow(to(POSE + 0.1), 1.0)
    assert fake.told or wrong > 10
    assert all(np.abs(told - POSE).max() < 0.1 + 1e-9 for told in fake.told)


def test_an_encoder_that_slips_on_the_way_stops_the_arm_where_it_was_told_to_be(
    fake: FakeArm,
) -> None:
    from dvrk_gravity.ros import MotionError

    slip = np.radians(25.0) * np.eye(7)[2]

    def slipped(message) -> None:
        fake.told.append(np.array(message.position))
        fake.position = fake.told[-1] + slip * (len(fake.told) > 60)

    fake.on_servo_jp = slipped
    with mover(fake) as moving:
        moving.connect()
        with pytest.raises(MotionError, match=r"elbow_pitch (by|is 2).*(encoder|set point)"):
            moving.follow(to(POSE + 0.1, 2.0), 2.0)
    assert fake.held()
    assert np.abs(np.array(fake.told) - POSE).max() < 0.1


def test_an_arm_that_moves_by_itself_is_not_driven(fake: FakeArm) -> None:
    from dvrk_gravity.ros import MotionError

    begin = time.monotonic()

    def drift() -> None:
        fake.position = POSE + 0.1 * (time.monotonic() - begin) * np.eye(7)[1]

    fake.client.node.create_timer(0.01, drift)
    with mover(fake) as moving, pytest.raises(MotionError, match="shoulder_pitch moves by"):
        moving.connect()
    assert not fake.told


def test_an_arm_that_was_moved_meanwhile_is_not_driven_back(fake: FakeArm) -> None:
    from dvrk_gravity.ros import MotionError

    with mover(fake) as moving:
        moving.connect()
        for _ in range(100):  # by hand, while nobody commands it
            fake.position = fake.position + np.radians(0.3) * np.eye(7)[0]
            time.sleep(0.01)
        with pytest.raises(MotionError, match=r"outer_yaw is \d+\.\d deg from its set point"):
            moving.follow(to(POSE + 0.1), 1.0)
    assert not fake.told
    assert not fake.holds  # it was never ours


@pytest.mark.parametrize(("speed", "most"), [(45.0, 8.0 + 4.5), (90.0, 8.0 + 9.0), (0.0, 8.0)])
def test_a_stuck_arm_is_not_pressed_far_and_is_let_go_of(
    fake: FakeArm, speed: float, most: float
) -> None:
    """A console's hold keeps the set point: it must be where the arm is by then, deg, deg/s."""
    from dvrk_gravity.ros import MotionError

    rate = np.radians(speed) * np.eye(7)[0]
    step = np.zeros(7) if speed else np.radians(9.0) * np.eye(7)[0]

    def path(t: float) -> tuple[np.ndarray, np.ndarray]:
        return POSE + rate * t + step * (t > 0.3), rate

    fake.follows = False
    with mover(fake) as moving:
        moving.connect()
        with pytest.raises(MotionError, match=r"outer_yaw is .* deg from its set point"):
            moving.follow(path, 2.0)
        assert fake.held()
    lead = np.degrees(np.array(fake.told)[:, 0] - POSE[0])
    assert lead.max() < most
    np.testing.assert_array_equal(fake.told[-1], POSE)


@pytest.mark.parametrize("topic", ["servo_cs", "servo_ci", "state_command"])
def test_a_command_that_cannot_be_read_here_is_noticed_by_who_may_give_it(
    fake: FakeArm, topic: str
) -> None:
    """The types of newer consoles' commands come with the dVRK's workspace."""
    from std_msgs.msg import String

    from dvrk_gravity.ros import MotionError

    node = fake.client.node
    node.create_publisher(String, topic, 10)
    with (
        mover(fake) as moving,
        pytest.raises(
            MotionError, match=rf"\({PRIVATE}/fake_arm\) may command {PRIVATE}/{topic}, whose"
        ),
    ):
        moving.connect()
    assert not fake.told


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("silent", f"no valid measured_js for {TIMEOUT:g} s"),
        ("stopped", rf"no valid measured_js for {TIMEOUT:g} s \(stamp_backwards: "),
        (
            "frozen",
            rf"has not advanced for {TIMEOUT:g} s; if this computer is busy, raise --timeout",
        ),
        ("stuck", "deg from its set point"),
        ("invalid", rf"no valid measured_js for {TIMEOUT:g} s \(not_finite: position of "),
        ("rival", rf"another node \({PRIVATE}/fake_arm\) commands {PRIVATE}/servo_jf"),
    ],
)
def test_what_goes_wrong_on_the_way_holds_the_arm(fake: FakeArm, name: str, says: str) -> None:
    from dvrk_gravity.ros import MotionError

    with mover(fake) as moving:
        moving.connect()
        fault(fake, name)
        with pytest.raises(MotionError, match=f"{says}.*; sent hold"):
            moving.follow(to(POSE + 0.3, 2.0), 2.0)
        assert fake.held()
    assert fake.told[-1][0] < POSE[0] + 0.29


def test_an_arm_that_measures_in_another_order_is_told_in_that_order(fake: FakeArm) -> None:
    """A console takes positions by index, whatever names stand beside them."""
    fake.order = [2, 1, 0, 3, 4, 5, 6]
    fake.follows = False
    with mover(fake) as moving:
        np.testing.assert_allclose(moving.connect(), POSE)
        moving.follow(to(POSE + 0.02), 0.2)
        np.testing.assert_allclose(fake.told[0], POSE[fake.order], atol=1e-3)


def test_joints_beside_the_arm_s_are_no_arm_to_be_told_by_index(fake: FakeArm) -> None:
    from dvrk_gravity.ros import MotionError

    def speak() -> None:
        message = fake.message(name=["wheel", *JOINT_NAMES], position=[0.0, *fake.position])
        message.header.stamp = fake.stamp()
        fake.measured.publish(message)

    fake.speak_timer.cancel()
    fake.client.node.create_timer(0.01, speak)
    with mover(fake) as moving, pytest.raises(MotionError, match="joints that mtmr lacks, wheel"):
        moving.connect()
    assert not fake.told


def test_after_a_long_sleep_the_arm_is_held_and_sent_nowhere(fake: FakeArm) -> None:
    """Ctrl-Z, and somebody else moves it meanwhile."""
    from dvrk_gravity.ros import MotionError

    slept: list[int] = []

    def path(t: float) -> tuple[np.ndarray, np.ndarray]:
        if t > 0.3 and not slept:
            time.sleep(ASLEEP + 0.2)
            slept.append(len(fake.told))
            fake.position = POSE + np.radians(40.0)
            fake.follows = False
            time.sleep(0.3)
        return POSE + 0.05 * t, np.full(7, 0.05)

    with mover(fake) as moving:
        moving.connect()
        says = r"was suspended for|is .* from its set point|broken encoder"
        with pytest.raises(MotionError, match=says):
            moving.follow(path, 2.0)
        assert fake.held()
    assert len(fake.told) <= slept[0] + 1
    assert np.abs(np.array(fake.told) - POSE).max() < 0.05


def test_one_joint_that_is_blocked_is_let_go_of_while_another_is_fast(fake: FakeArm) -> None:
    from dvrk_gravity.ros import MotionError

    rate = np.radians([0.0, 0.0, 0.0, 0.0, 0.0, 30.0, 170.0])

    def follow(message) -> None:
        fake.told.append(np.array(message.position))
        fake.position = np.where(np.arange(7) == 5, POSE, fake.told[-1])

    fake.on_servo_jp = follow
    with mover(fake) as moving:
        moving.connect()
        with pytest.raises(MotionError, match=r"wrist_yaw is .* from its set point"):
            moving.follow(lambda t: (POSE + rate * t, rate), 2.0)
        assert fake.held()
    assert fake.told[-1][5] == POSE[5]
    assert abs(fake.told[-1][6] - fake.told[-2][6]) < np.radians(8.0)


def test_whoever_frees_the_arm_finds_it_free(fake: FakeArm) -> None:
    from std_msgs.msg import Empty

    from dvrk_gravity.ros import MotionError

    other = fake.client.node.create_publisher(Empty, "free", 10)

    def free() -> None:
        timer.cancel()
        other.publish(Empty())

    with mover(fake) as moving:
        moving.connect()
        timer = fake.client.node.create_timer(0.3, free)
        with pytest.raises(MotionError, match=rf"commands {PRIVATE}/free"):
            moving.follow(to(POSE + 0.2, 2.0), 2.0)
        time.sleep(0.2)
    assert not fake.holds


def test_a_disk_that_is_full_holds_the_arm(fake: FakeArm) -> None:
    count = []

    def record(data: bytes) -> None:
        count.append(data)
        if len(count) > 30:
            raise OSError(28, "No space left on device")

    with mover(fake) as moving:
        moving.connect()
        with pytest.raises(OSError, match="No space left"):
            moving.follow(to(POSE + 0.1, 2.0), 2.0, record)
        assert fake.held()
    assert fake.told[-1][0] < POSE[0] + 0.09


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGHUP, signal.SIGTSTP, signal.SIGRTMIN])
def test_whatever_signal_asks_for_the_end_the_arm_is_held(
    fake: FakeArm, number: signal.Signals
) -> None:
    with mover(fake) as moving:
        moving.connect()
        fault(fake, number.name)
        with pytest.raises(KeyboardInterrupt):
            moving.follow(to(POSE + 0.1, 2.0), 2.0)
    assert fake.held()
    assert fake.told[-1][0] < POSE[0] + 0.09


def test_the_other_hand_s_arm_is_refused(fake: FakeArm) -> None:
    from dvrk_gravity.ros import MotionError

    fake.position[3] = np.radians(-170.0)  # a left arm reaches it, a right one does not
    with (
        mover(fake) as moving,
        pytest.raises(MotionError, match="wrist_platform is at -170 deg, 75 deg outside"),
    ):
        moving.connect()


def test_without_an_arm_the_error_says_what_is_missing(fake: FakeArm) -> None:
    from dvrk_gravity.ros import MotionError

    fake.speaks = False
    with (
        mover(fake) as moving,
        pytest.raises(
            MotionError, match=rf"{PRIVATE}/measured_js: no arm within 0.5 s: nothing publishes it"
        ),
    ):
        moving.connect(0.5)


@pytest.mark.parametrize("simulated", [False, True])
def test_old_stamps_are_those_of_a_bag_unless_our_simulator_measures(
    fake: FakeArm, simulated: bool
) -> None:
    """A simulator on a busy machine skips time, and lags by more the longer it runs."""
    from sensor_msgs.msg import JointState

    from dvrk_gravity.ros import MotionError

    fake.stamp = lambda: fake.time(nanoseconds=time.time_ns() - 21_000_000_000).to_msg()
    if simulated:
        fake.client.node.create_subscription(JointState, "simulator/push_jf", print, 10)
    with mover(fake) as moving:
        if simulated:
            np.testing.assert_array_equal(moving.connect(), POSE)
        else:
            with pytest.raises(MotionError, match=r"no arm within 1 s: stamp_too_old: stamp 21\."):
                moving.connect(1.0)


def test_the_simulator_is_driven_recorded_and_held(
    domain: int,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pytest.importorskip("rclpy")
    from dvrk_gravity.ros import NodeProcess

    out = tmp_path / "bag"
    monkeypatch.setattr("dvrk_gravity.cli.collect.PAUSED", -1.0)  # as if it had been kept waiting
    start = covering_motion(PlanLimits.of(Arm.load("mtmr")), 8.0, 4).middle
    where = f"initial_position:={start.tolist()}"
    words = ["--arm", "mtmr", "--out", str(out), "--duration", "8", "--seed", "4"]
    words += ["--namespace", PRIVATE, "--no-rehearsal", "--timeout", "1"]
    # A machine that stands still holds the arm, rightly: begin anew, as a person would. It spoils
    # one of three, not each.
    for attempt in range(3):
        with NodeProcess("simulator", "-p", "rate:=200.0", "-p", where) as simulator:
            status = run("dvrk_gravity.cli.excite", words)
        said, error = capsys.readouterr()
        if status == 0:
            break
        assert attempt < 2, (error, simulator.output)
        assert "sent hold" in error
        stood_still = "no valid measured_js for" in error or "was suspended for" in error
        assert stood_still or "behind real time: skipped" in simulator.output, error
        shutil.rmtree(f"{out}.unfinished")
    assert "Next: identify" in said
    assert "s longer than its 8 s" in said
    recording = Recording.load(out)
    assert recording.time is not None
    # A pause of this machine's is no part of the motion, which goes on from where it was.
    assert recording.time[-1] > 7.5
    assert recording.rate == pytest.approx(200.0)
    np.testing.assert_allclose(recording.position[0], start, atol=0.03)
    assert (np.ptp(recording.position, axis=0) > 0.05).all()


# That SIGHUP interrupts and holds is tested on the mover, above; the status in test_command_line.
@pytest.mark.parametrize(
    "way", [pytest.param("closed terminal", marks=pytest.mark.slow), "closed pipe"]
)
def test_however_the_process_is_ended_the_arm_is_held(
    domain: int, tmp_path: Path, way: str
) -> None:
    """SIGHUP, and a `| head -1` that reads no more, when the next part is announced."""
    pytest.importorskip("rclpy")
    from sensor_msgs.msg import JointState
    from std_msgs.msg import Empty

    from dvrk_gravity.ros import Client, NodeProcess

    begin = covering_motion(PlanLimits.of(Arm.load("mtmr")), 8.0, 1).middle + 0.01
    words = ["--arm", "mtmr", "--out", str(tmp_path / "bag"), "--duration", "8", "--timeout", "1"]
    words += ["--namespace", PRIVATE]
    told: list[float] = []
    holds: list[float] = []
    with (
        NodeProcess("simulator", "-p", "rate:=200.0", "-p", f"initial_position:={begin.tolist()}"),
        Client(name="listener") as client,
    ):
        node = client.node
        node.create_subscription(JointState, "servo_jp", lambda _: told.append(time.time()), 100)
        node.create_subscription(Empty, "hold", lambda _: holds.append(time.time()), 10)
        process = subprocess.Popen(
            [sys.executable, "-m", "dvrk_gravity", "excite", *words],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        output = process.stdout
        assert output is not None
        while not output.readline().startswith("approach"):  # after what so short a motion lacks
            assert process.poll() is None
        if way == "closed pipe":
            output.close()
        client.wait(lambda: len(told) > 20, "commands")
        if way == "closed terminal":
            process.send_signal(signal.SIGHUP)
        client.wait(lambda: process.poll() is not None, "its end")
        client.spin(0.2)
        output.close()
    assert process.returncode == (130 if way == "closed terminal" else 141)
    assert holds
    assert holds[-1] > told[-1]
