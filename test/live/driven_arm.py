"""An arm that goes where it is told, at once, and what moves it, as live tests have them."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import pytest
from arm_side import TIMEOUT
from rclpy.time import Time
from sensor_msgs.msg import JointState
from std_msgs.msg import Empty

from dvrk_gravity.arms import JOINT_NAMES, Arm
from dvrk_gravity.compensate import MotionError
from dvrk_gravity.planning import Move, careful_limits
from dvrk_gravity.ros import Client, Mover

POSE = np.array([0.0, 0.2, 0.1, 0.0, 1.5, 0.0, 0.0])


class DrivenArm:
    """Measures where it was commanded to; its node spins in a thread.

    It measures its joints in an ``order``, after ``further`` ones, with the stamps of a clock that
    is ``ahead`` by some s and ``slow`` by a factor.
    """

    def __init__(self) -> None:
        self.client = Client(name="driven_arm")
        self.node = self.client.node
        self.position = POSE.copy()
        self.follows, self.speaks = True, True
        self.order, self.further = list(range(7)), list[str]()
        self.slow, self.ahead = 1.0, 0.0
        self.told: list[np.ndarray] = []
        self.holds, self.stamp = 0, 0.0
        self.effort = [0.0] * 7
        self._origin = time.time_ns()
        self.measured = self.node.create_publisher(JointState, "measured_js", 100)
        self.servo_jf = self.node.create_publisher(JointState, "servo_jf", 10)
        self._servo_jp = self.node.create_subscription(
            JointState, "servo_jp", lambda message: self.on_servo_jp(message), 100
        )
        self.node.create_subscription(Empty, "hold", self._on_hold, 10)
        self.before_speaking: Callable[[], None] = lambda: None
        self.node.create_timer(0.01, self._speak)

    def on_servo_jp(self, message) -> None:
        """Go to a set point."""
        self.told.append(np.array(message.position))
        if self.follows:
            self.position = self.told[-1]

    def command_effort(self) -> None:
        """Command the arm's efforts, as another node would."""
        self.servo_jf.publish(JointState(effort=[0.0] * 7))

    def message_of(self, position: np.ndarray, ahead: float = 0.0):
        """Return a measured_js of a position, its stamp ahead by some s."""
        names = self.further + [JOINT_NAMES[i] for i in self.order]
        values = [0.0] * len(self.further) + position[self.order].tolist()
        message = JointState(name=names, position=values)
        message.effort = [0.0] * len(self.further) + list(self.effort)
        passed = round((time.time_ns() - self._origin) * self.slow)
        stamp = self._origin + passed + round(1e9 * (self.ahead + ahead))
        message.header.stamp = Time(nanoseconds=stamp).to_msg()
        self.stamp = 1e-9 * (stamp - self._origin)
        return message

    def _on_hold(self, _) -> None:
        self.holds += 1

    def _speak(self) -> None:
        """Measure, where all commands lead that have arrived, however late this thread is."""
        while taken := self._servo_jp.handle.take_message(JointState, False):
            self.on_servo_jp(taken[0])
        self.before_speaking()
        if self.speaks:
            self.measured.publish(self.message_of(self.position))

    def soon(self, change: Callable[[], None], after: float = 0.3) -> None:
        """Call ``change`` once, in the arm's own thread, when a motion is under way."""

        def once() -> None:
            if self.told:
                timer.cancel()
                change()

        timer = self.node.create_timer(after, once)

    def measure_elsewhere(self) -> None:
        """Let somebody else measure an arm that stands elsewhere."""
        other = self.node.create_publisher(JointState, "measured_js", 100)
        away = POSE + np.radians(30.0)
        self.node.create_timer(0.013, lambda: other.publish(self.message_of(away, 0.03)))

    def __enter__(self) -> DrivenArm:
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._spin)
        self._thread.start()
        return self

    def _spin(self) -> None:
        while not self._ends.is_set():
            self.client.spin_once()

    def __exit__(self, *_: object) -> None:
        self._ends.set()
        self._thread.join()
        self.client.__exit__()

    def wait_for(self, condition: Callable[[], bool], timeout: float = 15.0) -> bool:
        """Return whether a condition comes to hold."""
        end = time.monotonic() + timeout
        while not condition() and time.monotonic() < end:
            self._ends.wait(0.01)
        return condition()

    def held(self) -> bool:
        """Return whether it comes to be held."""
        return self.wait_for(lambda: self.holds > 0)


@contextmanager
def mover() -> Iterator:
    """Yield what moves it."""
    with Client(name="excite") as client, Mover(client, Arm.load("mtmr"), 200.0, TIMEOUT) as moving:
        yield moving


def to(goal: np.ndarray, duration: float = 1.0):
    """Return a way from POSE to a goal in some s."""
    move = Move(POSE, goal, *careful_limits(Arm.load("mtmr")))
    return lambda time: move.at(time * move.duration / duration)


def hold_for(arm: DrivenArm, fault: Callable[[DrivenArm], None], says: str) -> None:
    """Require that a motion on whose way a fault happens ends in a hold, and says so."""
    arm.soon(lambda: fault(arm))
    with mover() as moving:
        moving.connect()
        with pytest.raises(MotionError, match=rf"{says}.*; sent hold"):
            moving.follow(to(POSE + 0.1, 5.0), 5.0)
        assert arm.held()
    told = np.array(arm.told)
    assert (np.abs(told - POSE).max(axis=1) < 0.1).all()
    assert np.abs(np.diff(told, axis=0)).max() < np.radians(2.0)
