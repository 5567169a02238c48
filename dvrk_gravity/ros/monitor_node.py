"""The monitor: says what pushes an arm and what changed in it. It commands nothing."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger

from dvrk_gravity.arrays import Array
from dvrk_gravity.compensate import DroppedSampleError
from dvrk_gravity.monitoring import Listener, Reading, Sampling
from dvrk_gravity.parameters import Parameter
from dvrk_gravity.report import event_json, event_text
from dvrk_gravity.ros import runtime
from dvrk_gravity.ros.diagnostics import Diagnostics, Statistics
from dvrk_gravity.ros.executor import PromptNode, arrived, subscribe_raw
from dvrk_gravity.ros.message_buffer import MessageBuffer
from dvrk_gravity.ros.presence import MEASURED, Presence
from dvrk_gravity.ros.wire import CommandWriter, JointStateReader

_ROWS = Sampling().row_rate
_LOOK = 0.2  # s, between looks for what the tests found
# s that messages gather: to wake for each of them costs as much as to read it. Half a row's length.
_GATHER = 0.01
_MOST = 200  # messages, after which all else is looked at

# Best effort: an arm's publisher waits for no monitor. A second at 1 kHz waits for a busy machine.
_MEASURED = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
_EVENTS = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)

MONITOR_PARAMETERS: dict[str, Parameter] = {
    entry.name: entry
    for entry in (
        Parameter(
            "publish_rate", _ROWS, "Hz", "of torques and wrench", lower=1.0, upper=_ROWS,
            read_only=True,
        ),
        Parameter(
            "tip", "", "", "link at which wrenches act; default: the arm's last", read_only=True
        ),
        Parameter(
            "wrench_frame", "", "", "frame_id of wrenches; default: the tip's name", read_only=True
        ),
        Parameter(
            "silence", 0.5, "s", "the arm is silent after this long without a valid message",
            lower=0.01, upper=10.0, read_only=True,
        ),
        Parameter(
            "save_seconds", 120.0, "s", "messages of this long are kept for ~/save", lower=10.0,
            upper=600.0, read_only=True,
        ),
        Parameter(
            "save_folder", "monitor", "", "where ~/save makes a folder, from the working folder on",
            read_only=True,
        ),
    )
}  # fmt: skip

_STATES = {
    "silent": (DiagnosticStatus.STALE, "no usable measured_js"),
    "learning": (DiagnosticStatus.OK, "learning what is usual:"),
    "as expected": (DiagnosticStatus.OK, "as the model expects"),
    "held by friction": (DiagnosticStatus.OK, "at rest, within what friction can hold:"),
    "external": (DiagnosticStatus.WARN, "torque from outside:"),
    "changed": (DiagnosticStatus.WARN, "not the arm of the model:"),
}


class Monitor(PromptNode):
    """Publishes what is expected of an arm, what differs, and what that is."""

    def __init__(self) -> None:
        """Read the parameters, connect the topics.

        Raises:
            ConfigError: A parameter that fails its check, or a model that cannot be used.
        """
        super().__init__("monitor", automatically_declare_parameters_from_overrides=True)
        given = runtime.given_parameters(self)
        # A file for all nodes (`/**`) has the compensator's parameters, too.
        own = {name: value for name, value in given.items() if name in MONITOR_PARAMETERS}
        others = {name: value for name, value in given.items() if name not in own}
        value = runtime.declare_constants(self, MONITOR_PARAMETERS, own, others)
        model = runtime.model_of(others)
        self._listener = Listener(model, value["tip"], timeout=value["silence"])
        self._unpack = JointStateReader().read
        self._presence = Presence(self, any_subscriber=True)
        self._statistics = Statistics()
        self._every, self._count = round(_ROWS / value["publish_rate"]), 0
        self._frame = value["wrench_frame"] or self._listener.tip
        self._save_result, self._failures = "", 0
        self._connect(value["save_seconds"])
        self.get_logger().info(
            f"monitoring {model.arm.name} on {self.resolve_topic_name(MEASURED)}"
            + ("" if model.uncertainty else ": the model has no uncertainty; what it misses in "
               "the first seconds counts as its error")
        )  # fmt: skip

    def _connect(self, seconds: float) -> None:
        names = self._listener.model.arm.joint_names
        self._write = CommandWriter(names, "").write
        self._torques = (
            self.create_publisher(JointState, "~/expected_js", 10),
            self.create_publisher(JointState, "~/external_js", 10),
            self.create_publisher(JointState, "~/external_js_std", 10),
        )
        self._wrenches = (
            self.create_publisher(WrenchStamped, "~/external_wrench", 10),
            self.create_publisher(WrenchStamped, "~/external_wrench_std", 10),
        )
        self._heard: set[Any] = set()  # publishers with subscribers
        self._events = self.create_publisher(String, "~/events", _EVENTS)
        self._diagnostics = Diagnostics(self, self._listener.model.arm.name)
        self.create_service(Trigger, "~/save", self._on_save)
        self._minutes = MessageBuffer(
            self._listener.model, self.resolve_topic_name(MEASURED), seconds
        )
        self.prompt = subscribe_raw(self, JointState, MEASURED, self._on_measured, _MEASURED)
        runtime.every(self, _LOOK, self._on_look)
        runtime.every(self, 1.0, self._publish_diagnostics)

    def _on_measured(self, data: bytes, info: Mapping[str, Any]) -> None:
        """Read a message, and those that come within a moment."""
        assert self.prompt is not None  # it called us
        self._read(data, info)
        time.sleep(_GATHER)
        for received in arrived(self.prompt, _MOST):
            self._read(*received)

    def _read(self, data: bytes, info: Mapping[str, Any]) -> None:
        now = time.monotonic()
        self._statistics.received(now)
        self._minutes.add(data, time.time_ns())
        try:
            if several := self._presence.note_message(info):
                raise DroppedSampleError("several_publishers", several)
            fields = self._unpack(data)
        except DroppedSampleError as error:
            self._listener.drop(error)
            return
        for reading in self._listener.receive(*fields, now):
            self._count += 1
            if self._count % self._every == 0:
                self._publish(reading)
        self._statistics.computed(time.monotonic() - now)

    def _publish(self, reading: Reading) -> None:
        values = (reading.expected, reading.external, reading.deviation)
        for publisher, torque in zip(self._torques, values, strict=True):
            if torque is not None and publisher in self._heard:
                publisher.publish(self._write(reading.stamp, torque))
        if reading.wrench is not None:
            of_wrench = (reading.wrench.value, reading.wrench.deviation)
            for wrenches, vector in zip(self._wrenches, of_wrench, strict=True):
                if wrenches in self._heard:
                    wrenches.publish(self._wrench(reading.stamp, vector))

    def _wrench(self, stamp: int, vector: Array) -> WrenchStamped:
        message = WrenchStamped()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 1_000_000_000)
        message.header.frame_id = self._frame
        for part, numbers in (
            (message.wrench.force, vector[:3]), (message.wrench.torque, vector[3:])
        ):  # fmt: skip
            part.x, part.y, part.z = numbers.tolist()
        return message

    def _on_look(self) -> None:
        # What nobody hears costs half of the rest to publish.
        publishers = (*self._torques, *self._wrenches)
        self._heard = {each for each in publishers if each.get_subscription_count()}
        for event in self._listener.collect_events():
            said = event_json(event, self._listener.model.arm)
            self._events.publish(String(data=json.dumps(said)))
            log = self.get_logger()
            (log.info if event.kind == "push" else log.warning)(said["sentence"])
        if self._listener.failures > self._failures:
            self._failures = self._listener.failures
            self.get_logger().error(f"the tests start again: {self._listener.why_failed}")
        if self._minutes.last_result != self._save_result:
            self._save_result = self._minutes.last_result
            self.get_logger().info(f"~/save: {self._save_result}")

    def _publish_diagnostics(self) -> None:
        now, listener = time.monotonic(), self._listener
        state, words = listener.state(now)
        level, meaning = _STATES[state]
        arm = listener.model.arm
        changes = [event_text(event, arm) for event in listener.changes]
        text = "; ".join(changes) if state == "changed" else words
        values = {
            "state": state,
            "torque": words or "as expected",
            "changes": "; ".join(changes) or "none",
            "last event": event_text(listener.events[-1], arm) if listener.events else "none",
            **self._wrench_values(),
            "saved": self._minutes.last_result or "nothing",
            "messages kept": str(len(self._minutes)),
            "rows not tested": str(listener.skipped),
            "tests started again": str(listener.failures),
            **self._statistics.take(now),
            **{f"dropped {cause}": str(count) for cause, count in listener.dropped.items()},
        }
        self._diagnostics.publish(level, f"{meaning} {text}".rstrip(), values)

    def _wrench_values(self) -> dict[str, str]:
        last = self._listener.last
        if last is None or last.wrench is None:
            return {}
        rows = np.array2string(last.wrench.covariance, precision=3, separator=", ")
        return {
            "wrench unobservable": last.wrench.unobservable_in_words() or "no direction",
            "wrench covariance": " ".join(rows.split()),
        }

    def _on_save(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        folder = Path(str(self.get_parameter("save_folder").value)).expanduser()
        response.success, response.message = self._minutes.save(folder)
        return response

    def finish(self) -> bool:
        """End the tests and what is being diagnosed; return whether that went well."""
        self._listener.close()
        self._minutes.close()
        return True
