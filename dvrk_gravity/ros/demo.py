"""The demonstration: an arm falls, floats, is pushed, is held, and gets a load that is named.

Simulator, compensator, watchdog and monitor run as separate processes.
"""

from __future__ import annotations

import itertools
import json
import math
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Empty, String

from dvrk_gravity.arrays import Array
from dvrk_gravity.recording import BagWriter
from dvrk_gravity.ros.client import Client
from dvrk_gravity.ros.processes import NodeProcess, ProcessError
from dvrk_gravity.ros.stage import Stage, demo_load, identify_demo_model
from dvrk_gravity.ros.wire import CommandTopic

Result = TypeVar("Result")

_AT_MOST = 60.0  # s, until a monitor has begun
_LOST = 6.0  # s, after which a motion that has not arrived is given up

MONITORED = "monitor_model.yaml"
"""In the demonstration's folder: the model that the monitor has."""


@dataclass(frozen=True)
class Schedule:
    """Duration of each part, s. Chosen: long enough to see what happens.

    Attributes:
        fall: Without compensation.
        floating: With it, at each pose.
        push: A hand pushes.
        coast: Until the arm has come to rest.
        rest: Of watching afterwards.
        usual: Of motion without the load, after the monitor has learned what is usual.
        named: The longest that the monitor is waited for to name the load.
        attempts: Number of attempts at a part in which the compensator stops, for instance where
            the machine is suspended for longer than its time-out.
    """

    fall: float = 3.0
    floating: float = 10.0
    push: float = 0.5
    coast: float = 2.5
    rest: float = 3.0
    attempts: int = 5
    usual: float = 1.0
    named: float = 20.0


@dataclass(frozen=True, eq=False)
class Phase:
    """One part of the demonstration.

    Attributes:
        title: Its name.
        time: (N,) s since its start.
        position: (N, n) measured joint positions, rad or m.
    """

    title: str
    time: Array
    position: Array

    @property
    def drift(self) -> Array:
        """(n,) largest distance of each joint from its start, rad or m."""
        way: Array = np.abs(self.position - self.position[0]).max(axis=0)
        return way


@dataclass(frozen=True, eq=False)
class Kill:
    """The hold after the compensator was killed.

    Attributes:
        hold_after: Time from the kill to the watchdog's hold, s.
        after: The motion afterwards.
    """

    hold_after: float
    after: Phase


@dataclass(frozen=True, eq=False)
class MonitorRecord:
    """What a monitor published of an arm that got a load.

    Attributes:
        time: (N,) s since the monitor began.
        measured: (N, n) low-passed torque, N·m or N.
        expected: (N, n) of the model, likewise.
        deviation: (N, n) standard deviation expected of their difference; NaN: not yet known.
        fastened: When the load was fastened, s.
        mass: Of the load, kg.
        link: That it was fastened to.
        events: What the monitor said, and when, s.
    """

    time: Array
    measured: Array
    expected: Array
    deviation: Array
    fastened: float
    mass: float
    link: str
    events: tuple[tuple[float, str], ...]


