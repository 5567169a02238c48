"""The compensator: makes an MTM weightless (measured_js in, servo_jf out)."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import (
    Bool,
    Empty,
    Float64MultiArray,
    MultiArrayDimension,
    MultiArrayLayout,
    String,
)
from std_srvs.srv import SetBool

from dvrk_gravity.compensate.sample import DroppedSampleError, SampleReader
from dvrk_gravity.compensate.settings import Settings
from dvrk_gravity.compensate.statistics import Statistics
from dvrk_gravity.compensate.supervisor import Status, Supervisor
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.model import ALL_PARAMETERS
from dvrk_gravity.nodes import runtime
from dvrk_gravity.nodes.executor import PromptNode
from dvrk_gravity.nodes.rivals import LISTEN, Rivals
from dvrk_gravity.nodes.wire import CommandWriter, JointStateReader
from dvrk_gravity.parameter import check_all

_LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Compensator(PromptNode):
    """Publishes the effort that holds the arm against its own weight, and a hold otherwise."""

    def __init__(self) -> None:
        """Read the parameters, connect the topics.

        Raises:
            ConfigError: A parameter that is unknown or fails its check.
        """
        super().__init__("compensator", automatically_declare_parameters_from_overrides=True)
        given = runtime.given_parameters(self)
        settings = Settings.from_parameters(given)
        defaults = {name: entry.default for name, entry in ALL_PARAMETERS.items()}
        # What is declared comes back with every change: it has to be what is in force, such
        # as the gravity of an arm whose base is tilted.
        in_force = check_all(ALL_PARAMETERS, given) | settings.model.parameters()
        runtime.declare(self, defaults | in_force)
        self._supervisor = Supervisor(settings)
        arm, margin = settings.model.arm, settings.position_margin
        self._unpack = JointStateReader().read
        self._reader = SampleReader(arm.joint_names, arm.lower - margin, arm.upper + margin)
        self._statistics = Statistics()
        self._told: tuple[Status, str] | None = None
        self._no_velocity_told = False
        self._connect()
        self.add_on_set_parameters_callback(self._check_parameters)
        self.add_post_set_parameters_callback(self._apply_parameters)

    def _connect(self) -> None:
        value = {name: self.get_parameter(name).value for name in ("output", "output_topic")}
        self._as_array = value["output"] == "array"
        topic = value["output_topic"] or ("commands" if self._as_array else "servo_jf")
        message = Float64MultiArray if self._as_array else JointState
        self._command = self.create_publisher(message, topic, 10)
        self._hold = self.create_publisher(Empty, "hold", 10)
        self._builtin_switch = self.create_publisher(Bool, "use_gravity_compensation", 10)
        self._state = self.create_publisher(String, "~/state", _LATCHED)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._rivals = Rivals(self, self._command, self._refuse_rival)
        self._writer = CommandWriter(
            self._supervisor.settings.model.arm.joint_names, self._rivals.mark
        )
        self.create_subscription(
            JointState, "gravity_compensation/setpoint_js", self._on_builtin, 1
        )
        self.create_service(SetBool, "~/enable", self._on_enable)
        # Four looks within the time-out notice a silence at most a quarter late.
        self._watch = self._timer(self._supervisor.settings.timeout / 4, self._on_watch)
        self._timer(LISTEN / 4, self._on_listen)
        self._timer(1.0, self._publish_diagnostics)

    def _timer(self, period: float, callback: Any) -> Any:
        return self.create_timer(period, callback, clock=runtime.STEADY_CLOCK)

    # --- input ---------------------------------------------------------------------------

    def _on_measured(self, data: bytes) -> None:
        now = time.monotonic()
        try:
            fields = self._unpack(data)
            sample = self._reader.read(
                fields.stamp_ns, fields.names, fields.position, fields.velocity, fields.effort
            )
            clock = self.get_clock().now().nanoseconds if self._ages_stamps else 0
            effort = self._supervisor.command(sample, now, clock)
        except DroppedSampleError as error:
            self._supervisor.drop(error)
            self._statistics.received(now)
            self.get_logger().warning(
                f"measured_js dropped ({error.cause}): {error}", throttle_duration_sec=5.0
            )
        else:
            if effort is not None:
                self._publish(effort, fields.stamp)
            self._statistics.received(now)
            self._statistics.computed(time.monotonic() - now)
            if sample.velocity is None and not self._no_velocity_told:
                self._no_velocity_told = True
                self.get_logger().warning("measured_js has no velocity: friction terms are off")
        self._settle()

    def _publish(self, effort: Any, stamp: tuple[int, int]) -> None:
        if self._as_array:
            label = MultiArrayDimension(label=self._rivals.mark, size=len(effort), stride=1)
            layout = MultiArrayLayout(dim=[label])
            self._command.publish(Float64MultiArray(layout=layout, data=effort))
        else:
            self._command.publish(self._writer.write(stamp, effort))

    def _on_builtin(self, message: JointState) -> None:
        self._supervisor.observe_builtin(np.asarray(message.effort))
        if self._supervisor.builtin_active and self._supervisor.settings.disable_builtin:
            self._builtin_switch.publish(Bool(data=False))
            self.get_logger().warning(
                "switching the arm's own gravity compensation off", throttle_duration_sec=5.0
            )
        self._settle()

    def _on_watch(self) -> None:
        self._supervisor.check_input(time.monotonic())
        self._settle()

    def _on_listen(self) -> None:
        """Look who is there; begin, once whoever commands the arm has had the time to be heard.

        Only then is there a subscription to the arm: who sees it may count on answers.
        """
        self._rivals.watch(self._supervisor.active)
        if self.prompt is not None:
            return
        topic = self.resolve_topic_name("measured_js")
        arm_is_there = self.count_publishers(topic) > 0
        if not arm_is_there:
            self.get_logger().info(
                f"waiting for {topic}: nobody publishes it",
                throttle_duration_sec=5.0,
                skip_first=True,
            )
        if self._rivals.listened(arm_is_there):
            depth = int(self.get_parameter("input_depth").value)
            self.prompt = self.create_subscription(
                JointState, topic, self._on_measured, depth, raw=True
            )
            self._settle()

    def _refuse_rival(self) -> None:
        """Leave the arm to another node that commands it."""
        if self._supervisor.status not in (Status.DISABLED, Status.FAULT):
            self._supervisor.fail(self._rivals.reason())
            if self._rivals.elder:
                self._supervisor.hold_due = False  # would take the arm out of the other's hands
            self._settle()

    # --- control -------------------------------------------------------------------------

    def _on_enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        results = self.set_parameters([Parameter("enabled", value=bool(request.data))])
        if request.data and results[0].successful:
            self._supervisor.enable()  # out of a fault, too, where the parameter is true already
        if self._rivals.heard_lately():
            self._refuse_rival()
        self._settle()
        refused = request.data and self._supervisor.status is Status.FAULT
        response.success = results[0].successful and not refused
        response.message = f"{self._supervisor.status.value}: {self._supervisor.reason}"
        return response

    def _check_parameters(self, changes: list[Parameter]) -> SetParametersResult:
        """Check a change together with everything that it does not change."""
        try:
            for change in changes:
                entry = ALL_PARAMETERS.get(change.name)
                if entry is not None and entry.read_only:
                    raise ConfigError(change.name, change.value, "no change while the node runs")
            Settings.from_parameters(self._with_changes(changes))
        except ConfigError as error:
            self.get_logger().error(f"parameter refused: {error}")
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _apply_parameters(self, changes: list[Parameter]) -> None:
        settings = Settings.from_parameters(self._with_changes([]))
        self._supervisor.configure(settings, time.monotonic())
        self._watch.timer_period_ns = int(settings.timeout / 4 * 1e9)
        if self._rivals.heard_lately():
            self._refuse_rival()
        self._settle()

    def _with_changes(self, changes: list[Parameter]) -> dict[str, Any]:
        values = runtime.given_parameters(self)
        own = [change for change in changes if not change.name.startswith(runtime.OF_RCLPY)]
        return values | {change.name: runtime.plain(change.value) for change in own}

    @property
    def _ages_stamps(self) -> bool:
        return self._supervisor.settings.max_stamp_age > 0.0

    # --- output --------------------------------------------------------------------------

    def _settle(self) -> None:
        """Carry out a hold that is due and tell a change of state."""
        if self._supervisor.hold_due:
            self._hold.publish(Empty())
            self._supervisor.hold_due = False
        if self._told != (self._supervisor.status, self._supervisor.reason):
            self._report_status()

    def _report_status(self) -> None:
        status, reason = self._supervisor.status, self._supervisor.reason
        self._told = (status, reason)
        text = f"{status.value}: {reason}"
        self._state.publish(String(data=text))
        if status is Status.FAULT:
            self.get_logger().error(f"{text} — no command until ~/enable is called")
        else:
            self.get_logger().info(text)

    def _publish_diagnostics(self) -> None:
        supervisor = self._supervisor
        level = {
            Status.FAULT: DiagnosticStatus.ERROR,
            Status.WAITING: DiagnosticStatus.WARN,
        }.get(supervisor.status, DiagnosticStatus.OK)
        names = supervisor.settings.model.arm.joint_names
        saturated = [name for name, cut in zip(names, supervisor.saturated, strict=True) if cut]
        values = {
            "state": supervisor.status.value,
            "reason": supervisor.reason,
            **self._statistics.take(time.monotonic()),
            "saturated joints": ", ".join(saturated) or "none",
            "builtin compensation": "on" if supervisor.builtin_active else "off or not seen",
            **{f"dropped {cause}": str(count) for cause, count in supervisor.dropped.items()},
        }
        status = DiagnosticStatus(
            level=level,
            name=self.get_fully_qualified_name(),
            message=f"{supervisor.status.value}: {supervisor.reason}",
            hardware_id=supervisor.settings.model.arm.name,
            values=[KeyValue(key=key, value=value) for key, value in values.items()],
        )
        message = DiagnosticArray(status=[status])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)

    def finish(self) -> None:
        """Leave the arm held if it is under our command, and see that the hold has arrived."""
        if self._supervisor.active:
            self._supervisor.disable()
            self._settle()
            if not runtime.arrived(self._hold, Empty()):
                self.get_logger().error("hold was not acknowledged: check that the arm holds")
