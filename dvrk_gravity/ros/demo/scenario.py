"""What the demonstration does to the simulated arm, and what it measures."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Empty

from dvrk_gravity.processes import NodeProcess, ProcessError
from dvrk_gravity.recording import BagWriter
from dvrk_gravity.ros.client import Client

Array = NDArray[np.float64]

# Within the range on which the arm of the example model was calibrated.
POSES = np.radians(
    [
        [0.0, 0.0, 0.0, 0.0, 90.0, 0.0, 0.0],
        [-10.0, 20.0, -15.0, 40.0, 60.0, 20.0, 30.0],
        [-20.0, 10.0, 20.0, -50.0, 120.0, -25.0, -60.0],
    ]
)
FALL = 3.0  # s without compensation
FLOAT = 10.0  # s with it, at each pose
PUSH = 0.5  # s of a hand's push
COAST = 1.5  # s until it has come to rest
REST = 3.0  # s of watching afterwards
# A light hand, N·m.
PUSH_EFFORT = (0.07, 0.06, 0.08, 0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Phase:
    """One part of the demonstration.

    Attributes:
        title: What happens.
        time: (N,) s since its start.
        position: (N, n) measured joint positions, rad.
    """

    title: str
    time: Array
    position: Array

    @property
    def drift(self) -> Array:
        """(n,) largest distance from where each joint was at the start, deg."""
        return np.degrees(np.abs(self.position - self.position[0]).max(axis=0))


@dataclass(frozen=True, eq=False)
class Kill:
    """What happened after the compensator was killed.

    Attributes:
        hold_after: Time from the kill to the watchdog's hold, s.
        after: The time after it.
    """

    hold_after: float
    after: Phase


class Scenario:
    """Runs the parts one after the other (context manager); needs a ROS domain of its own."""

    def __init__(
        self, model: Path, joints: Sequence[str], bag: Path, friction_scale: float
    ) -> None:
        """Store the arguments, names of the model's joints among them; ``with`` starts all."""
        self._model, self._bag = model, bag
        self._joints = tuple(joints)
        self._friction_scale = friction_scale
        self._stack = ExitStack()
        self._positions: list[tuple[float, list[float]]] = []
        self._holds: list[float] = []

    def __enter__(self) -> Scenario:
        """Start the processes and wait until all are connected."""
        with ExitStack() as stack:
            self._writer = stack.enter_context(BagWriter(self._bag))
            self._client = stack.enter_context(Client())
            parameters = {"rate": 200.0, "friction_scale": self._friction_scale}
            self._simulator = stack.enter_context(NodeProcess("simulator", *_arguments(parameters)))
            self._watchdog = stack.enter_context(NodeProcess("watchdog"))
            self._compensator = stack.enter_context(
                NodeProcess(
                    "compensator",
                    "--params-file",
                    str(self._model),
                    *_arguments({"enabled": "false", "ramp_time": 0.5}),
                )
            )
            self._connect()
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *error: Any) -> None:
        """End the processes and close the bag."""
        self._stack.__exit__(*error)

    def _connect(self) -> None:
        node = self._client.node

        def record(topic: str, message_type: Any, then: Callable[[bytes], None]) -> None:
            name = f"{message_type.__module__.split('.')[0]}/msg/{message_type.__name__}"

            def receive(data: bytes) -> None:
                self._writer.write(f"/MTMR/{topic}", name, data, time.time_ns())
                then(data)

            node.create_subscription(message_type, topic, receive, 100, raw=True)

        record("measured_js", JointState, self._on_measured)
        record("servo_jf", JointState, lambda _: None)
        record("hold", Empty, lambda _: self._holds.append(time.monotonic()))
        for name in ("compensator", "watchdog"):
            self._client.watch_state(name)
        self._move = node.create_publisher(JointState, "move_jp", 1)
        self._free = node.create_publisher(Empty, "free", 1)
        self._builtin = node.create_publisher(Bool, "use_gravity_compensation", 1)
        self._push = node.create_publisher(JointState, "simulator/push_jf", 1)
        self._client.wait(
            lambda: (
                bool(self._positions)
                and bool(self._client.state("watchdog"))
                and bool(self._client.state("compensator"))
                and self._client.connected(self._move, self._free, self._builtin, self._push)
            ),
            "the simulator, the watchdog and the compensator",
        )

    def _on_measured(self, data: bytes) -> None:
        message = deserialize_message(data, JointState)
        self._positions.append((time.monotonic(), list(message.position)))

    def fall(self) -> Phase:
        """Without any compensation: the arm is let go of at the first pose."""
        self._builtin.publish(Bool(data=False))
        self._go_to(POSES[0])
        self._free.publish(Empty())
        return self._watch("let go without compensation", FALL)

    def floats(self) -> Iterator[Phase]:
        """With compensation, at one pose after the other."""
        for number, pose in enumerate(POSES, start=1):
            self._go_to(pose)
            self._start()
            yield self._watch(f"floating at pose {number}", FLOAT)
            self._client.enable(False)

    def push(self) -> tuple[Phase, Phase]:
        """A hand pushes the floating arm and lets go: the motion, and the rest after it."""
        self._go_to(POSES[0])
        self._start()
        hand = JointState(name=self._joints, effort=PUSH_EFFORT)
        mark, start = len(self._positions), time.monotonic()
        self._watch("pushed", PUSH, lambda: self._push.publish(hand))
        self._client.spin(COAST)
        pushed = self._phase("pushed by hand", mark, start)
        return pushed, self._watch("left alone again", REST)

    def kill(self) -> Kill:
        """The compensator is killed while it commands: the watchdog holds the arm."""
        holds = len(self._holds)
        killed = time.monotonic()
        self._compensator.process.kill()
        self._client.wait(lambda: len(self._holds) > holds, "the watchdog's hold")
        after = self._holds[-1] - killed
        return Kill(after, self._watch("after the compensator was killed", REST))

    def _start(self) -> None:
        self._client.enable(True)
        self._client.wait(
            lambda: self._client.state("compensator").startswith("commanding"), "commanding"
        )

    def _go_to(self, pose: Array) -> None:
        """Move there; asked again while the arm stands still elsewhere.

        A hold on its way to the arm may overtake a move, and cancels it then.
        """
        tolerance, still = np.radians(2.0), np.radians(0.2)

        def recent() -> Array:
            return np.array([position for _, position in self._positions[-40:]])

        def arrived() -> bool:
            return bool((np.abs(recent() - pose) < tolerance).all())

        for _ in range(10):
            self._move.publish(JointState(name=self._joints, position=pose))
            self._client.spin(0.5)
            self._client.wait(
                lambda: bool((np.ptp(recent(), axis=0) < still).all()), "the arm to stand still"
            )
            if arrived():
                return
        raise ProcessError("the arm does not reach its pose")

    def _watch(self, title: str, duration: float, act: Callable[[], None] | None = None) -> Phase:
        mark, start = len(self._positions), time.monotonic()
        while (left := start + duration - time.monotonic()) > 0.0:
            if act is not None:
                act()
            self._client.spin(min(left, 0.02))
        return self._phase(title, mark, start)

    def _phase(self, title: str, mark: int, start: float) -> Phase:
        """Return what was measured since there were ``mark`` samples."""
        when = np.array([stamp for stamp, _ in self._positions[mark:]])
        position = np.array([values for _, values in self._positions[mark:]])
        return Phase(title, when - start, position.reshape(-1, len(self._joints)))


def _arguments(parameters: dict[str, Any]) -> Sequence[str]:
    return [word for name, value in parameters.items() for word in ("-p", f"{name}:={value}")]
