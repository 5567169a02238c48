"""The simulator: topics and time around a simulated arm."""

from __future__ import annotations

import itertools
import math
import time
from array import array
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Empty, String

from dvrk_gravity.errors import ConfigError, DvrkGravityError
from dvrk_gravity.files import json_file
from dvrk_gravity.model import ARM_PARAMETER, TorqueModel, all_parameters, arm_of
from dvrk_gravity.parameters import Parameter, flatten
from dvrk_gravity.ros import runtime
from dvrk_gravity.ros.joint_order_queries import JOINTS
from dvrk_gravity.ros.wire import PARAMETERS, CommandTopic
from dvrk_gravity.simulate import PlantFile, SimulatedArm, initial_position

STEP = 1e-3
"""Length of a simulation step, s."""

# While a node commands it, it outlives a request to end by so long, s: twice a compensator's wait
# for an acknowledgement (ros/hold.py), and less than the 5 s after which launch insists.
_OUTLIVES = 3.0

# Further behind than this, the simulation skips time instead of catching up, s.
_MOST_BEHIND = 0.05

SIMULATOR_PARAMETERS: dict[str, Parameter] = {
    entry.name: entry
    for entry in (
        Parameter(
            "plant", "", "",
            "plant: a name, a plant's or model's .yaml file, or a .urdf; default: that of `arm`",
        ),
        Parameter("rate", 1000.0, "Hz", "measured_js", lower=1.0, upper=1000.0),
        Parameter(
            "setpoint_rate", 100.0, "Hz", "setpoint_js and gravity_compensation/setpoint_js",
            lower=1.0, upper=1000.0,
        ),
        Parameter("friction_scale", 1.0, "", "factor on all friction", lower=0.0, upper=100.0),
        Parameter(
            "initial_position", (), "rad or m",
            "initial position, in hold; default: zero, or the nearest within the limits",
        ),
        Parameter("seed", 0.0, "", "seed of the sensors' noise", lower=0.0, upper=2.0**53),
        Parameter("sensor_noise", True, "", "false: perfect sensors"),
        Parameter(
            "builtin_gravity_compensation", True, "",
            "built-in compensation initially on, as on a real console",
        ),
        Parameter(
            "push_timeout", 0.1, "s", "a push ends after this long without simulator/push_jf",
            lower=0.002, upper=60.0,
        ),
        Parameter(
            "realtime_factor", 1.0, "",
            "simulated seconds per second; stamps and rates count simulated ones",
            lower=0.01, upper=20.0,
        ),
    )
}  # fmt: skip


