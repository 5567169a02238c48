"""The arm's side of the compensator's topics, as a test has it."""

from __future__ import annotations

import time

import numpy as np
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Empty

from dvrk_gravity.arms import JOINT_NAMES
from dvrk_gravity.ros import Client

# Silence after which nodes give up, s: as long as they allow. The arm is a thread of the tests, or
# they themselves: a busy machine stalls it for tenths of a second.
TIMEOUT = 1.0
ALONE, AWAITING = ("-p", "await_watchdog:=0.0"), ("-p", "await_watchdog:=4.0")
PATIENT = ("-p", f"timeout:={TIMEOUT}", "-p", "input_depth:=100", *ALONE)


def stamp_of(message) -> int:
    """Return a message's stamp in ns."""
    return message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec


class FakeArm:
    """Publishes measured_js as a test wants it and collects what comes back."""

    def __init__(self) -> None:
        self.client = Client()
        self.names = list(JOINT_NAMES)
        self.position = [0.1, 0.2, 0.1, 0.3, 1.0, 0.1, 0.2]
        self.velocity = [0.0] * 7
        self.effort: list[float] = [0.0] * 7
        self.stamp = 0  # of the last message
        self.shift = 0  # of its clock against this computer's, ns
        self.sent = 0
        self.commands: list[tuple[float, JointState]] = []
        self.holds: list[float] = []
        self.switches: list[bool] = []
        node = self.client.node
        self.measured = node.create_publisher(JointState, "measured_js", 100)
        self.builtin = node.create_publisher(JointState, "gravity_compensation/setpoint_js", 100)
        node.create_subscription(
            JointState,
            "servo_jf",
            lambda message: self.commands.append((time.monotonic(), message)),
            1000,
        )
        self.listen_to_hold()
        node.create_subscription(
            Bool,
            "use_gravity_compensation",
            lambda message: self.switches.append(message.data),
            100,
        )
        for name in ("compensator", "watchdog"):
            self.client.watch_state(name)

    def listen_to_hold(self) -> None:
        """Subscribe to ``hold``, as every arm does."""
        self._hold = self.client.node.create_subscription(
            Empty, "hold", lambda _: self.holds.append(time.monotonic()), 100
        )

    def takes_array(self, joints: list[str]) -> list:
        """Take arrays of efforts, as a controller of ros2_control that lists these joints.

        Returns what it receives from now on.
        """
        from rclpy.qos import QoSProfile, ReliabilityPolicy
        from std_msgs.msg import Float64MultiArray

        received: list[Float64MultiArray] = []
        profile = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.client.node.declare_parameter("joints", joints)
        self.client.node.create_subscription(
            Float64MultiArray, "commands", received.append, profile
        )
        return received

    def turn_deaf(self) -> None:
        """Listen to ``hold`` no longer."""
        self.client.node.destroy_subscription(self._hold)

    def __enter__(self) -> FakeArm:
        self.client.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self.client.__exit__(*error)

    def await_compensator(self, output: str = "servo_jf") -> None:
        """Wait until the node is up and every topic is connected."""
        node = self.client.node
        self.client.wait(
            lambda: (
                bool(self.client.state("compensator"))
                and self.client.connected(self.measured, self.builtin)
                and node.count_publishers(output) > 0
                and node.count_publishers("hold") > 0
            ),
            "the compensator",
        )

    def message(self, **fields: object) -> object:
        """Return a measured_js of now, some of its fields replaced."""
        self.stamp = time.time_ns() + self.shift
        values: dict[str, object] = {
            "name": self.names,
            "position": self.position,
            "velocity": self.velocity,
            "effort": self.effort,
            "stamp": self.stamp,
        } | fields
        stamp = values.pop("stamp")
        assert isinstance(stamp, int)
        message = JointState(**values)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 1_000_000_000)
        return message

    def send(self, **fields: object) -> None:
        """Publish one measured_js."""
        self.measured.publish(self.message(**fields))
        self.sent += 1

    def run(self, duration: float, rate: float = 200.0, **fields: object) -> None:
        """Publish measured_js for a while."""
        end = time.monotonic() + duration
        while (now := time.monotonic()) < end:
            self.send(**fields)
            self.client.spin(max(0.0, min(1.0 / rate - (time.monotonic() - now), end - now)))

    def run_until(self, condition, what: str, timeout: float = 15.0, **fields: object) -> None:
        """Publish measured_js until a condition holds."""
        end = time.monotonic() + timeout
        while not condition():
            assert time.monotonic() < end, f"waited in vain for {what}; state: {self.state}"
            self.run(0.005, **fields)

    def go(self, position) -> None:
        """Publish measured_js on the way to a position, as fast as a joint may move."""
        way = np.array(position) - self.position
        steps = int(np.ceil(np.abs(way).max() / 0.05))
        start = np.array(self.position)
        for part in np.arange(1, steps + 1) / max(steps, 1):
            self.position = (start + part * way).tolist()
            self.run(0.005)

    def answer(self, **fields: object) -> np.ndarray | None:
        """Publish one measured_js; return the effort that answers it, ``None`` if none comes.

        A good message follows it: once that is answered, this one was passed over.
        """
        # A reader may not yet know a writer that knows it: what is sent then is lost.
        self.run_until(lambda: len(self.commands) > 0, "a first command")
        message = self.message(**fields)
        stamp = stamp_of(message)
        self.measured.publish(message)
        self.send()
        self.client.wait(lambda: self.stamp in self.answers, "an answer to a good message", 15.0)
        return self.answers.get(stamp)

    @property
    def answers(self) -> dict[int, np.ndarray]:
        """Efforts received so far, by stamp."""
        return {stamp_of(message): np.array(message.effort) for _, message in self.commands[-50:]}

    @property
    def efforts(self) -> np.ndarray:
        """(N, 7) efforts received so far."""
        return np.array([message.effort for _, message in self.commands])

    @property
    def state(self) -> str:
        """What the compensator last said."""
        return self.client.state("compensator")
