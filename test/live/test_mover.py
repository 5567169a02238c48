"""An arm that is driven through ROS: along its path, and what stops it and holds it there."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from driven_arm import POSE, DrivenArm, hold_for, mover, to
from path_driver import plan_of
from std_msgs.msg import Empty, String

from dvrk_gravity.__main__ import main
from dvrk_gravity.compensate import MotionError
from dvrk_gravity.planning import Plan
from dvrk_gravity.recording import Recording
from dvrk_gravity.ros import PRIVATE, NodeProcess

pytestmark = pytest.mark.usefixtures("patience")


# --- driven --------------------------------------------------------------------------------


def test_the_arm_is_driven_along_the_path_and_held_in_the_end(driven: DrivenArm) -> None:
    recorded: list[bytes] = []
    with mover() as moving:
        np.testing.assert_array_equal(moving.connect(), POSE)
        moving.follow(to(POSE + 0.1), 1.0, recorded.append)
        assert not driven.holds
    assert driven.held()
    np.testing.assert_allclose(driven.told[0], POSE, atol=1e-3)
    np.testing.assert_allclose(driven.told[-2], POSE + 0.1)
    # Held where it was measured, the last readings of the end of the motion among them.
    np.testing.assert_allclose(driven.told[-1], POSE + 0.1, atol=1e-3)
    assert len(driven.told) > 50
    assert len(recorded) > 20


def test_the_motion_runs_by_the_arm_s_clock(driven: DrivenArm) -> None:
    """As of a simulator whose machine is too slow: its motion is no other, it takes longer."""
    driven.slow, came = 0.25, list[float]()
    follow = driven.on_servo_jp

    def on_servo_jp(message) -> None:
        came.append(driven.stamp)
        follow(message)

    driven.on_servo_jp = on_servo_jp
    with mover() as moving:
        moving.connect()
        moving.follow(lambda t: (POSE + 0.5 * t, np.full(7, 0.5)), 0.6)
    moments = (np.array(driven.told[:-1])[:, 0] - POSE[0]) / 0.5
    ahead = moments - (np.array(came[:-1]) - came[0])
    assert ahead.max() < 0.25  # by this computer's clock it would be 0.45


def test_after_a_pause_of_ours_the_arm_is_not_sent_after_the_motion(driven: DrivenArm) -> None:
    paused: list[float] = []

    def path(t: float) -> tuple[np.ndarray, np.ndarray]:
        if t > 0.5 and not paused:
            paused.append(t)
            time.sleep(0.2)
        return POSE + 0.5 * t, np.full(7, 0.5)

    with mover() as moving:
        moving.connect()
        longer = moving.follow(path, 1.0)
    assert paused
    assert longer > 0.1  # of the pause, by the arm's clock, but for what one step makes up for
    # 0.5 rad/s for the 20 ms that a step is at most; the last holds the arm where it was measured.
    assert np.abs(np.diff(driven.told[:-1], axis=0)).max() < 0.011


def test_an_arm_that_measures_in_another_order_is_told_in_that_order_until_it_changes(
    driven: DrivenArm,
) -> None:
    """A console takes positions by index, whatever names stand beside them."""
    driven.order, driven.follows = [2, 1, 0, 3, 4, 5, 6], False
    driven.soon(lambda: setattr(driven, "order", list(range(7))), after=0.5)
    with mover() as moving:
        np.testing.assert_allclose(moving.connect(), POSE)
        with pytest.raises(MotionError, match=": joints outer_yaw, "):
            moving.follow(to(POSE + 0.02, 5.0), 5.0)
        assert driven.held()
    assert all(np.abs(told - POSE[[2, 1, 0, 3, 4, 5, 6]]).max() < 0.03 for told in driven.told)


# --- not driven ----------------------------------------------------------------------------


def rival(arm: DrivenArm) -> None:
    arm.node.create_timer(0.1, arm.command_effort)


def unreadable(arm: DrivenArm) -> None:
    """The types of newer consoles' commands come with the dVRK's workspace."""
    arm.node.create_publisher(String, "servo_cs", 10)


def drifting(arm: DrivenArm) -> None:
    def drift() -> None:
        arm.position = arm.position + 2e-3 * np.eye(7)[1]

    arm.before_speaking = drift


def test_an_arm_that_must_not_be_moved_is_left_alone(domain: int) -> None:
    for fault, says in (
        (rival, f"commands {PRIVATE}/servo_jf"),
        (unreadable, rf"\({PRIVATE}/driven_arm\) may command {PRIVATE}/servo_cs"),
        (drifting, "shoulder_pitch moves by"),
        (lambda arm: setattr(arm, "further", ["wheel"]), "mtmr lacks, wheel"),
        (lambda arm: setattr(arm, "ahead", -21.0), "stamp_too_old"),
        (lambda arm: setattr(arm, "speaks", False), f"{PRIVATE}/measured_js: no arm"),
    ):
        with DrivenArm() as arm:
            fault(arm)
            with mover() as moving, pytest.raises(MotionError, match=says):
                moving.connect(1.0 if arm.ahead or not arm.speaks else 15.0)
            assert not arm.told, says
            assert not arm.holds, says  # it was never ours


# --- on the way ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("fault", "says"),
    [
        (lambda arm: setattr(arm, "speaks", False), "no valid measured_js for"),
        (DrivenArm.command_effort, f"commands {PRIVATE}/servo_jf"),
    ],
    ids=["silent", "rival"],
)
def test_what_goes_wrong_on_the_way_holds_the_arm(
    driven: DrivenArm, fault: Callable[[DrivenArm], None], says: str
) -> None:
    hold_for(driven, fault, says)


def test_after_a_long_sleep_the_arm_is_held_and_sent_nowhere(
    driven: DrivenArm, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl-Z, and somebody else moves it meanwhile."""
    monkeypatch.undo()
    slept: list[int] = []

    def path(t: float) -> tuple[np.ndarray, np.ndarray]:
        if t > 0.2 and not slept:
            slept.append(len(driven.told))
            driven.follows, driven.position = False, POSE + np.radians(40.0)
            time.sleep(1.0)
        return POSE + 0.05 * t, np.full(7, 0.05)

    with mover() as moving:
        moving.connect()
        with pytest.raises(MotionError, match=r"suspended|is .* from its set point|encoder"):
            moving.follow(path, 2.0)
        assert driven.held()
    assert len(driven.told) <= slept[0] + 2
    assert np.abs(np.array(driven.told) - POSE).max() < 0.05


