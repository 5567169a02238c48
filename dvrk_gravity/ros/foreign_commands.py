"""Notices other nodes that command the arm, in any of the ways that its console accepts.

Any command but ours takes the arm out of effort mode, or fights with ours. The arm obeys the last
one received: two nodes that command it would pass it to and fro.
"""

from __future__ import annotations

import math
import re
import secrets
import time
from collections.abc import Callable, Iterable
from importlib import import_module
from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo

# What moves an arm, takes it out of its mode, or changes what its commands do, as the console
# subscribes to it: the commands of CRTK (Collaborative Robotics Toolkit) in cisst-ros
# (mts_ros_crtk_bridge_provided.cpp), those that the dVRK adds in an arm's own bridge
# (dvrk_system_ROS.cpp), and those of earlier versions of both. A PSM's jaw is no part of the arm,
# and `use_gravity_compensation` is observed by its effect.
_TYPES = {
    name: kind
    for kind, names in {
        "std_msgs/Empty": "hold free unlock_orientation",
        "std_msgs/Bool": "body/set_cf_orientation_absolute",
        "sensor_msgs/JointState": "servo_jp servo_jr servo_jv servo_jf interpolate_jp "
        "interpolate_jr move_jp move_jr",
        "geometry_msgs/PoseStamped": "servo_cp servo_cr local/servo_cp interpolate_cp "
        "interpolate_cr move_cp move_cr local/move_cp",
        "geometry_msgs/TwistStamped": "servo_cv",
        "geometry_msgs/WrenchStamped": "servo_cf body/servo_cf spatial/servo_cf",
        "geometry_msgs/Quaternion": "lock_orientation",
        "crtk_msgs/CartesianState": "servo_cs",
        "crtk_msgs/CartesianImpedance": "servo_ci",
        "crtk_msgs/StringStamped": "state_command",
        "cisst_msgs/PrmCartesianImpedanceGains": "set_cartesian_impedance_gains",
    }.items()
    for name in names.split()
}


def _message_type(name: str) -> Any:
    """Return the class of a message, ``None``: not installed."""
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

UNREADABLE: tuple[str, ...] = tuple(name for name, kind in _KNOWN.items() if kind is None)
"""Topics of commands whose messages cannot be read here: the dVRK's workspace is not sourced."""

LATELY = 0.3
"""A command counts as still going on for so long, s; we command after as long a silence."""

PATIENCE = 1.0
"""Another compensator that started later has so long to notice us and to stop, s."""

# DDS may connect another one with us so late, s: it repeats lost greetings after 3 s.
_INTRODUCTION = 4.0

# Between two looks of the executor our own commands fill ten places at 1 kHz: none must be lost.
_DEPTH = 100

# Where endpoints are looked up seldom, that is done so often, s.
_LOOK = 1.0

_MARK = re.compile(rb"[0-9a-f]{8} since ([0-9]{20})")


def node_names(endpoints: Iterable[Any]) -> set[str]:
    """Return the full names of the nodes of publishers or subscriptions.

    DDS learns of an endpoint a moment before it learns whose it is: those are left out.
    """
    found = {f"{info.node_namespace.rstrip('/')}/{info.node_name}" for info in endpoints}
    return {name for name in found if "_UNKNOWN_" not in name}


class Endpoints:
    """The publishers or the subscriptions of a topic, looked up seldom: that takes 0.1 ms."""

    def __init__(
        self,
        topic: str,
        count: Callable[[str], int],
        infos: Callable[[str], Iterable[TopicEndpointInfo]],
    ) -> None:
        """Store the topic's full name, and a node's methods that count and list them."""
        self._topic, self._count, self._infos = topic, count, infos
        self._nodes: dict[bytes, str] = {}
        self._counted, self._looked = 0, -math.inf

    def nodes(self, seldom: bool) -> dict[bytes, str]:
        """Return the full names of their nodes, by the number that DDS gives each endpoint.

        ``seldom``: looked up once a second, or when their number changes.
        """
        now, count = time.monotonic(), self._count(self._topic)
        if not seldom or count != self._counted or now - self._looked > _LOOK:
            self._counted, self._looked = count, now
            self._nodes = {
                bytes(info.endpoint_gid): name
                for info in self._infos(self._topic)
                for name in node_names([info])
            }
        return self._nodes


def publishers_of(topic: str, node: Node) -> str:
    """Return the nodes besides ``node`` that publish a topic, as `` (/a, /b)``, or ``""``."""
    known = node_names(node.get_publishers_info_by_topic(topic))
    names = sorted(known - {node.get_fully_qualified_name()})
    return f" ({', '.join(names)})" if names else ""


class _ForeignCommands:
    """Commands of other nodes; ``topic`` is that of the last one."""

    topic: str

    def __init__(self, node: Node, heard: Callable[[], None]) -> None:
        self._node, self._heard = node, heard
        self._last = -math.inf  # when one was heard

    def heard_lately(self) -> bool:
        """Return whether another node has just sent a command."""
        return time.monotonic() - self._last < LATELY

    def reason(self) -> str:
        """Return for a person why the arm is not commanded."""
        who = publishers_of(self.topic, self._node)
        return f"another node{who} commands {self.topic}: stop it first, two would fight"


