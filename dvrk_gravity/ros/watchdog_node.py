"""The watchdog: holds the arm when commands stop (a killed compensator, a crashed computer)."""

from __future__ import annotations

import time
from typing import Any

from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Empty, Float64, String

from dvrk_gravity.compensate import CommandWatch
from dvrk_gravity.model import BY_EFFECTS, all_parameters, arm_of
from dvrk_gravity.parameters import check_all
from dvrk_gravity.ros import runtime
from dvrk_gravity.ros.executor import PromptNode
from dvrk_gravity.ros.hold import Hold
from dvrk_gravity.ros.presence import HOLD, Presence
from dvrk_gravity.ros.wire import PARAMETERS, CommandTopic

TIMEOUT_TOPIC = "watchdog_timeout"
"""Latched: the watchdog's time-out, s, which a compensator's own must not exceed."""

OWN_PARAMETERS = ("watchdog_timeout", *PARAMETERS)

# s. A node checks every 0.1 s whether it is asked to end (runtime.py), and then holds at once; a
# busy machine may stand still for half a second.
_OUTLIVES = 0.6


class Watchdog(PromptNode):
    """Sends `hold` once commands have come and then stopped without one."""

    def __init__(self) -> None:
        """Read the parameters, connect the topics.

        Raises:
            ConfigError: A parameter that fails its check.
        """
        super().__init__("watchdog", automatically_declare_parameters_from_overrides=True)
        given = runtime.given_parameters(self)
        # A file for all nodes (`/**`) has the model's, too.
        table = all_parameters(arm_of(given))
        values = {name: table[name].default for name in OWN_PARAMETERS}
        values |= check_all(table, given, BY_EFFECTS)
        timeout = values["watchdog_timeout"]
        assert isinstance(timeout, float)  # check_all returns it so
        self._watch = CommandWatch(timeout)
        topic = CommandTopic.of(values)
        self._hold = Hold(self, Presence(self, any_subscriber=topic.as_array).listens)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._state = self.create_publisher(String, "~/state", latched)
        on_command: Any = self._on_command  # takes the message's information, too
        self.prompt = self.create_subscription(
            topic.message_type, topic.name, on_command, 1, raw=True
        )
        self.create_subscription(Empty, HOLD, self._on_hold, 10)
        self.create_publisher(Float64, TIMEOUT_TOPIC, latched).publish(Float64(data=timeout))
        self.create_timer(timeout / 4, self._on_watch, clock=runtime.STEADY_CLOCK)
        self._report(f"watching {topic.name}: hold after {timeout:g} s without a command")

    def _on_command(self, data: bytes, info: object) -> None:
        if self._watch.note_command(time.monotonic()):
            self._hold.drop()
            self._report("the arm is commanded")

    def _on_hold(self, _: Empty) -> None:
        if not self._hold.echo() and self._watch.note_hold():
            self._report("the arm holds: its commands ended with a hold")

    def _on_watch(self) -> None:
        self._hold.look()
        silence = self._watch.check(time.monotonic())
        if silence:
            self._hold.send()
            text = f"hold sent: no command for {silence:.3f} s and no hold before"
            self._state.publish(String(data=text))
            self.get_logger().error(
                f"{text}; to resume, call ~/enable of the compensator, or restart it"
            )

    def _report(self, text: str) -> None:
        self._state.publish(String(data=text))
        self.get_logger().info(text)

    def finish(self) -> bool:
        """Hold an arm that would be unwatched from now on; return whether that is acknowledged.

        A compensator that is asked to end at the same time holds it itself.
        """
        runtime.outlive(self, lambda: self._watch.commanded, _OUTLIVES)
        if self._watch.commanded:
            self._hold.send()
        return self._hold.settle()
