"""Notices that somebody else moves the arm, by any of the ways that its console has.

Any command but ours takes the arm out of effort mode, or fights with ours. The arm obeys the last
one that it got: two who command it would hand it to and fro.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable
from typing import Any

from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Empty

# What moves an arm or takes it out of its mode: the motion commands of CRTK (Collaborative Robotics
# Toolkit, crtk_ros_client), and the dVRK's own in further frames.
COMMANDS: tuple[tuple[str, Any], ...] = (
    ("hold", Empty),
    ("free", Empty),
    ("servo_jp", JointState),
    ("servo_jr", JointState),
    ("servo_jv", JointState),
    ("servo_jf", JointState),
    ("servo_cp", PoseStamped),
    ("servo_cr", PoseStamped),
    ("servo_cv", TwistStamped),
    ("servo_cf", WrenchStamped),
    ("body/servo_cf", WrenchStamped),
    ("spatial/servo_cf", WrenchStamped),
    ("interpolate_jp", JointState),
    ("interpolate_jr", JointState),
    ("interpolate_cp", PoseStamped),
    ("interpolate_cr", PoseStamped),
    ("move_jp", JointState),
    ("move_jr", JointState),
    ("move_cp", PoseStamped),
    ("move_cr", PoseStamped),
)

LATELY = 0.3
"""How long ago a command counts as one that is still going on, s."""


class Others:
    """Listens to every command that is not given on the topic of our own.

    Attributes:
        topic: Topic of the last command of somebody else; ``""``: none yet.
        is_hold: It was a hold, which moves nothing.
    """

    def __init__(
        self,
        node: Node,
        own_topic: str,
        echo: Callable[[], bool],
        heard: Callable[[], None],
    ) -> None:
        """Listen from now on.

        Args:
            node: The node.
            own_topic: Where we command; others there are :class:`~.rivals.Rivals`' business.
            echo: Tells whether a hold that was heard is our own.
            heard: Called for every command that is not ours.
        """
        self._node, self._echo, self._heard = node, echo, heard
        self.topic, self.is_hold = "", False
        self._last = -math.inf
        for name, kind in COMMANDS:
            topic = node.resolve_topic_name(name)
            if topic != own_topic:
                node.create_subscription(kind, topic, self._listener(topic), 10, raw=True)

    def heard_lately(self) -> bool:
        """Tell whether a command that is not ours has just come."""
        return time.monotonic() - self._last < LATELY

    def reason(self) -> str:
        """Return what to tell a person who wonders why the arm is not commanded."""
        who = named(self._node.get_publishers_info_by_topic(self.topic), self._node)
        if self.is_hold:
            return f"another node{who} has told the arm to hold ({self.topic})"
        return f"another node{who} commands {self.topic}: stop it first, two would fight"

    def _listener(self, topic: str) -> Callable[[bytes], None]:
        is_hold = topic == self._node.resolve_topic_name("hold")

        def listen(_: bytes) -> None:
            if is_hold and self._echo():
                return
            self.topic, self.is_hold, self._last = topic, is_hold, time.monotonic()
            self._heard()

        return listen


def node_names(endpoints: Iterable[Any]) -> set[str]:
    """Return the full names of the nodes of publishers or subscriptions.

    DDS learns of an endpoint a moment before it learns whose it is: those are left out.
    """
    found = {f"{info.node_namespace.rstrip('/')}/{info.node_name}" for info in endpoints}
    return {name for name in found if "_UNKNOWN_" not in name}


def named(endpoints: Iterable[Any], besides: Node) -> str:
    """Return the names of endpoints' nodes but one, as `` (/a, /b)``; ``""`` if none is known."""
    known = sorted(node_names(endpoints) - {besides.get_fully_qualified_name()})
    return f" ({', '.join(known)})" if known else ""
