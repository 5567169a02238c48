"""The arm seen from its topics: its namespace, who measures it, whether it hears a hold."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable, Mapping
from typing import Any

from rclpy.exceptions import InvalidNamespaceException, InvalidTopicNameException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rclpy.validate_namespace import validate_namespace
from rclpy.validate_topic_name import validate_topic_name

from dvrk_gravity.arms import Arm
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files.resources import shipped
from dvrk_gravity.ros.foreign_commands import LATELY, node_names, publishers_of

try:  # built with the dVRK's own workspace
    from crtk_msgs.msg import OperatingState
except ImportError:
    OperatingState = None

MEASURED, HOLD = "measured_js", "hold"
_SIMULATED_HAND = "simulator/push_jf"  # our simulator subscribes to it; no arm does

# Nodes are looked up so often, s, even where the numbers of publishers and subscribers stay.
_LOOK = 1.0

# A publisher that latches the operating state shows it to a late subscriber; one that does not is
# not heard by a subscription that asks for that.
_OF_STATE = tuple(
    QoSProfile(depth=1, durability=durability)
    for durability in (DurabilityPolicy.VOLATILE, DurabilityPolicy.TRANSIENT_LOCAL)
)


def namespace_of(arm: Arm, given: str | None = None) -> str:
    """Return the given namespace, or the arm's default: ``/MTMR`` of mtmr.

    Raises:
        ConfigError: One that ROS does not accept, or another arm's.
    """
    by_name = re.sub(r"\W", "_", arm.name.upper(), flags=re.ASCII)
    namespace = f"/{(given or re.sub(r'^(?=[0-9])', '_', by_name)).strip('/')}"
    try:
        validate_namespace(namespace)
    except InvalidNamespaceException as error:
        raise ConfigError("--namespace", namespace, "a ROS namespace, as /MTMR") from error
    require_own(arm, namespace)
    return namespace


def simulator_of(node: Node) -> str:
    """Return the node of our simulator that measures in a node's namespace; ``""``: none does."""
    measures, is_pushed = (
        node_names(infos(node.resolve_topic_name(topic)))
        for infos, topic in (
            (node.get_publishers_info_by_topic, MEASURED),
            (node.get_subscriptions_info_by_topic, _SIMULATED_HAND),
        )
    )
    return min(measures & is_pushed, default="")


def busy_advice(node: Node) -> str:
    """Return all options that our simulator needs on a busy computer; ``""``: an arm measures.

    An arm gets no such advice: for so long it would keep its last torque.
    """
    simulator = simulator_of(node)
    return simulator and (
        f"if this computer is busy, as {simulator} is no arm, start the compensator with "
        "`-p timeout:=1.0 -p max_stamp_age:=0.0 -p resume:=automatic`, and the watchdog with "
        "`-p watchdog_timeout:=1.0`"
    )


def require_name(option: str, name: str) -> None:
    """Refuse what cannot be the name of a topic or an action.

    Raises:
        ConfigError: Naming the option.
    """
    try:
        validate_topic_name(name)
    except InvalidTopicNameException as error:
        raise ConfigError(option, name, "a ROS name, as /joint_states") from error


def require_own(arm: Arm, namespace: str) -> None:
    """Refuse a namespace that names another arm of a da Vinci than the commanded one.

    Its limits are another arm's: a left master driven as a right one passes its stops by 73 deg.
    Names of other arms prove nothing, nor does a namespace that names no arm.

    Raises:
        ConfigError: Such a namespace.
    """
    kinds = shipped("arms")
    last = namespace.rsplit("/", 1)[-1].lower()
    named = last if last in kinds else re.sub(r"[0-9]+$", "", last)  # PSM1, PSM2
    own = arm.name.lower()
    if own in kinds and named in kinds and named != own:
        expected = f"that of arm {own}, as /{own.upper()}: its limits and model fit no other arm"
        raise ConfigError("namespace", namespace, expected)


def on_operating_state(node: Node, report: Callable[[str], None]) -> None:
    """Call ``report`` with why the arm's ``operating_state`` forbids commands, ``""``: it does not.

    Does nothing where crtk_msgs is not installed.
    """
    for profile in () if OperatingState is None else _OF_STATE:
        node.create_subscription(
            OperatingState, "operating_state", lambda message: report(_obstacle(message)), profile
        )


def _obstacle(message: Any) -> str:
    if message.state != "ENABLED":
        return f"operating_state: the arm is {message.state}, expected ENABLED"
    if not message.is_homed:
        return "operating_state: the arm is not homed"
    return "operating_state: the arm is busy" if message.is_busy else ""