def test_whoever_frees_the_arm_finds_it_free(driven: DrivenArm) -> None:
    other = driven.node.create_publisher(Empty, "free", 10)
    driven.soon(lambda: other.publish(Empty()))
    with mover() as moving:
        moving.connect()
        with pytest.raises(MotionError, match=f"commands {PRIVATE}/free"):
            moving.follow(to(POSE + 0.2, 5.0), 5.0)
    driven.wait_for(lambda: driven.holds > 0, 0.5)
    assert not driven.holds


def test_whatever_signal_asks_for_the_end_the_arm_is_held(domain: int) -> None:
    for number in (signal.SIGINT, signal.SIGTSTP):
        with DrivenArm() as arm:
            arm.soon(lambda number=number: os.kill(os.getpid(), number))
            with mover() as moving:
                moving.connect()
                with pytest.raises(KeyboardInterrupt):
                    moving.follow(to(POSE + 0.1, 5.0), 5.0)
            assert arm.held(), number
            assert arm.told[-1][0] < POSE[0] + 0.09


# --- processes -----------------------------------------------------------------------------


@pytest.fixture
def plan(tmp_path: Path) -> Plan:
    """Return a slow motion, also as a file."""
    made = plan_of("mtmr", duration=2.4, size=0.3)
    made.save(tmp_path / "plan.yaml")
    return made


def words(folder: Path) -> list[str]:
    return ["collect", str(folder / "plan.yaml"), "--out", str(folder / "bag"), "--yes",
            "--no-rehearsal", "--timeout", "1", "--namespace", PRIVATE]  # fmt: skip


def test_the_simulator_is_driven_and_recorded(domain: int, tmp_path: Path, plan: Plan) -> None:
    where = f"initial_position:={plan.at(0.0)[0].tolist()}"
    with NodeProcess("simulator", "-p", "rate:=200.0", "-p", where):
        # Where this machine stands still the arm is held, rightly: go on, as a person would.
        ways = [main([*words(tmp_path), "--resume"])]
        while ways[-1] and len(ways) < 5:
            ways.append(main([*words(tmp_path), "--resume"]))
    assert ways[-1] == 0
    recording = Recording.load(tmp_path / "bag")
    assert recording.rate == pytest.approx(200.0)
    path = plan.at(np.linspace(0.0, plan.duration, 101))[0]
    away = np.abs(recording.position[:, None] - path[None]).max(axis=2)
    assert away.min(axis=0).max() < np.radians(3.0)  # every point of the motion was recorded
