"""Notices that somebody else commands the arm, in any of the ways that its console has.

Any command but ours takes the arm out of effort mode, or fights with ours. The arm obeys the last
one that it got: two who command it would hand it to and fro.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable
from importlib import import_module
from typing import Any

from rclpy.node import Node

# What moves an arm, takes it out of its mode, or changes what its commands do, as the console
# subscribes to it: the commands of CRTK (Collaborative Robotics Toolkit) in cisst-ros
# (mts_ros_crtk_bridge_provided.cpp), those that the dVRK adds in an arm's own bridge
# (dvrk_system_ROS.cpp), and those of earlier versions of both. A PSM's jaw is no part of the arm,
# and `use_gravity_compensation` is watched by what comes of it.
_TYPES = {
    "hold": "std_msgs/Empty",
    "free": "std_msgs/Empty",
    "servo_jp": "sensor_msgs/JointState",
    "servo_jr": "sensor_msgs/JointState",
    "servo_jv": "sensor_msgs/JointState",
    "servo_jf": "sensor_msgs/JointState",
    "servo_cp": "geometry_msgs/PoseStamped",
    "servo_cr": "geometry_msgs/PoseStamped",
    "servo_cv": "geometry_msgs/TwistStamped",
    "servo_cf": "geometry_msgs/WrenchStamped",
    "body/servo_cf": "geometry_msgs/WrenchStamped",
    "spatial/servo_cf": "geometry_msgs/WrenchStamped",
    "servo_cs": "crtk_msgs/CartesianState",
    "servo_ci": "crtk_msgs/CartesianImpedance",
    "local/servo_cp": "geometry_msgs/PoseStamped",
    "interpolate_jp": "sensor_msgs/JointState",
    "interpolate_jr": "sensor_msgs/JointState",
    "interpolate_cp": "geometry_msgs/PoseStamped",
    "interpolate_cr": "geometry_msgs/PoseStamped",
    "move_jp": "sensor_msgs/JointState",
    "move_jr": "sensor_msgs/JointState",
    "move_cp": "geometry_msgs/PoseStamped",
    "move_cr": "geometry_msgs/PoseStamped",
    "local/move_cp": "geometry_msgs/PoseStamped",
    "state_command": "crtk_msgs/StringStamped",
    "lock_orientation": "geometry_msgs/Quaternion",
    "unlock_orientation": "std_msgs/Empty",
    "body/set_cf_orientation_absolute": "std_msgs/Bool",
    "set_cartesian_impedance_gains": "cisst_msgs/PrmCartesianImpedanceGains",
}


def _message_type(name: str) -> Any:
    """Return the class of a message, ``None`` where this computer does not have it."""
    package, _, message = name.partition("/")
    try:
        return getattr(import_module(f"{package}.msg"), message, None)
    except ImportError:
        return None


_KNOWN = {name: _message_type(kind) for name, kind in _TYPES.items()}

COMMANDS: tuple[tuple[str, Any], ...] = tuple(
    (name, kind) for name, kind in _KNOWN.items() if kind is not None
)
"""Commands that can be heard: topic in the arm's namespace, and type."""

UNHEARD: tuple[str, ...] = tuple(name for name, kind in _KNOWN.items() if kind is None)
"""Topics of commands whose messages cannot be read here: the dVRK's workspace is not sourced."""

LATELY = 0.3
"""How long ago a command counts as one that is still going on, s."""


class Others:
    """Listens to every command that is not given on the topic of our own.

    Attributes:
        topic: Topic of the last command of somebody else; ``""``: none yet.
        is_hold: It was a hold, which moves nothing.
        is_free: It was ``free``: whoever sent it may have a hand in the arm.
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
        self._unheard = {node.resolve_topic_name(name): _TYPES[name] for name in UNHEARD}
        self.topic, self.is_hold, self.is_free = "", False, False
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

    def unheard(self) -> str:
        """Return who may command the arm with messages that cannot be read here, ``""``: nobody.

        Elsewhere a publisher alone proves nothing: clients have one for every command, and most
        never use it. Of these that is all that there is to see.
        """
        for topic, kind in self._unheard.items():
            if self._node.count_publishers(topic) > 0:
                who = named(self._node.get_publishers_info_by_topic(topic), self._node)
                return (
                    f"another node{who} may command {topic}, whose messages ({kind}) cannot be "
                    "read here: stop it, or source the dVRK's workspace"
                )
        return ""

    def _listener(self, topic: str) -> Callable[[bytes], None]:
        is_hold, is_free = (
            topic == self._node.resolve_topic_name(name) for name in ("hold", "free")
        )

        def listen(_: bytes) -> None:
            if is_hold and self._echo():
                return
            self.topic, self.is_hold, self.is_free = topic, is_hold, is_free
            self._last = time.monotonic()
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