def receives_hold(subscription: TopicEndpointInfo) -> bool:
    """Return whether a subscription to ``hold`` receives it.

    One of another type gets nothing, nor does one that asks for messages sent before it came.
    """
    latched = subscription.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    return subscription.topic_type == "std_msgs/msg/Empty" and not latched


class Presence:
    """Watches who publishes ``measured_js`` and who subscribes to ``hold``.

    The arm is the publisher of ``measured_js``; a hold that this node does not subscribe to reaches
    nobody. A controller of ros2_control knows no hold: there, any node that subscribes to it and
    does not publish it (as watchdogs do) may be the one that holds the arm.
    """

    def __init__(self, node: Node, any_subscriber: bool) -> None:
        """Watch ``node``'s namespace, where ``any_subscriber`` to ``hold`` may be the arm."""
        self._node, self._any_subscriber = node, any_subscriber
        self._measured = node.resolve_topic_name(MEASURED)
        self._hold = node.resolve_topic_name(HOLD)
        self._counts, self._looked = (0, 0), -math.inf
        self._listens = False
        self._number = 0  # of the last message, as its publisher counts them
        self._mixed = -math.inf
        self._arms: set[bytes] = set()  # gids of publishers, when the arm was not commanded

    def is_there(self) -> bool:
        """Return whether a node publishes ``measured_js``."""
        return self._node.count_publishers(self._measured) > 0

    def other_namespaces(self) -> list[str]:
        """Return the published ``measured_js`` topics of other namespaces, by their full names."""
        topics = (name for name, _ in self._node.get_topic_names_and_types())
        found = {name for name in topics if name.rsplit("/", 1)[-1] == MEASURED}
        return sorted(
            name for name in found - {self._measured} if self._node.count_publishers(name)
        )

    def arm_hears_hold(self) -> bool:
        """Return whether the arm subscribes to ``hold``; cheap while no node comes or goes."""
        node = self._node
        counts = node.count_publishers(self._measured), node.count_subscribers(self._hold)
        now = time.monotonic()
        if counts != self._counts or not self._listens or now - self._looked > _LOOK:
            self._counts, self._looked = counts, now
            subscriptions = node.get_subscriptions_info_by_topic(self._hold)
            listeners = node_names(info for info in subscriptions if receives_hold(info))
            listeners.discard(node.get_fully_qualified_name())
            if self._any_subscriber:
                arms = listeners - node_names(node.get_publishers_info_by_topic(self._hold))
            else:
                arms = node_names(node.get_publishers_info_by_topic(self._measured))
            self._listens = bool(listeners & arms)
        return self._listens

    def no_hold_reason(self) -> str:
        """Return for a person that the arm does not subscribe to ``hold``."""
        if self._any_subscriber:
            return f"no node subscribes to {self._hold}: in a fault the arm could not be held"
        who = publishers_of(self._measured, self._node)
        return f"the arm{who} does not subscribe to {self._hold}: in a fault it could not be held"

    def note_message(self, info: Mapping[str, Any]) -> str:
        """Note a message by its information; return who publishes if several do, else ``""``.

        Every publisher counts its own messages: of two, one is behind the other.
        """
        number = info["publication_sequence_number"]
        if number is None:  # this middleware does not count
            return ""
        mixed, self._number = number <= self._number, number
        if not mixed:
            return ""
        self._mixed = time.monotonic()
        return self.publisher_conflict()

    def publisher_conflict(self) -> str:
        """Return who published ``measured_js`` a moment ago if several did, else ``""``."""
        if time.monotonic() - self._mixed > LATELY:
            return ""
        who = publishers_of(self._measured, self._node)
        if self._node.count_publishers(self._measured) == 1:
            return self._replaced(who)
        return f"several nodes{who} publish {self._measured}: stop all but the arm"

    def replaced_publisher(self, active: bool) -> str:
        """Return who publishes ``measured_js`` when the arm that we command has ceased, or ``""``.

        A publisher is known by its number in DDS, which no other one has, of whatever name and
        joints. Of several, of which all but one were silent, any may have been the arm. To be
        called a few times a second, also while the arm is not commanded: then any may measure.
        """
        infos = self._node.get_publishers_info_by_topic(self._measured)
        arms = {bytes(info.endpoint_gid) for info in infos}
        if not active:
            self._arms = arms
        if not arms or arms >= self._arms:
            return ""
        return self._replaced(publishers_of(self._measured, self._node))

    def _replaced(self, who: str) -> str:
        return f"another node than before{who} publishes {self._measured}: is it another arm?"
