"""An arm of ros2_control, moved by goals: a stand-in for its action server, in this process.

The messages of the action (control_msgs) are no wheel; where they are missing, their stand-ins have
the same fields.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from arm_side import TIMEOUT
from driven_arm import POSE, DrivenArm

from dvrk_gravity.arms import Arm
from dvrk_gravity.compensate import MotionError
from dvrk_gravity.planning import PlanLimits, Straight

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

    def __init__(self, arm: DrivenArm) -> None:
        self.arm, self.goals, self.cancelled = arm, [], 0
        self.ready = self.accepts = True
        self.refusal = 0  # to cancel: CancelGoal's return code
        self.lasts = 1.0  # part of a goal after which it ends, successfully
        self.result = SimpleNamespace(result=SimpleNamespace(error_code=0, error_string=""))
        self.began = None
        arm.before_speaking = self.step

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
        self.end = Future(self.result, self.lasts * self.times[-1] + 0.05)
        return Future(SimpleNamespace(
            accepted=self.accepts, get_result_async=lambda: self.end,
            cancel_goal_async=self.cancel_goal_async,
        ))  # fmt: skip

    def cancel_goal_async(self) -> Future:
        self.cancelled += 1
        if not self.refusal:
            self.began = None
        return Future(SimpleNamespace(return_code=self.refusal))

    def abort(self) -> None:
        self.end.__init__(  # type: ignore[misc]
            SimpleNamespace(result=SimpleNamespace(error_code=-4, error_string="path tolerance"))
        )

    def step(self) -> None:
        if self.began is not None and self.arm.follows:
            now = time.monotonic() - self.began
            self.arm.position = np.array(
                [np.interp(now, self.times, joint) for joint in self.way.T]
            )


@contextmanager
def controlled() -> Iterator[tuple[DrivenArm, Controller, Any]]:
    """Yield an arm, its controller, and what moves it through that."""
    from dvrk_gravity.ros import Client, TrajectoryMover, trajectory_mover

    action = SimpleNamespace(Goal=SimpleNamespace, Result=SimpleNamespace(SUCCESSFUL=0))
    with DrivenArm() as arm, pytest.MonkeyPatch.context() as patch:
        controller = Controller(arm)
        patch.setattr(trajectory_mover, "FollowJointTrajectory", action)
        patch.setattr(trajectory_mover, "ActionClient", controller)
        with (
            Client(name="collect") as client,
            TrajectoryMover(client, Arm.load("mtmr"), ACTION, 200.0, TIMEOUT) as mover,
        ):
            yield arm, controller, mover


WAY = Straight.within(POSE, POSE + 0.3, PlanLimits.of(Arm.load("mtmr")), 0.5)


def go_wrong(what: str, says: str) -> bool:
    """Have a motion go wrong, whose error says so; return whether its goal was cancelled."""
    with controlled() as (arm, controller, mover):
        _go_wrong(arm, controller, mover, what, says)
        return bool(controller.cancelled)


def _go_wrong(arm: DrivenArm, controller: Controller, mover: Any, what: str, says: str) -> None:
    controller.ready, controller.accepts = what != "not there", what != "not accepted"
    controller.refusal = int(what == "refuses to cancel")
    way, faults = WAY, {"stuck": lambda: setattr(arm, "follows", False), "ended": controller.abort}
    if what == "early":  # by less than the following error: nothing else notices it
        controller.lasts, arm.follows, way = 0.0, False, Straight(POSE, POSE + 0.05, 2.0)
    if what == "not there":
        with pytest.raises(MotionError, match=says):
            mover.connect(1.0)
        return

    def watch(sample: Any, moment: float) -> None:
        if moment > 0.3:
            if what in ("watched", "refuses to cancel"):
                raise MotionError("a hand")
            faults.pop(what, lambda: None)()

    mover.connect()
    with pytest.raises(MotionError, match=says):
        mover.follow(way.at, way.duration, watch=watch)