class Scenario:
    """Runs the parts one after the other (context manager), in a private ROS domain.

    A bag records measurements and commands.

    Attributes:
        simulator: The arm's process, once started.
        interruptions: Why the compensator stopped in a part, which was then repeated.
    """

    def __init__(
        self,
        stage: Stage,
        bag: Path,
        friction_scale: float = 1.0,
        output: str = "servo_jf",
        schedule: Schedule | None = None,
    ) -> None:
        self._stage, self._bag = stage, bag
        self._schedule = schedule or Schedule()
        self._friction_scale, self._output = friction_scale, output
        self.simulator: NodeProcess | None = None
        self._positions: list[tuple[float, list[float]]] = []
        self._clock = 0.0  # s, stamp of the last measurement
        self._holds: list[float] = []
        self.interruptions: list[str] = []

    def __enter__(self) -> Scenario:
        stage, output = self._stage, {"output": self._output}
        with ExitStack() as stack:
            self._writer = stack.enter_context(BagWriter(self._bag))
            # Before there are nodes: it computes for ten seconds, which they would wait for.
            self._monitored = identify_demo_model(
                stage.arm.source or stage.arm.name, stage.plant, self._friction_scale,
                self._bag.with_name(MONITORED),
            )  # fmt: skip
            self._client = stack.enter_context(Client(stage.namespace))
            simulated = {"rate": 200.0, "friction_scale": self._friction_scale, **output}
            plant = {"plant": stage.plant} if stage.plant else {"arm": stage.arm.source}
            self._processes = stack.enter_context(ExitStack())
            self.simulator = self._begin("simulator", None, simulated | plant)
            self._begin("watchdog", stage.model, output)
            self._begin_compensator()
            self._connect()
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *error: Any) -> None:
        self._stack.__exit__(*error)

    def _begin(self, verb: str, model: Path | None, parameters: dict[str, Any]) -> NodeProcess:
        of_model = () if model is None else ("--params-file", str(model))
        process = NodeProcess(
            verb, *of_model, namespace=self._stage.namespace, parameters=parameters
        )
        return self._processes.enter_context(process)

    def _begin_compensator(self) -> None:
        # The simulated arm's clock lags by all the time that a slow machine has skipped.
        given = {
            "enabled": "false", "ramp_time": 0.5, "max_stamp_age": 0.0, "output": self._output,
        }  # fmt: skip
        self._compensator = self._begin("compensator", self._stage.model, given)

    def _connect(self) -> None:
        node = self._client.node

        def record(topic: str, message_type: Any, then: Callable[[bytes], None]) -> None:
            name = f"{message_type.__module__.split('.')[0]}/msg/{message_type.__name__}"
            full = node.resolve_topic_name(topic)

            def receive(data: bytes) -> None:
                self._writer.write(full, name, data, time.time_ns())
                then(data)

            node.create_subscription(message_type, topic, receive, 100, raw=True)

        command = CommandTopic.of({"output": self._output, "output_topic": ""})
        record("measured_js", JointState, self._on_measured)
        record(command.name, command.message_type, lambda _: None)
        record("hold", Empty, lambda _: self._holds.append(time.monotonic()))
        for name in ("compensator", "watchdog"):
            self._client.watch_state(name)
        self._move = node.create_publisher(JointState, "simulator/move_jp", 1)
        self._free = node.create_publisher(Empty, "simulator/free", 1)
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
        self._clock = _seconds(message)
        self._positions.append((time.monotonic(), list(message.position)))

    def fall(self) -> Phase:
        """Release the arm at the first pose, without any compensation."""
        self._builtin.publish(Bool(data=False))
        self._go_to(self._stage.poses[0])
        self._free.publish(Empty())
        return self._watch("released without compensation", self._schedule.fall)

    def floats(self) -> Iterator[Phase]:
        """Release the arm with compensation, at one pose after the other."""
        for number, pose in enumerate(self._stage.poses, start=1):
            title = f"floating at pose {number}"
            yield self._act_under_compensation(
                pose, partial(self._watch, title, self._schedule.floating)
            )
            self._client.enable(False)

    def push(self) -> tuple[Phase, Phase]:
        """Push the floating arm and release it: return the motion, and the rest after it."""
        hand = JointState(name=self._stage.arm.joint_names, effort=self._stage.push)

        def act() -> tuple[Phase, Phase]:
            mark, start = len(self._positions), time.monotonic()
            self._watch("pushed", self._schedule.push, lambda: self._push.publish(hand))
            self._client.spin(self._schedule.coast)
            pushed = self._phase("pushed by hand", mark, start)
            return pushed, self._watch("left alone again", self._schedule.rest)

        return self._act_under_compensation(self._stage.poses[0], act)

    def kill(self) -> Kill:
        """Kill the compensator while it commands: the watchdog holds the arm."""
        for _ in range(self._schedule.attempts):
            if not self._commands():
                self._go_to(self._stage.poses[0])
                if not self._starts():
                    continue
            count = len(self._client.states["watchdog"])
            killed = time.monotonic()
            self._compensator.process.kill()
            self._client.wait(partial(self._was_stopped, count, killed), "the watchdog's hold")
            after = self._hold_time(count, killed)
            if self._commands() and after is not None:
                title = "after the compensator was killed"
                return Kill(after - killed, self._watch(title, self._schedule.rest))
            self._interrupted()  # a fault ended its commands, with a hold, just before the kill
            before = len(self._client.states["compensator"])
            self._begin_compensator()
            self._client.wait(partial(self._says_more, before), "another compensator")
        raise self._failed()

    def begin_monitor(self) -> None:
        """Start the monitor, and listen to it."""
        self._heard: dict[str, list[tuple[float, list[float]]]] = {}
        self._monitor_events: list[dict[str, Any]] = []
        node = self._client.node
        for name in ("expected_js", "external_js", "external_js_std"):
            heard = self._heard.setdefault(name, [])
            node.create_subscription(
                JointState, f"monitor/{name}", partial(_note_torque, heard), 100
            )
        node.create_subscription(String, "monitor/events", self._on_event, 100)
        self._begin("monitor", self._monitored, {})

    def _on_event(self, message: Any) -> None:
        self._monitor_events.append(json.loads(message.data))

    def fasten(self) -> MonitorRecord:
        """Move the arm, fasten a load to it, and wait for the monitor to name that."""
        schedule = self._schedule
        load = demo_load(self._stage.arm, self._stage.monitor_poses)
        change = self._client.node.create_publisher(String, "simulator/change", 1)
        ways = self._moving()
        self._while_moving(ways, lambda: bool(self._heard["external_js_std"]), _AT_MOST)
        if not self._heard["external_js_std"]:
            raise ProcessError("the monitor did not begin")
        self._while_moving(ways, lambda: False, schedule.usual)
        change.publish(String(data=json.dumps({"payload": load})))
        fastened = self._clock
        self._while_moving(ways, lambda: self._has_named_change(fastened), schedule.named)
        self._while_moving(ways, lambda: False, 1.0)
        return self._monitor_record(load, fastened)

    def _moving(self) -> Iterator[None]:
        """Move from one pose to the next, without end; yield as often as it is asked to go on."""
        arm, tolerance = self._stage.arm, np.radians(2.0) * self._stage.arm.scale
        for goal in itertools.cycle(self._stage.monitor_poses):
            self._move.publish(JointState(name=arm.joint_names, position=goal))
            begun = self._clock
            while (np.abs(self._positions[-1][1] - goal) > tolerance).any():
                if self._clock > begun + _LOST:  # a hold on its way has cancelled it
                    break
                yield

    def _while_moving(
        self, ways: Iterator[None], ended: Callable[[], bool], longest: float
    ) -> None:
        """Move on until something holds, at most some seconds of the arm's clock."""
        end = self._clock + longest
        while not ended() and self._clock < end:
            next(ways)
            self._client.spin(0.01)

    def _has_named_change(self, since: float) -> bool:
        """Return whether the monitor has named a change since a time of the arm's clock, s."""
        return any(
            event["kind"] != "push" and event["reported"] > since for event in self._monitor_events
        )

    def _monitor_record(self, load: dict[str, Any], fastened: float) -> MonitorRecord:
        expected, external = (dict(self._heard[name]) for name in ("expected_js", "external_js"))
        spread = dict(self._heard["external_js_std"])
        stamps = sorted(expected.keys() & external.keys())
        unknown = [math.nan] * self._stage.arm.n
        torque = np.array([expected[stamp] for stamp in stamps])
        outside = np.array([external[stamp] for stamp in stamps])
        events = (
            (event["reported"] - stamps[0], event["sentence"]) for event in self._monitor_events
        )
        return MonitorRecord(
            np.array(stamps) - stamps[0], torque - outside, torque,
            np.array([spread.get(stamp, unknown) for stamp in stamps]), fastened - stamps[0],
            load["mass"], load["link"], tuple(events),
        )  # fmt: skip

    def _act_under_compensation(self, pose: Array, act: Callable[[], Result]) -> Result:
        """Act on the arm under compensation from a pose on; again if compensation stopped."""
        for _ in range(self._schedule.attempts):
            self._go_to(pose)
            if self._starts():
                result = act()
                if self._commands():
                    return result
                self._interrupted()
        raise self._failed()

    def _starts(self) -> bool:
        """Start the compensator; return whether it commands in the end."""
        self._client.enable(True)
        self._client.spin(0.1)  # its last state may be an old one
        self._client.wait(lambda: self._commands() or self._is("fault"), "commanding")
        if self._is("fault"):
            self._interrupted()
        return not self._is("fault")

    def _is(self, state: str) -> bool:
        return self._client.state("compensator").startswith(state)

    def _commands(self) -> bool:
        return self._is("commanding")

    def _says_more(self, than: int) -> bool:
        return len(self._client.states["compensator"]) > than

    def _was_stopped(self, count: int, since: float) -> bool:
        """Return whether the compensator stopped or its watchdog has held the arm."""
        return not self._commands() or self._hold_time(count, since) is not None

    def _hold_time(self, count: int, since: float) -> float | None:
        """Return the time of a hold since a monotonic time, s, if the watchdog reported one.

        Args:
            count: Number of the watchdog's reports by then.
            since: Monotonic time, s.
        """
        reports = self._client.states["watchdog"][count:]
        if not any(text.startswith("hold sent") for text in reports):
            return None
        return next((stamp for stamp in self._holds if stamp > since), None)

    def _interrupted(self) -> None:
        self.interruptions.append(self._client.state("compensator"))

    def _failed(self) -> ProcessError:
        return ProcessError(
            f"the compensator stopped in {self._schedule.attempts} attempts, the last time with "
            f"`{self._client.state('compensator')}`"
        )

    def _go_to(self, pose: Array) -> None:
        """Move to a pose; repeat that if the arm stops elsewhere.

        A hold in transit may overtake a move, and cancels it then.
        """
        scale = self._stage.arm.scale
        tolerance, still = np.radians(2.0) * scale, np.radians(0.2) * scale

        def recent() -> Array:
            return np.array([position for _, position in self._positions[-40:]])

        def arrived() -> bool:
            return bool((np.abs(recent() - pose) < tolerance).all())

        for _ in range(10):
            self._move.publish(JointState(name=self._stage.arm.joint_names, position=pose))
            self._client.spin(0.5)
            self._client.wait(
                lambda: bool((np.ptp(recent(), axis=0) < still).all()), "the arm to stand still"
            )
            if arrived():
                return
        raise ProcessError("the arm did not reach its pose")

    def _watch(self, title: str, duration: float, act: Callable[[], None] | None = None) -> Phase:
        mark, start = len(self._positions), time.monotonic()
        while (remaining := start + duration - time.monotonic()) > 0.0:
            if act is not None:
                act()
            self._client.spin(min(remaining, 0.02))
        # A suspended machine has measured nothing yet.
        self._client.wait(lambda: len(self._positions) > mark, "the arm's measured positions")
        return self._phase(title, mark, start)

    def _phase(self, title: str, mark: int, start: float) -> Phase:
        """Return the motion since sample ``mark``."""
        when = np.array([stamp for stamp, _ in self._positions[mark:]])
        position = np.array([values for _, values in self._positions[mark:]])
        return Phase(title, when - start, position.reshape(-1, self._stage.arm.n))


def _note_torque(heard: list[tuple[float, list[float]]], message: JointState) -> None:
    heard.append((_seconds(message), list(message.effort)))


def _seconds(message: JointState) -> float:
    return float(message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec)
