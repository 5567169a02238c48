"""Send measured_js at a steady rate and time the servo_jf that answer: used by two benchmarks."""

from __future__ import annotations

import struct
import time
from array import array

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import JointState
from std_msgs.msg import Empty

from dvrk_gravity.arms import JOINT_NAMES, N_JOINTS
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.ros import Client

SWING = 0.1  # rad, at 1 rad/s
_STEPS = 1000  # of a swing, for which efforts are known
MIDDLE = np.array([-0.2, 0.2, -0.1, 0.8, 0.8, 0.0, 0.0])
_STAMP = struct.Struct("<iI")  # sec, nanosec: the first fields after the encapsulation


class RoundTrip:
    """The arm's side of one node under test.

    Attributes:
        sent: Send time of every message, monotonic s, by its stamp, ns.
        answered: Time of the answer by the stamp that it carries.
    """

    def __init__(self, client: Client, namespace: str, model: TorqueModel | None = None) -> None:
        """Connect to the topics in a namespace; the arm has the efforts of a model, or none."""
        node = client.node
        self._efforts = np.zeros((_STEPS, N_JOINTS))
        if model is not None:
            phase = 2.0 * np.pi / _STEPS * np.arange(_STEPS)[:, None] + np.arange(N_JOINTS)
            swing = SWING * np.sin(phase)
            self._efforts = model.torque(MIDDLE + swing, SWING * np.cos(phase), -swing)
        self.client = client
        self.sent: dict[int, float] = {}
        self.answered: dict[int, float] = {}
        self.publisher = node.create_publisher(JointState, f"{namespace}/measured_js", 100)
        # Raw: the stamp is all that is needed of an answer, and unpacking the rest takes time.
        node.create_subscription(
            JointState, f"{namespace}/servo_jf", self._on_answer, 1000, raw=True
        )
        # No compensator commands an arm that could not be held.
        node.create_subscription(Empty, f"{namespace}/hold", lambda _: None, 10)
        self._message = JointState(name=JOINT_NAMES)

    def _on_answer(self, data: bytes) -> None:
        now = time.monotonic()
        second, nanosecond = _STAMP.unpack_from(data, 4)
        self.answered[second * 1_000_000_000 + nanosecond] = now

    def connect(self, timeout: float = 20.0) -> None:
        """Send now and then until answers come."""

        def answering() -> bool:
            self.send()
            return len(self.answered) > 5

        self.client.wait(answering, "answers", timeout)
        self.client.spin(0.2)
        self.sent.clear()
        self.answered.clear()

    def send(self) -> None:
        """Send one message; the arm swings slowly within its limits."""
        now = time.monotonic()
        phase = now + np.arange(N_JOINTS)
        message = self._message
        message.position = array("d", (MIDDLE + SWING * np.sin(phase)).tobytes())
        message.velocity = array("d", (SWING * np.cos(phase)).tobytes())
        step = int(now / (2.0 * np.pi) * _STEPS) % _STEPS
        message.effort = array("d", self._efforts[step].tobytes())
        stamp = time.time_ns()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 1_000_000_000)
        self.sent[stamp] = time.monotonic()
        self.publisher.publish(message)

    def run(self, duration: float, rate: float = 1000.0) -> None:
        """Send at a steady rate for a while, then wait for the last answers.

        What could not be sent in time is left out rather than sent in a burst, which no arm does.
        """
        due = time.monotonic()
        end = due + duration
        while due < end:
            while (remaining := due - time.monotonic()) > 0.0:
                self.client.spin_once(remaining)
            self.send()
            due = max(due + 1.0 / rate, time.monotonic())
        self.client.spin(0.1)

    def take(self) -> tuple[NDArray[np.float64], int]:
        """Return the round-trip times so far, s, and how many had no answer; start anew."""
        times = [self.answered[stamp] - at for stamp, at in self.sent.items()
                 if stamp in self.answered]  # fmt: skip
        lost = len(self.sent) - len(times)
        self.sent.clear()
        self.answered.clear()
        return np.array(times), lost
