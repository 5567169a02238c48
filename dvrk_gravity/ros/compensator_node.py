"""The compensator: makes an arm weightless (measured_js in, servo_jf out)."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, String
from std_srvs.srv import SetBool

from dvrk_gravity.compensate import (
    SAME_TOPIC,
    STATEMENT,
    DroppedSampleError,
    Settings,
    Status,
    Supervisor,
    Watchdogs,
    WatchdogStatus,
    stated_order,
)
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.model import all_parameters
from dvrk_gravity.parameters import node_parameters
from dvrk_gravity.ros import runtime
from dvrk_gravity.ros.arm_link import ArmLink
from dvrk_gravity.ros.diagnostics import Diagnostics, Statistics, supervisor_state
from dvrk_gravity.ros.executor import PromptNode, subscribe_raw
from dvrk_gravity.ros.foreign_commands import LATELY, Endpoints
from dvrk_gravity.ros.presence import HOLD, MEASURED, busy_advice, require_own
from dvrk_gravity.ros.watchdog_node import WATCHDOG_TOPIC
from dvrk_gravity.ros.wire import PARAMETERS, CommandTopic

_LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
_OF_SEVERAL = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
_COMMANDED = (Status.RAMPING, Status.COMMANDING)


class Compensator(PromptNode):
    """Publishes the effort that holds the arm against its own weight, and a hold otherwise."""

    def __init__(self) -> None:
        """Read the parameters, connect the topics.

        Raises:
            ConfigError: A parameter that is unknown or fails its check.
        """
        # Undeclared ones are allowed, and checked like all others: they may belong to effects that
        # the model does not have yet, such as a payload.
        super().__init__(
            "compensator",
            automatically_declare_parameters_from_overrides=True,
            allow_undeclared_parameters=True,
        )
        given = runtime.given_parameters(self)
        settings = Settings.from_parameters(given)
        self._schema = all_parameters(settings.model.arm)
        runtime.declare(self, self._schema, active_parameters(settings))
        self._supervisor = self._supervise(settings)
        self._checked = settings
        arm = settings.model.arm
        require_own(arm, self.get_namespace())
        self._as_taken = arm.reading_of_torque  # an arm that reads A takes A

        self._statistics = Statistics()
        self._reported: tuple[Status, str, str] | None = None
        self._warned_of_velocity = False
        self._unwatched = ""  # where no watchdog watches our commands, in words
        self._connect()
        self.add_pre_set_parameters_callback(self._look_for_the_end)
        self.add_on_set_parameters_callback(self._check_parameters)
        self.add_post_set_parameters_callback(self._apply_parameters)

    def _supervise(self, settings: Settings) -> Supervisor:
        return Supervisor(settings)

    def _command_topic(self) -> CommandTopic:
        return CommandTopic.of({name: self.get_parameter(name).value for name in PARAMETERS})

    def _connect(self) -> None:
        settings = self._supervisor.settings
        arm = settings.model.arm
        self._arm = ArmLink(
            self,
            arm,
            self._command_topic(),
            on_other=self._on_other,
            on_same_topic=self._refuse_same_topic,
            on_state=lambda reason: self._obstruct("operating_state", reason),
            margin=settings.position_margin * arm.scale,
            order=stated_order(arm.joint_names, self.get_parameter(STATEMENT).value),
        )
        self._watchdogs = Watchdogs(
            self._arm.topic,
            self.resolve_topic_name(HOLD),
            time.monotonic() + float(self.get_parameter("await_watchdog").value),
        )
        self._commanders = Endpoints(
            self._arm.topic, self.count_publishers, self.get_publishers_info_by_topic
        )
        self._builtin_switch = self.create_publisher(Bool, "use_gravity_compensation", 10)
        self._state = self.create_publisher(String, "~/state", _LATCHED)
        self._diagnostics = Diagnostics(self, arm.name)
        self.create_subscription(
            JointState, "gravity_compensation/setpoint_js", self._on_builtin, 1
        )
        watchdogs = self.create_subscription(
            DiagnosticStatus, WATCHDOG_TOPIC, self._on_watchdog, _OF_SEVERAL
        )
        self._of_watchdogs = Endpoints(
            watchdogs.topic_name, self.count_publishers, self.get_publishers_info_by_topic
        )
        self.create_service(SetBool, "~/enable", self._on_enable)
        # Four checks within the time-out notice a silence at most a quarter late.
        self._watch = runtime.every(self, settings.timeout / 4, self._on_watch)
        runtime.every(self, LATELY / 4, self._on_listen)
        runtime.every(self, 1.0, self._publish_diagnostics)

    # --- input ---------------------------------------------------------------------------

    def _on_measured(self, data: bytes, info: dict[str, Any]) -> None:
        now = time.monotonic()
        several = self._arm.presence.note_message(info)
        if several:
            self._supervisor.obstruct("measured_js", several)
        try:
            sample = self._arm.read(data)
            if self._arm.order_mismatch:
                self._supervisor.obstruct("joint_order", self._arm.order_mismatch)
            effort = self._supervisor.command(sample, now, self._now())
        except DroppedSampleError as error:
            self._supervisor.drop(error)
            self._statistics.received(now)
            if error.cause == "after_gap":
                self._arm.hold.repeat()
            advice = self._supervisor.busy_advice if error.cause == "stamp_too_old" else ""
            self.get_logger().warning(
                f"measured_js dropped ({error.cause}): {error}{advice and f'; {advice}'}",
                throttle_duration_sec=5.0,
            )
        else:
            if effort is not None and self._supervisor.in_time(time.monotonic()):
                self._arm.publish(sample.stamp, self._as_taken(effort))
            self._statistics.received(now)
            self._statistics.computed(time.monotonic() - now)
            if sample.velocity is None and not self._warned_of_velocity:
                self._warned_of_velocity = True
                self.get_logger().warning("measured_js has no velocity: friction not compensated")
        self._settle()

    def _now(self) -> int:
        """Return the node's clock, ns; the system's, unless time is simulated, is faster."""
        clock = self.get_clock()
        simulated = clock.ros_time_is_active  # type: ignore[attr-defined]  # of a ROSClock
        return clock.now().nanoseconds if simulated else time.time_ns()

    def _on_builtin(self, message: JointState) -> None:
        off = self._supervisor.observe_builtin(np.asarray(message.effort))
        # Not before others have had the time to be heard: it may carry the arm for them.
        if off and self.prompt is not None and not self._arm.commanded_by_others():
            self._builtin_switch.publish(Bool(data=False))
            self.get_logger().warning(
                "switching the arm's own gravity compensation off", throttle_duration_sec=5.0
            )
        self._settle()

    def _on_watchdog(self, message: DiagnosticStatus) -> None:
        status = WatchdogStatus.of(
            message.name, {entry.key: entry.value for entry in message.values}
        )
        if status is not None:
            self._watchdogs.note(status, time.monotonic())

    def _watchdog_obstacle(self) -> str:
        supervisor = self._supervisor
        return self._watchdogs.obstacle(
            supervisor.settings.timeout, time.monotonic(), supervisor.active
        )

    def _on_watch(self) -> None:
        self._supervisor.check_input(time.monotonic())
        self._settle()

    def _on_listen(self) -> None:
        """Look for other nodes, and repeat a pending hold.

        We subscribe to the arm only after other nodes have had the time to be heard: a client that
        sees the subscription may rely on answers.
        """
        active = self._supervisor.active
        watchdogs = {*self._of_watchdogs.nodes(seldom=active).values()}
        obstacles = self._arm.look(active, self.prompt is not None, watchdogs)
        us = self.get_fully_qualified_name()
        commanders = self._commanders.nodes(seldom=active)
        own = {number.hex() for number, name in commanders.items() if name == us}
        self._watchdogs.look(watchdogs, own)
        self._unwatched = self._watchdogs.unwatched_reason(time.monotonic())
        if not active:
            self._supervisor.busy_advice = busy_advice(self)
        obstacles["watchdog"] = self._watchdog_obstacle()
        for cause, reason in obstacles.items():
            self._obstruct(cause, reason)
        if self.prompt is not None:
            return
        if self._arm.has_listened():
            self._subscribe(MEASURED)
        elif not self._arm.presence.is_there():
            self.get_logger().info(
                f"waiting for {self.resolve_topic_name(MEASURED)}, which no node publishes: is the "
                "arm's namespace another one (--ros-args -r __ns:=/NAME)?",
                throttle_duration_sec=5.0,
                skip_first=True,
            )

    def _subscribe(self, topic: str) -> None:
        depth = int(self.get_parameter("input_depth").value)
        self.prompt = subscribe_raw(self, JointState, topic, self._on_measured, depth)
        self._settle()

    def _on_other(self) -> None:
        """Stop, with a hold, for another node's command; only ~/enable starts again."""
        reason = self._arm.other_topics.reason()
        if self._arm.other_topics.command != "hold":
            self._arm.hold.drop()  # it would undo the other's command
            if self._supervisor.starts_automatically:
                self._supervisor.fail(reason)
        self._obstruct("others", reason)

    def _refuse_same_topic(self) -> None:
        """Leave the arm to another node that publishes on our command topic."""
        if self._supervisor.active or self._supervisor.starts_automatically:
            self._supervisor.fail(self._arm.same_topic.reason())
            if self._arm.same_topic.elder:
                self._supervisor.hold_due = False  # it would stop the other, too
            self._settle()

    def _obstruct(self, cause: str, reason: str) -> None:
        self._supervisor.obstruct(cause, reason)
        self._settle()

    # --- control -------------------------------------------------------------------------

    def _on_enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        wanted = bool(request.data)
        if not wanted:  # first, whatever else fails
            self._switch_off()
        (result,) = self.set_parameters([Parameter("enabled", value=wanted)])
        if wanted and result.successful:
            self._supervisor.enable()  # out of a fault, too, where the parameter is true already
        if wanted and self._arm.same_topic.heard_lately():
            self._refuse_same_topic()
        self._settle()
        refused = not result.successful or self._supervisor.status is Status.FAULT
        response.success = not (wanted and refused)
        response.message = f"{self._supervisor.status.value}: {self._supervisor.reason}"
        return response

    def _switch_off(self) -> None:
        self._supervisor.disable()
        self._settle()

    def _look_for_the_end(self, changes: list[Parameter]) -> list[Parameter]:
        """Hold the arm if a change disables, before rclpy or we refuse other changes with it."""
        if any(change.name == "enabled" and change.value is False for change in changes):
            self._switch_off()
        return changes

    def _check_parameters(self, changes: list[Parameter]) -> SetParametersResult:
        """Check a change together with all other parameters."""
        # A request may have many: meanwhile no message is received, and the arm is held for it.
        self._supervisor.check_input(time.monotonic())
        self._settle()
        try:
            for change in changes:
                entry = self._schema.get(change.name)
                if entry is not None and entry.read_only:
                    raise ConfigError(change.name, change.value, "no change while the node runs")
            own = [change for change in changes if not change.name.startswith(runtime.OF_RCLPY)]
            values = runtime.given_parameters(self)
            values |= {change.name: runtime.plain_value(change.value) for change in own}
            settings = Settings.from_parameters(values, self._supervisor.settings)
            conflict = self._watchdogs.timeout_conflict(settings.timeout)
            if conflict and settings.timeout > self._supervisor.settings.timeout:
                raise ConfigError("timeout", settings.timeout, f"a shorter one: {conflict}")
        except ConfigError as error:
            self.get_logger().error(f"parameter refused: {error}")
            return SetParametersResult(successful=False, reason=str(error))
        self._checked = settings
        return SetParametersResult(successful=True)

    def _apply_parameters(self, changes: list[Parameter]) -> None:
        settings = self._checked
        self._supervisor.configure(settings, time.monotonic())
        self._watch.timer_period_ns = int(settings.timeout / 4 * 1e9)
        self._obstruct("watchdog", self._watchdog_obstacle())
        if self._arm.same_topic.heard_lately():
            self._refuse_same_topic()
        self._settle()

    # --- output --------------------------------------------------------------------------

    def _settle(self) -> None:
        """Send a hold that is due and report a change of state."""
        supervisor = self._supervisor
        if supervisor.hold_due:
            self._arm.hold.send()
            supervisor.hold_due = False
        elif supervisor.active and self._arm.hold.pending:
            self._arm.hold.drop()
        unwatched = self._unwatched if supervisor.active else ""
        if self._reported != (supervisor.status, supervisor.reason, unwatched):
            self._report_status(unwatched)

    def _report_status(self, unwatched: str) -> None:
        supervisor = self._supervisor
        before = self._reported
        self._reported = (supervisor.status, supervisor.reason, unwatched)
        text = f"{supervisor.status.value}: {supervisor.reason}"
        self._state.publish(String(data=f"{text}; {unwatched}" if unwatched else text))
        if unwatched and not (before and before[2]):
            self.get_logger().warning(f"{unwatched}; {SAME_TOPIC}")
        if before and before[:2] == self._reported[:2]:
            return
        if supervisor.status is Status.FAULT:
            self.get_logger().error(f"{text} — no commands until ~/enable is called")
        elif supervisor.status is Status.WAITING and before and before[0] in _COMMANDED:
            self.get_logger().warning(text)
        else:
            self.get_logger().info(text)
        if supervisor.active and before is not None and before[0] is Status.STARTING:
            self.get_logger().info(f"starting from {supervisor.origin}")
        if supervisor.status is Status.RAMPING and supervisor.change:
            self.get_logger().warning(supervisor.change)

    def _publish_diagnostics(self) -> None:
        statistics = self._statistics.take(time.monotonic())
        self._diagnostics.publish(
            *supervisor_state(self._supervisor, statistics, self._arm.hold.missing, self._unwatched)
        )

    def finish(self) -> bool:
        """Hold the arm if it is under our command; return whether that is acknowledged."""
        if self._supervisor.active:
            self._supervisor.disable()
        self._settle()
        return self._arm.hold.settle()


def active_parameters(settings: Settings) -> dict[str, Any]:
    """Return the parameters of a node and its model in force, by name.

    Declared values return with every change of parameters: the gravity of an arm whose base is
    tilted, limits that are the arm's.
    """
    limits = {
        "effort_limit": settings.limits.joint,
        "actuator_effort_limit": settings.limits.actuator,
        "slew_limit": settings.slew_limit,
    }
    return {
        **{name: entry.default for name, entry in node_parameters(settings.model.arm).items()},
        **settings.model.parameters(),
        **{name: tuple(value.tolist()) for name, value in limits.items()},
    }
