"""An arm of ros2_control, moved by goals: a stand-in for its action server, in this process.

The messages of the action (control_msgs) are no wheel; where they are missing, their stand-ins have
the same fields.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from arm_side import TIMEOUT
from test_collect import plan_of
from test_excite import POSE, FakeArm, fake

from dvrk_gravity.arms import JOINT_NAMES, Arm
from dvrk_gravity.command_line import run
from dvrk_gravity.compensate import MotionError
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.planning import PlanLimits, Straight

__all__ = ["fake"]  # a fixture

ACTION = "/joint_trajectory_controller/follow_joint_trajectory"


class Future:
    """Done from a moment on."""

    def __init__(self, result: Any, after: float = 0.0) -> None:
        self._result, self.at = result, time.monotonic() + after

    def done(self) -> bool:
        return time.monotonic() >= self.at

    def result(self) -> Any:
        return self._result


class Controller:
    """Follows a goal from its acceptance on."""

    def __init__(self, arm: FakeArm) -> None:
        self.arm, self.goals, self.cancelled, self.accepts = arm, [], 0, True
        self.ready = True
        self.answers_after = 0.0  # s
        self.refusal = 0  # to cancel: CancelGoal's return code
        self.lasts = 1.0  # part of a goal after which it ends, successfully
        self.end = Future(SimpleNamespace(result=SimpleNamespace(error_code=0, error_string="")))
        self.speak = arm.speak
        arm.speak_timer.cancel()
        arm.client.node.create_timer(0.01, self.step)
        self.began = None

    def __call__(self, node: Any, kind: Any, name: str) -> Controller:
        assert name == ACTION
        return self

    def server_is_ready(self) -> bool:
        return self.ready

    def send_goal_async(self, goal: Any) -> Future:
        points = goal.trajectory.points
        self.goals.append(goal.trajectory)
        self.times = [p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec for p in points]
        self.way = np.array([p.positions for p in points])
        self.began = time.monotonic()
        self.end = Future(self.end.result(), self.lasts * self.times[-1] + 0.05)
        return Future(SimpleNamespace(
            accepted=self.accepts, get_result_async=lambda: self.end,
            cancel_goal_async=self.cancel_goal_async,
        ), self.answers_after)  # fmt: skip

    def cancel_goal_async(self) -> Future:
        self.cancelled += 1
        if not self.refusal:
            self.began = None
        return Future(SimpleNamespace(return_code=self.refusal))

    def step(self) -> None:
        if self.began is not None and self.arm.follows:
            now = time.monotonic() - self.began
            self.arm.position = np.array(
                [np.interp(now, self.times, joint) for joint in self.way.T]
            )
        self.speak()


@pytest.fixture
def controller(fake: FakeArm, monkeypatch: pytest.MonkeyPatch) -> Controller:
    from dvrk_gravity.ros import trajectory_mover

    made = Controller(fake)
    action = SimpleNamespace(Goal=SimpleNamespace, Result=SimpleNamespace(SUCCESSFUL=0))
    monkeypatch.setattr(trajectory_mover, "FollowJointTrajectory", action)
    monkeypatch.setattr(trajectory_mover, "ActionClient", made)
    return made


@contextlib.contextmanager
def moved() -> Iterator[tuple[Any, Straight]]:
    from dvrk_gravity.ros import Client, TrajectoryMover

    arm = Arm.load("mtmr")
    path = Straight.within(POSE, POSE + 0.3, PlanLimits.of(arm), 0.5)
    with (
        Client(name="collect") as client,
        TrajectoryMover(client, arm, ACTION, 200.0, TIMEOUT) as mover,
    ):
        yield mover, path


def test_a_path_is_one_goal_with_positions_velocities_and_accelerations(
    controller: Controller, fake: FakeArm
) -> None:
    recorded: list[bytes] = []
    with moved() as (mover, path):
        np.testing.assert_allclose(mover.connect(), POSE)
        mover.follow(path.at, path.duration, recorded.append)
    (goal,) = controller.goals
    assert tuple(goal.joint_names) == JOINT_NAMES
    for point, moment in zip(goal.points, controller.times, strict=True):
        q, qd, qdd = path.at(moment)
        np.testing.assert_allclose(point.positions, q)
        np.testing.assert_allclose(point.velocities, qd, atol=1e-9)
        np.testing.assert_allclose(point.accelerations[:7], qdd, atol=1e-6)
    assert set(goal.points[-1].velocities) == {0.0}
    assert np.diff([0.0, *controller.times]).max() <= 0.05 + 1e-9
    assert len(recorded) > 50
    np.testing.assert_allclose(fake.position, POSE + 0.3, atol=1e-3)
    assert not controller.cancelled  # it came to its end
    assert not fake.told


@pytest.mark.parametrize(
    ("what", "says"),
    [
        ("stuck", "from its set point"),
        ("silent", f"no valid measured_js for {TIMEOUT:g} s"),
        ("ended", "the controller has ended the motion: path tolerance"),
        ("watched", "a hand"),
    ],
)
def test_what_goes_wrong_cancels_the_goal(
    controller: Controller, fake: FakeArm, what: str, says: str
) -> None:
    def watch(sample: Any, moment: float) -> None:
        if what == "watched" and moment > 0.3:
            raise MotionError("a hand")

    def fail() -> None:
        timer.cancel()
        if what == "stuck":
            fake.follows = False
        elif what == "silent":
            fake.speaks = False
        elif what == "ended":
            result = SimpleNamespace(error_code=-4, error_string="path tolerance")
            controller.end.__init__(SimpleNamespace(result=result))  # type: ignore[misc]

    with moved() as (mover, path):
        mover.connect()
        timer = fake.client.node.create_timer(0.3, fail)
        with pytest.raises(
            MotionError, match=f"{says}.*; sent hold".replace("measured_js", r"\S+")
        ):
            mover.follow(path.at, path.duration, watch=watch)
    assert controller.cancelled == (what != "ended")


def test_a_goal_that_is_not_accepted_moves_nothing(controller: Controller) -> None:
    controller.accepts = False
    with moved() as (mover, path):
        mover.connect()
        with pytest.raises(MotionError, match="did not accept the trajectory"):
            mover.follow(path.at, path.duration)


def test_an_arm_without_the_controller_is_named_by_its_action(controller: Controller) -> None:
    controller.ready = False
    with moved() as (mover, _), pytest.raises(MotionError, match=f"serves the action {ACTION}"):
        mover.connect(1.0)


@pytest.mark.parametrize(
    ("after", "cancelled", "says"),
    [(1.5, 1, "sent hold"), (9.0, 0, "hold was not acknowledged: check that the arm holds")],
)
def test_a_goal_that_is_accepted_too_late_is_cancelled_then_or_the_user_warned(
    controller: Controller, monkeypatch: pytest.MonkeyPatch, after: float, cancelled: int, says: str
) -> None:
    from dvrk_gravity.ros import trajectory_mover

    monkeypatch.setattr(trajectory_mover, "PATIENCE", 1.0)
    controller.answers_after = after
    with moved() as (mover, path):
        mover.connect()
        with pytest.raises(MotionError, match=f"has not answered for 1 s.*; {says}"):
            mover.follow(path.at, path.duration)
    assert controller.cancelled == cancelled


@pytest.mark.parametrize(
    ("code", "says"), [(1, "hold was not acknowledged: check that the arm holds"), (3, "sent hold")]
)
def test_a_cancellation_that_is_refused_is_no_hold(
    controller: Controller, code: int, says: str
) -> None:
    def watch(sample: Any, moment: float) -> None:
        raise MotionError("a hand")

    controller.refusal = code
    with moved() as (mover, path):
        mover.connect()
        with pytest.raises(MotionError, match=f"a hand; {says}"):
            mover.follow(path.at, path.duration, watch=watch)
    assert controller.cancelled == 1


def test_a_goal_that_ends_early_as_if_it_had_succeeded_is_no_motion(controller: Controller) -> None:
    controller.lasts = 0.0
    controller.arm.follows = False  # by less than the following error: nothing else notices it
    with moved() as (mover, path):
        start = mover.connect()
        small = Straight(start, start + 0.05, path.duration)
        with pytest.raises(MotionError, match=r"has ended the motion [0-9.]+ s too early"):
            mover.follow(small.at, small.duration)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--action", "a b"], "--action: got 'a b', expected a ROS name"),
        (["--action", ""], "--action: got '', expected a ROS name"),
        (
            ["--action", ACTION, "--measured", "states!"],
            "--measured: got 'states!', expected a",
        ),
        (["--action", ACTION, "--namespace", "my arm"], "--namespace: got '/my arm', expected a"),
        (["--action", ACTION, "--namespace", "/MTML"], "got '/MTML', expected that of arm mtmr"),
    ],
)
def test_names_that_ros_does_not_accept_and_another_arm_s_are_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    words: list[str], says: str,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    plan_of("mtmr").save("plan.yaml")
    assert run("dvrk_gravity.cli.collect", ["plan.yaml", "--out", "bag", "--yes", *words]) == 2
    error = capsys.readouterr().err
    assert says in error
    assert error.count("\n") == 1


def test_without_its_messages_the_error_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from dvrk_gravity.ros import TrajectoryMover, trajectory_mover

    monkeypatch.setattr(trajectory_mover, "FollowJointTrajectory", None)
    nobody: Any = SimpleNamespace(node=None)
    with pytest.raises(ConfigError, match=r"--action: got .* expected control_msgs"):
        TrajectoryMover(nobody, Arm.load("mtmr"), ACTION, 200.0, TIMEOUT)
