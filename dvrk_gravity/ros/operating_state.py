"""The arm's own word on whether it can be commanded: CRTK's ``operating_state``, where it is known.

Its message type, crtk_msgs/OperatingState, is built with the dVRK's own workspace.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

try:
    from crtk_msgs.msg import OperatingState
except ImportError:
    OperatingState = None

# Who publishes it latched tells the present state to who comes later; who does not is heard by
# nobody who asks for that.
_PROFILES = tuple(
    QoSProfile(depth=1, durability=durability)
    for durability in (DurabilityPolicy.VOLATILE, DurabilityPolicy.TRANSIENT_LOCAL)
)


def subscribe(node: Node, report: Callable[[str], None]) -> None:
    """Call ``report`` with why the arm must not be commanded, ``""`` where it may."""
    for profile in () if OperatingState is None else _PROFILES:
        node.create_subscription(
            OperatingState, "operating_state", lambda message: report(obstacle(message)), profile
        )


def obstacle(message: Any) -> str:
    """Return what an operating state says against commanding the arm, ``""``: nothing.

    Args:
        message: A crtk_msgs/OperatingState: ``state`` (DISABLED, ENABLED, PAUSED, FAULT),
            ``is_homed`` and ``is_busy``.
    """
    if message.state != "ENABLED":
        return f"the arm says that it is {message.state} (operating_state), expected ENABLED"
    if not message.is_homed:
        return "the arm says that it is not homed (operating_state)"
    if message.is_busy:
        return "the arm says that it is busy (operating_state)"
    return ""
