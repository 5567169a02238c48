"""Moves an arm of ros2_control along a path: one goal for its joint_trajectory_controller."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from builtin_interfaces.msg import Duration
from rclpy.action import ActionClient
from rclpy.node import Node
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from dvrk_gravity.arms import Arm
from dvrk_gravity.collecting import Path
from dvrk_gravity.compensate import MotionError, Sample, SampleReader
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.ros.client import Client
from dvrk_gravity.ros.mover import TIMEOUT, Mover
from dvrk_gravity.ros.presence import Presence
from dvrk_gravity.ros.wire import JointStateReader

try:
    from control_msgs.action import FollowJointTrajectory
except ImportError:
    FollowJointTrajectory = None

# Points of a goal are so far apart, s. With positions, velocities and accelerations the controller
# interpolates by quintics: of 0.6 Hz they are off by 1e-7 of the amplitude; positions alone it
# would connect by straight lines.
STEP = 0.05
# Answers to a goal, its end, and a cancellation take so long at most, s. Chosen.
PATIENCE = 2.0
# A goal that ends earlier than the motion by more has not moved the arm along it, s. Chosen: its
# last part is at rest, and measurements are up to 0.1 s old.
EARLY = 0.5
_REJECTED = 1  # action_msgs/srv/CancelGoal: ERROR_REJECTED; others mean that it has ended


class TrajectoryLink:
    """The link to an arm whose controller follows goals, with what :class:`Mover` needs of one.

    Attributes:
        presence: Who measures the arm.
        measured: In which order joints are measured does not matter: goals name theirs ...
        extra_joints: ... nor do joints that the arm does not have.
        hold: Cancels the goal, after which the controller holds its position.
        missing_connection: What is missing where the arm measures and has no controller.
    """

    def __init__(self, node: Node, arm: Arm, action: str) -> None:
        """Connect to a server of ``action``.

        Raises:
            ConfigError: control_msgs is not installed.
        """
        if FollowJointTrajectory is None:
            raise ConfigError(
                "--action", action, "control_msgs, which is not installed (ros-jazzy-control-msgs)"
            )
        self._action = ActionClient(node, FollowJointTrajectory, action)
        self._name, self._arm = action, arm
        self.missing_connection = f"no controller serves the action {action} (--action)"
        self.presence = Presence(node, any_subscriber=True)
        self.measured: tuple[str, ...] = ()
        self.extra_joints: tuple[str, ...] = ()
        self.hold = self
        self._unpack = JointStateReader().read
        self._read = SampleReader(arm).read
        self.listen: Callable[[], None] = lambda: None
        self._answer: Any = None  # future of the acceptance, while it is open
        self._goal: Any = None
        self._end: Any = None  # future of its result
        self._cancelled: Any = None  # future of a cancellation

    def is_connected(self) -> bool:
        """Return whether the arm measures, and its controller takes goals."""
        return self.presence.is_there() and bool(self._action.server_is_ready())

    def read(self, data: bytes) -> Sample:
        """Return the sample in the bytes of a message."""
        return self._read(*self._unpack(data))

    def publish(self, stamp: int, *values: Any) -> None:
        """Do nothing: the controller has its goal."""

    def commanded_by_others(self) -> bool:
        """Return False: a controller takes one goal at a time, and ends ours for another."""
        return False

    freed_by_others = commanded_by_others

    def begin(self, path: Path, duration: float) -> None:
        """Send a path, and return when it is accepted.

        Raises:
            MotionError: It is not.
        """
        goal = FollowJointTrajectory.Goal()
        goal.trajectory = trajectory(self._arm, path, duration)
        self._answer = self._action.send_goal_async(goal)
        if not self._wait(self._answer):
            raise MotionError(
                f"{self._name}: the controller has not answered for {PATIENCE:g} s: it may still "
                "take the trajectory"
            )
        answered, self._answer = self._answer.result(), None
        if not answered.accepted:
            raise MotionError(f"{self._name}: the controller did not accept the trajectory")
        self._goal = answered
        self._end = self._goal.get_result_async()

    def require_active_goal(self, left: float) -> None:
        """Raise MotionError if the goal has ended although so much of the motion is left, s."""
        if left > EARLY and self._end is not None and self._end.done():
            early = f"{self._name}: the controller has ended the motion {left:.1f} s too early"
            raise MotionError(self._failure() or early)

    def _failure(self) -> str:
        """Return why the controller has ended the goal, ``""``: it has not, or with success."""
        if self._end is None or not self._end.done():
            return ""
        result = self._end.result().result
        if result.error_code == FollowJointTrajectory.Result.SUCCESSFUL:
            return ""
        why = result.error_string or f"error {result.error_code}"
        return f"{self._name}: the controller has ended the motion: {why}"

    def finish(self) -> None:
        """Wait for the end of the goal.

        Raises:
            MotionError: The controller has not come to its end.
        """
        if not self._wait(self._end):
            raise MotionError(f"{self._name}: the controller does not come to the motion's end")
        if failure := self._failure():
            raise MotionError(failure)
        self._goal = self._end = None

    def look(self, active: bool, measuring: bool) -> dict[str, str]:
        """Return by cause why the arm must not be commanded; ``""``: it may."""
        another = self.presence.publisher_conflict() or self.presence.replaced_publisher(active)
        return {"goal": self._failure(), "measured_js": another}

    def send(self) -> None:
        """Cancel the goal: the controller then holds its position."""
        self._cancelled = None
        if self._goal is not None and not self._end.done():
            self._cancelled = self._goal.cancel_goal_async()
        self._goal = self._end = None

    def settle(self) -> bool:
        """Return whether the cancellation was obeyed, or none was needed.

        A goal of which nobody knows whether it was accepted is cancelled when it is.
        """
        if self._answer is not None:
            answered = self._wait(self._answer)
            if answered and self._answer.result().accepted:
                self._cancelled = self._answer.result().cancel_goal_async()
            self._answer = None
            if not answered:
                return False
        if self._cancelled is None:
            return True
        return self._wait(self._cancelled) and self._cancelled.result().return_code != _REJECTED

    def _wait(self, future: Any) -> bool:
        end = time.monotonic() + PATIENCE
        while not future.done() and time.monotonic() < end:
            self.listen()
        return bool(future.done())


class TrajectoryMover(Mover):
    """Moves an arm by FollowJointTrajectory, watched as :class:`Mover` watches its own set points.

    The controller goes on by itself where this process pauses, or ends: only a cancelled goal, or
    its end, stops the arm.
    """

    _link: Any

    def __init__(
        self, client: Client, arm: Arm, action: str, rate: float, timeout: float = TIMEOUT
    ) -> None:
        """Connect ``client``'s topics and an action's name; look ``rate`` times a second."""
        self._action_name = action
        super().__init__(client, arm, rate, timeout)
        self._link.listen = lambda: self._listen_until(time.monotonic() + 1.0 / rate)

    def _make_link(self, node: Node) -> Any:
        return TrajectoryLink(node, self._arm, self._action_name)

    def _begin(self, path: Path, duration: float) -> None:
        position, velocity, _ = path(0.0)
        self._command(position, velocity)  # refused where the arm is elsewhere
        self._link.begin(path, duration)
        self._duration = duration

    def _next_moment(self, moment: float, passed: float, of_arm: float) -> float:
        self._link.require_active_goal(self._duration - of_arm)
        return of_arm

    def _finish(self) -> None:
        self._link.finish()


def trajectory(arm: Arm, path: Path, duration: float) -> JointTrajectory:
    """Return a path as points with positions, velocities and accelerations, at rest in the end."""
    count = max(int(np.ceil(duration / STEP - 1e-9)), 1)
    times = duration * np.arange(1, count + 1) / count
    q, qd, qdd = path(times)
    qd[-1] = qdd[-1] = 0.0
    points = []
    for moment, *states in zip(times.tolist(), q, qd, qdd, strict=True):
        ns = round(moment * 1e9)
        point = JointTrajectoryPoint(time_from_start=Duration(sec=ns // 10**9, nanosec=ns % 10**9))
        point.positions, point.velocities, point.accelerations = (each.tolist() for each in states)
        points.append(point)
    return JointTrajectory(joint_names=list(arm.joint_names), points=points)
