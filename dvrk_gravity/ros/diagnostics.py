"""What the compensator tells about itself on /diagnostics."""

from __future__ import annotations

from collections.abc import Mapping

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from numpy.typing import NDArray
from rclpy.node import Node

from dvrk_gravity.compensate import Status, Supervisor


class Diagnostics:
    """Publishes a supervisor's state, and in words what a person should know of it."""

    def __init__(self, node: Node) -> None:
        """Create the publisher."""
        self._node = node
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 10)

    def publish(
        self, supervisor: Supervisor, statistics: Mapping[str, str], not_held: bool
    ) -> None:
        """Publish the state, with further figures by name, and whether a hold reaches nobody."""
        told = warnings(supervisor)
        if not_held:
            told.insert(0, "hold reaches nobody: the arm may keep its last effort")
        state = f"{supervisor.status.value}: {supervisor.reason}"
        values = {
            "state": supervisor.status.value,
            "reason": supervisor.reason,
            "warnings": "; ".join(told) or "none",
            **statistics,
            "started from": supervisor.origin or "not started",
            "saturated joints": _joints(supervisor, supervisor.saturated) or "none",
            "builtin compensation": "on" if supervisor.builtin_active else "off or not seen",
            **{f"dropped {cause}": str(count) for cause, count in supervisor.dropped.items()},
        }
        status = DiagnosticStatus(
            level=_level(supervisor.status, bool(told), not_held),
            name=self._node.get_fully_qualified_name(),
            message="; ".join([state, *told]),
            hardware_id=supervisor.settings.model.arm.name,
            values=[KeyValue(key=key, value=value) for key, value in values.items()],
        )
        message = DiagnosticArray(status=[status])
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(message)


def warnings(supervisor: Supervisor) -> list[str]:
    """Return what a person at an arm under command should know, a sentence each."""
    if not supervisor.active:
        return []
    told = []
    if supervisor.settings.weightless:
        told.append("gravity is left out: nothing carries the arm's weight")
    if supervisor.change:
        told.append(supervisor.change)
    if supervisor.saturated.any():
        told.append(f"effort limits cut the torque of {_joints(supervisor, supervisor.saturated)}")
    if supervisor.doubtful.any():
        told.append(
            f"the velocity of {_joints(supervisor, supervisor.doubtful)} contradicts its positions:"
            " friction there is left out"
        )
    if supervisor.outside.any():
        told.append(
            f"{_joints(supervisor, supervisor.outside)} outside the limits of "
            f"{supervisor.settings.model.arm.name}: the model of another arm, or a wrong zero?"
        )
    if supervisor.friction_held_back.any():
        told.append(
            f"friction compensation of {_joints(supervisor, supervisor.friction_held_back)} is held"
            " back: it may make the motion grow"
        )
    return told


def _level(status: Status, warned: bool, not_held: bool) -> bytes:
    if not_held or status is Status.FAULT:
        return DiagnosticStatus.ERROR
    if warned or status in (Status.WAITING, Status.STARTING):
        return DiagnosticStatus.WARN
    return DiagnosticStatus.OK


def _joints(supervisor: Supervisor, which: NDArray) -> str:
    names = supervisor.settings.model.arm.joint_names
    return ", ".join(name for name, yes in zip(names, which, strict=True) if yes)
