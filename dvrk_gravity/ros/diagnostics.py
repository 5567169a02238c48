"""What nodes say on /diagnostics, and the compensator's state there."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from numpy.typing import NDArray
from rclpy.node import Node

from dvrk_gravity.compensate import Status, Supervisor


class Statistics:
    """Input rate, input age and compute time between two diagnostics."""

    def __init__(self) -> None:
        self._received = 0
        self._last = -math.inf
        self._since: float | None = None
        # Two seconds at 1 kHz: enough for a 99th percentile, and bounded.
        self._durations: deque[float] = deque(maxlen=2000)

    def received(self, now: float) -> None:
        """Count a message that came at monotonic time ``now``, s."""
        if self._since is None:
            self._since = now
        self._received += 1
        self._last = now

    def computed(self, seconds: float) -> None:
        """Note the time that one answer took."""
        self._durations.append(seconds)

    def take(self, now: float) -> dict[str, str]:
        """Return the figures since the last call, in words, and start again."""
        elapsed = 0.0 if self._since is None else now - self._since
        rate = self._received / elapsed if elapsed > 0.0 else 0.0
        age = now - self._last
        ordered = sorted(self._durations) or [0.0]
        p50, p99 = (ordered[int(part * len(ordered))] for part in (0.5, 0.99))
        self._received, self._since = 0, now
        self._durations.clear()
        return {
            "input rate Hz": f"{rate:.1f}",
            "input age s": f"{age:.4f}" if math.isfinite(age) else "never",
            "compute p50 us": f"{p50 * 1e6:.1f}",
            "compute p99 us": f"{p99 * 1e6:.1f}",
        }


class Diagnostics:
    """Publishes a node's state on /diagnostics."""

    def __init__(self, node: Node, arm: str) -> None:
        self._node, self._arm = node, arm
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 10)

    def publish(self, level: bytes, message: str, values: Mapping[str, str]) -> None:
        """Publish a level, a message for a person, and figures by name."""
        status = status_message(self._node, level, message, values, self._arm)
        array = DiagnosticArray(status=[status])
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(array)


def status_message(
    node: Node, level: bytes, message: str, values: Mapping[str, str], hardware: str = ""
) -> DiagnosticStatus:
    """Return a node's state as ROS has it."""
    return DiagnosticStatus(
        level=level,
        name=node.get_fully_qualified_name(),
        message=message,
        hardware_id=hardware,
        values=[KeyValue(key=key, value=value) for key, value in values.items()],
    )


def supervisor_state(
    supervisor: Supervisor, statistics: Mapping[str, str], not_held: bool, unwatched: str
) -> tuple[bytes, str, dict[str, str]]:
    """Return a supervisor's state with warnings for a person: level, message and figures.

    Args:
        supervisor: It.
        statistics: Further figures.
        not_held: A hold has no receiver.
        unwatched: In words, that no watchdog watches the commands; ``""``: one does.
    """
    warned = _warnings(supervisor)
    if unwatched and supervisor.active:
        warned.insert(0, unwatched)
    if not_held:
        warned.insert(0, "hold has no subscriber: the arm may keep its last effort")
    compensation = supervisor.compensation
    saturated = compensation and _joints(supervisor, compensation.saturated)
    state = f"{supervisor.status.value}: {supervisor.reason}"
    values = {
        "state": supervisor.status.value,
        "reason": supervisor.reason,
        "warnings": "; ".join(warned) or "none",
        **statistics,
        "watchdog": unwatched or "watches our commands",
        "started from": supervisor.origin or "not started",
        "saturated joints": saturated or "none",
        "builtin compensation": "on" if supervisor.builtin_active else "off or not seen",
        **{f"dropped {cause}": str(count) for cause, count in supervisor.dropped.items()},
    }
    return _level(supervisor.status, bool(warned), not_held), "; ".join([state, *warned]), values


def _warnings(supervisor: Supervisor) -> list[str]:
    """Return warnings to a person at an arm under command."""
    compensation = supervisor.compensation
    if compensation is None:
        return []
    arm = supervisor.settings.model.arm
    found = []
    if supervisor.settings.weightless:
        found.append("gravity is not compensated: the arm's weight is not carried")
    if supervisor.change:
        found.append(supervisor.change)
    for joints, text in (
        (compensation.saturated, "{} saturated at the effort limits"),
        (
            supervisor.doubtful,
            "velocity of {} contradicts the positions: friction there is not compensated",
        ),
        (
            compensation.outside,
            f"{{}} outside the position limits of {arm.name}: another arm's model, or a wrong "
            "encoder zero?",
        ),
        (
            compensation.friction_held_back,
            "friction compensation of {} is reduced: it may feed energy into the motion",
        ),
    ):
        if joints.any():
            found.append(text.format(_joints(supervisor, joints)))
    return found


def _level(status: Status, warned: bool, not_held: bool) -> bytes:
    if not_held or status is Status.FAULT:
        return DiagnosticStatus.ERROR
    if warned or status in (Status.WAITING, Status.STARTING):
        return DiagnosticStatus.WARN
    return DiagnosticStatus.OK


def _joints(supervisor: Supervisor, which: NDArray) -> str:
    names = supervisor.settings.model.arm.joint_names
    return ", ".join(name for name, yes in zip(names, which, strict=True) if yes)
