"""Who the arm is, seen from its topics: one that measures, and listens when told to hold."""

from __future__ import annotations

import math
import time

from rclpy.node import Node

from dvrk_gravity.ros.hold import TOPIC as HOLD
from dvrk_gravity.ros.hold import hears
from dvrk_gravity.ros.others import LATELY, named, node_names

MEASURED = "measured_js"

# Who is who is asked so often, s, even where the numbers of publishers and subscribers stay.
_LOOK = 1.0


class Presence:
    """Watches who publishes ``measured_js`` and who subscribes to ``hold``.

    The arm is who publishes ``measured_js``; a hold that this node does not subscribe to reaches
    nobody. A controller of ros2_control knows no hold: there, anybody who subscribes to it and does
    not publish it (as watchdogs do) may be the one that holds the arm.
    """

    def __init__(self, node: Node, any_subscriber: bool) -> None:
        """Watch the topics of ``node``'s namespace.

        Args:
            node: The node.
            any_subscriber: Whoever subscribes to ``hold`` counts as the arm.
        """
        self._node, self._any_subscriber = node, any_subscriber
        self._measured = node.resolve_topic_name(MEASURED)
        self._hold = node.resolve_topic_name(HOLD)
        self._counts, self._looked = (0, 0), -math.inf
        self._listens = False
        self._number = 0  # of the last message, as its publisher counts them
        self._mixed = -math.inf

    def is_there(self) -> bool:
        """Tell whether somebody publishes ``measured_js``."""
        return self._node.count_publishers(self._measured) > 0

    def elsewhere(self) -> list[str]:
        """Return topics of that name that somebody publishes in other namespaces."""
        topics = (name for name, _ in self._node.get_topic_names_and_types())
        found = {name for name in topics if name.rsplit("/", 1)[-1] == MEASURED}
        return sorted(
            name for name in found - {self._measured} if self._node.count_publishers(name)
        )

    def listens(self) -> bool:
        """Tell whether the arm subscribes to ``hold``; cheap as long as nobody comes or goes."""
        node = self._node
        counts = node.count_publishers(self._measured), node.count_subscribers(self._hold)
        now = time.monotonic()
        if counts != self._counts or not self._listens or now - self._looked > _LOOK:
            self._counts, self._looked = counts, now
            subscriptions = node.get_subscriptions_info_by_topic(self._hold)
            listeners = node_names(info for info in subscriptions if hears(info))
            listeners.discard(node.get_fully_qualified_name())
            if self._any_subscriber:
                arms = listeners - node_names(node.get_publishers_info_by_topic(self._hold))
            else:
                arms = node_names(node.get_publishers_info_by_topic(self._measured))
            self._listens = bool(listeners & arms)
        return self._listens

    def no_hold_reason(self) -> str:
        """Return what to tell a person where the arm does not subscribe to ``hold``."""
        if self._any_subscriber:
            return f"nobody subscribes to {self._hold}: the arm could not be held when it must be"
        who = named(self._node.get_publishers_info_by_topic(self._measured), self._node)
        return f"the arm{who} does not subscribe to {self._hold}: it could not be held when it must"

    def count(self, number: int | None) -> bool:
        """Take a message's publication number; tell whether several publish ``measured_js``.

        Every publisher counts its own messages: of two, one is behind the other.
        """
        if number is None:  # this middleware does not count
            return False
        mixed = number <= self._number
        if mixed:
            self._mixed = time.monotonic()
        self._number = number
        return mixed

    def two_measure(self) -> str:
        """Return who published ``measured_js`` a moment ago if there were several, else ``""``."""
        if time.monotonic() - self._mixed > LATELY:
            return ""
        who = named(self._node.get_publishers_info_by_topic(self._measured), self._node)
        return f"several nodes{who} publish {self._measured}: stop all but the arm"