class OtherTopicCommands(_ForeignCommands):
    """Listens to every command topic of the arm but our own.

    Attributes:
        command: The last command of another node, ``hold`` or ``servo_jp`` for instance; ``""``:
            none yet.
    """

    def __init__(
        self, node: Node, own_topic: str, echo: Callable[[], bool], heard: Callable[[], None]
    ) -> None:
        """Listen from now on to all but ``own_topic``, and call ``heard`` for each command.

        ``echo`` returns whether a received hold is our own.
        """
        super().__init__(node, heard)
        self._echo = echo
        self._unreadable = {node.resolve_topic_name(name): _TYPES[name] for name in UNREADABLE}
        self.command = self.topic = ""
        for name, kind in COMMANDS:
            topic = node.resolve_topic_name(name)
            if topic != own_topic:
                node.create_subscription(kind, topic, self._listener(name, topic), 10, raw=True)

    def reason(self) -> str:
        """Return for a person why the arm is not commanded."""
        if self.command == "hold":
            return f"another node{publishers_of(self.topic, self._node)} sent hold ({self.topic})"
        return super().reason()

    def unreadable_commands(self) -> str:
        """Return who may command the arm with messages that cannot be read here, ``""``: nobody.

        Elsewhere a publisher alone proves nothing: clients have one for every command, and most
        never use it. Of these messages the publisher is all there is to see.
        """
        for topic, kind in self._unreadable.items():
            if self._node.count_publishers(topic) > 0:
                return (
                    f"another node{publishers_of(topic, self._node)} may command {topic}, whose "
                    f"messages ({kind}) cannot be read here: stop it, or source the dVRK's "
                    "workspace"
                )
        return ""

    def _listener(self, command: str, topic: str) -> Callable[[bytes], None]:
        def listen(_: bytes) -> None:
            if command == "hold" and self._echo():
                return
            self.command, self.topic = command, topic
            self._last = time.monotonic()
            self._heard()

        return listen


class SameTopicCommands(_ForeignCommands):
    """Listens to our own command topic, on which our commands bear a mark.

    A publisher alone proves nothing: crtk clients have one for every command and most never use it.
    Of two compensators the one that started later gives way: marks say when. It hears the other
    before it commands itself, unless both start together or DDS, which may know of a publisher for
    seconds before it delivers, connects them late. While we command and no other publisher exists
    there is no subscription: hearing all of our own commands costs as much as the measurements do.

    Attributes:
        mark: Text that every command of ours bears, and no other.
        elder: The last one heard is of a compensator that started before us.
    """

    def __init__(
        self,
        node: Node,
        publisher: Publisher,
        heard: Callable[[], None],
        reliability: ReliabilityPolicy,
    ) -> None:
        """Listen from now on to the topic of our ``publisher``, with the arm's ``reliability``.

        ``heard`` is called for every command that is not ours.
        """
        super().__init__(node, heard)
        self._profile = QoSProfile(depth=_DEPTH, reliability=reliability)
        self._start = time.time_ns()
        name = node.get_fully_qualified_name()
        self.mark = f"{name} {secrets.token_hex(4)} since {self._start:020d}"
        self._bytes = self.mark.encode()
        self._publisher, self.topic = publisher, publisher.topic_name
        self._subscription: Any = None
        self._first = -math.inf  # when the first of the last commands in a row was heard
        self.elder = False
        self._commanding_since = math.inf  # we do not command
        self._since = time.monotonic()
        self._others = False
        self.watch(commanding=False)

    def watch(self, commanding: bool) -> None:
        """Listen where there may be something to hear; to be called now and then."""
        others = self._node.count_publishers(self.topic) > 1
        if others and not self._others:
            self._since = time.monotonic()  # it may just not have been heard yet
        self._others = others
        self._commanding_since = (
            min(self._commanding_since, time.monotonic()) if commanding else math.inf
        )
        wanted = others or not commanding
        if wanted and self._subscription is None:
            self._subscription = self._node.create_subscription(
                self._publisher.msg_type, self.topic, self._on_command, self._profile, raw=True
            )
        elif not wanted and self._subscription is not None:
            self._node.destroy_subscription(self._subscription)
            self._subscription = None

    def has_listened(self, to_arm: bool) -> bool:
        """Return whether others have had the time to be heard since the arm is there.

        Before DDS has found the arm, it has not found others either: silence proves nothing.
        """
        now = time.monotonic()
        if not to_arm:
            self._since = now
        return now - self._since > LATELY

    def _on_command(self, data: bytes) -> None:
        if self._bytes in data:
            return
        now = time.monotonic()
        if now - self._last > LATELY:
            self._first = now
        self._last = now
        mark = _MARK.search(data)
        later = mark is not None and int(mark[1]) > self._start
        # An elder may be heard late; much later it is no compensator but its recording.
        young = now - self._commanding_since < _INTRODUCTION
        self.elder = mark is not None and not later and young
        commanding = self._commanding_since < math.inf
        if later and commanding and now - self._first < PATIENCE:
            return
        self._heard()