class Simulator(Node):
    """Moves the arm in real time on the console's topics.

    Stamps count simulated time from the start of the node, and every message is sent, also late
    ones of a busy machine: a recording shows the arm's motion, whatever the machine did meanwhile.
    Where the machine is too slow altogether, time is skipped: the log says how much, and the stamps
    lag the clock by that.
    """

    def __init__(self) -> None:
        """Read the parameters, build the arm, connect the topics.

        Raises:
            ConfigError: A parameter that is unknown or fails its check, or an unusable plant.
        """
        super().__init__("simulator", automatically_declare_parameters_from_overrides=True)
        given = runtime.given_parameters(self)
        # A file for all nodes (`/**`) has the compensator's parameters, too.
        arm = arm_of(given)
        others = all_parameters(arm)
        own_values = {name: value for name, value in given.items() if name not in others}
        efforts = CommandTopic.of(
            {name: others[name].check(given.get(name, others[name].default)) for name in PARAMETERS}
        )
        value = runtime.declare_constants(self, SIMULATOR_PARAMETERS, own_values)

        truth = PlantFile.load(value["plant"]) if value["plant"] else PlantFile.of(arm)
        self._truth, self._friction_scale = truth, value["friction_scale"]
        simulated = truth.model.arm
        if ARM_PARAMETER.name in given and simulated.joint_names != arm.joint_names:
            raise ConfigError(
                "plant", value["plant"], f"one with the joints of {arm.name}, as `arm` says"
            )
        plant = truth.plant(value["friction_scale"])
        begin = value["initial_position"] or initial_position(simulated)
        if len(begin) != simulated.n:
            raise ConfigError("initial_position", begin, f"{simulated.n} positions, rad or m")
        plant.reset(begin)
        sensors, builtin = value["sensor_noise"], value["builtin_gravity_compensation"]
        self._arm = SimulatedArm(
            plant, truth.sensors if sensors else None, int(value["seed"]), builtin, STEP
        )
        self._names = simulated.joint_names
        self.declare_parameter(  # as ros2_control's controllers
            JOINTS, list(self._names), ParameterDescriptor(read_only=True)
        )
        self._as_read = simulated.reading_of_torque  # efforts in A, where the arm reads A
        self._push_timeout = value["push_timeout"] * value["realtime_factor"]
        self._steps_per_second = value["realtime_factor"] / STEP
        self._origin = time.monotonic()
        self._first_stamp = self.get_clock().now()
        self._steps = 0
        self._connect(value["rate"], value["setpoint_rate"], efforts)
        self.get_logger().info(
            f"simulating {simulated.name} ({truth.source}), in hold; built-in gravity compensation "
            f"{'on' if builtin else 'off'}"
        )

    def finish(self) -> bool:
        """Go on until no node commands the arm, and stop the clock.

        A compensator that is asked to end at the same time waits for the arm to acknowledge a hold:
        the arm ends last.
        """
        runtime.outlive(self, self._is_commanded, _OUTLIVES)
        self._timer.cancel()
        return True

    def _is_commanded(self) -> bool:
        """Return whether a node publishes commands, or could hold the arm."""
        return any(self.count_publishers(topic) for topic in self._commands)

    def _connect(self, rate: float, setpoint_rate: float, efforts: CommandTopic) -> None:
        def publisher(topic: str) -> Any:
            return self.create_publisher(JointState, topic, QoSProfile(depth=100))

        self._measured = publisher("measured_js")
        self._setpoint = publisher("setpoint_js")
        self._compensation = publisher("gravity_compensation/setpoint_js")
        self._measured_due = _due(rate)
        self._setpoint_due = _due(setpoint_rate)
        arm = self._arm
        self._commands = (efforts.name, "servo_jp", "move_jp", "hold")
        commands: list[tuple[Any, str, Callable[[Any], None]]] = [
            (efforts.message_type, efforts.name,
             lambda message: arm.servo_jf(efforts.effort(message), as_read=True)),
            (JointState, "servo_jp", lambda message: arm.servo_jp(message.position)),
            (Empty, "hold", lambda _: arm.hold()),
            (Bool, "use_gravity_compensation",
             lambda message: arm.use_gravity_compensation(message.data)),
            (JointState, "simulator/push_jf",
             lambda message: arm.push(message.effort, self._push_timeout)),
            (String, "simulator/change", self._on_change),
        ]  # fmt: skip
        for prefix in ("", "simulator/"):  # the latter for the demonstration: no real arm has these
            commands += [
                (JointState, f"{prefix}move_jp", lambda message: arm.move_jp(message.position)),
                (Empty, f"{prefix}free", lambda _: arm.free()),
            ]
        for command in commands:
            self._listen(*command)
        self._timer = runtime.every(self, STEP, self._on_timer)

    def _listen(self, message_type: Any, topic: str, command: Callable[[Any], None]) -> None:
        """Subscribe; commands that the arm refuses are logged and change nothing."""

        def receive(message: Any) -> None:
            try:
                command(message)
            except DvrkGravityError as error:
                self.get_logger().error(f"{topic} ignored: {error}", throttle_duration_sec=1.0)

        self.create_subscription(message_type, topic, receive, 1)

    def _on_change(self, message: String) -> None:
        """Change parameters of the plant's model while it moves: a load that is fastened, say."""
        model = self._truth.model
        changed = model.parameters() | flatten(json_file.loads(message.data))
        self._truth = replace(self._truth, model=TorqueModel.from_parameters(changed, model.arm))
        self._arm.replace_plant(self._truth.plant(self._friction_scale))
        self.get_logger().info(f"the arm has changed: {message.data}")

    def _on_timer(self) -> None:
        elapsed = time.monotonic() - self._origin
        due = int(elapsed * self._steps_per_second) - self._steps
        most = math.ceil(_MOST_BEHIND * self._steps_per_second)
        if due > most:
            late = (due - most) / self._steps_per_second
            self._origin += late
            due = most
            self.get_logger().warning(
                f"behind real time: skipped {late * 1e3:.0f} ms",
                throttle_duration_sec=1.0,
            )
        for _ in range(due):
            if not self._arm.step():
                self.get_logger().error(
                    "the pushed arm diverged beyond the range of numbers: it holds"
                )
            self._steps += 1
            self._publish()

    def _publish(self) -> None:
        arm = self._arm
        if next(self._measured_due):
            sample = arm.measure()
            self._send(self._measured, sample.position, sample.velocity, sample.effort)
        if next(self._setpoint_due):
            none = np.empty(0)
            target = none if arm.target is None else arm.target
            self._send(self._setpoint, target, none, arm.commanded)
            self._send(self._compensation, none, none, arm.compensation)

    def _send(self, publisher: Any, position: Any, velocity: Any, effort: Any) -> None:
        message = JointState(
            name=self._names,
            # rclpy takes array('d') unchecked; of a list or numpy array it checks every entry.
            position=array("d", position.tobytes()),
            velocity=array("d", velocity.tobytes()),
            effort=array("d", self._as_read(effort).tobytes()),
        )
        elapsed = Duration(nanoseconds=round(self._steps * STEP * 1e9))
        message.header.stamp = (self._first_stamp + elapsed).to_msg()
        publisher.publish(message)


def _due(rate: float) -> Iterator[bool]:
    """Yield, once a step, whether something at a fixed rate, Hz, is due."""
    count, period = 0, 1.0 / rate
    for step in itertools.count(1):
        due = step * STEP >= count * period - 0.5 * STEP  # half a step early rather than late
        count += due
        yield due
