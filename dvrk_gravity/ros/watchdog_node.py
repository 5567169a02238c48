"""The watchdog: holds the arm when commands stop (a killed compensator, a crashed computer)."""

from __future__ import annotations

import time
from dataclasses import replace

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import NodeNameNonExistentError
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Empty, Float64, String

from dvrk_gravity.compensate import CommandWatch, WatchdogStatus, unseen_commands
from dvrk_gravity.model import BY_EFFECTS, all_parameters, arm_of
from dvrk_gravity.parameters import check_all
from dvrk_gravity.ros import runtime
from dvrk_gravity.ros.diagnostics import status_message
from dvrk_gravity.ros.executor import PromptNode, subscribe_raw
from dvrk_gravity.ros.foreign_commands import Endpoints, node_names
from dvrk_gravity.ros.hold import Hold
from dvrk_gravity.ros.presence import HOLD, Presence, busy_advice
from dvrk_gravity.ros.wire import PARAMETERS, CommandTopic

WATCHDOG_TOPIC = "watchdog_status"
"""Latched, and repeated: what it watches, to whom it sends a hold, and after how long."""

TIMEOUT_TOPIC = "watchdog_timeout"
"""Latched: its time-out alone, s, for compensators of version 0.1; to be removed."""

# Compensators are looked for, and what it does is said again, so often, s.
_LOOK = 1.0
# Those that it hears are looked for so often, s: a compensator waits for that before it commands.
_LISTEN = 0.1

_COMMANDS = {"sensor_msgs/msg/JointState", "std_msgs/msg/Float64MultiArray"}

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
        self._hold = Hold(self, Presence(self, any_subscriber=topic.as_array).arm_hears_hold)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._state = self.create_publisher(String, "~/state", latched)
        self._status = self.create_publisher(DiagnosticStatus, WATCHDOG_TOPIC, latched)
        self.create_publisher(Float64, TIMEOUT_TOPIC, latched).publish(Float64(data=timeout))
        self.prompt = subscribe_raw(self, topic.message_type, topic.name, self._on_command, 1)
        self.create_subscription(Empty, HOLD, self._on_hold, 10)
        self._watching = WatchdogStatus(
            self.get_fully_qualified_name(),
            str(self.prompt.topic_name),
            self.resolve_topic_name(HOLD),
            timeout,
        )
        self._unseen = ""
        runtime.every(self, timeout / 4, self._on_watch)
        self._commanders = Endpoints(
            self._watching.topic, self.count_publishers, self.get_publishers_info_by_topic
        )
        runtime.every(self, _LISTEN, self._on_listen)
        runtime.every(self, _LOOK, self._on_look)
        self._report(f"watching {topic.name}: hold after {timeout:g} s without a command")
        self._publish_status()

    def _on_command(self, data: bytes, info: object) -> None:
        if self._watch.note_command(time.monotonic()):
            self._hold.drop()
            self._report("the arm is commanded")

    def _on_hold(self, _: Empty) -> None:
        if not self._hold.is_echo() and self._watch.note_hold():
            self._report("the arm holds: its commands ended with a hold")

    def _on_watch(self) -> None:
        self._hold.look()
        silence = self._watch.check(time.monotonic())
        if silence:
            self._hold.send()
            text = f"hold sent: no command for {silence:.3f} s and no hold before"
            self._state.publish(String(data=text))
            advice = (
                busy_advice(self) or "to resume, call ~/enable of the compensator, or restart it"
            )
            self.get_logger().error(f"{text}; {advice}")

    def _on_listen(self) -> None:
        """Say at once whose commands would reach us."""
        heard = frozenset(map(bytes.hex, self._commanders.nodes(seldom=self._watch.commanded)))
        if heard != self._watching.heard:
            self._watching = replace(self._watching, heard=heard)
            self._publish_status()

    def _on_look(self) -> None:
        """Say what we do, and where compensators here command on another topic than the watched.

        Compensators are those that subscribe to what we say of ourselves.
        """
        listeners = self.get_subscriptions_info_by_topic(self._status.topic_name)
        commands = {name: self._commands_of(name) for name in node_names(listeners)}
        unseen = unseen_commands(self._watching.topic, commands)
        before, self._unseen = self._unseen, unseen
        self._publish_status()
        if unseen == before:
            return
        if unseen:
            self._state.publish(String(data=unseen))
            self.get_logger().warning(unseen)
        else:
            self._report(f"watching {self._watching.topic}")

    def _commands_of(self, name: str) -> list[str]:
        namespace, _, base = name.rpartition("/")
        try:
            topics = self.get_publisher_names_and_types_by_node(base, namespace or "/")
        except NodeNameNonExistentError:  # it has just ended
            return []
        return [topic for topic, types in topics if _COMMANDS.intersection(types)]

    def _publish_status(self) -> None:
        level = DiagnosticStatus.WARN if self._unseen else DiagnosticStatus.OK
        text = self._unseen or f"watching {self._watching.topic}"
        self._status.publish(status_message(self, level, text, self._watching.values()))

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
