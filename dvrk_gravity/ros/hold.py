"""A hold that reaches the arm: sent again until the arm has acknowledged it."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from rclpy.duration import Duration
from rclpy.node import Node
from std_msgs.msg import Empty

from dvrk_gravity.ros.presence import HOLD

# A hold that is not acknowledged is sent again after so long, s.
_AGAIN = 0.1
# Fast DDS asks for an acknowledgement at once only with a message that fills the publisher's
# history, otherwise every three seconds.
_DEPTH = 1
# Every hold is sent once more after so long, s. Topics have no order among each other: an arm may
# receive the last commanded effort after the hold that followed it, and keep it.
_LATE = 0.08
# A hold to an arm that is connected is repeated no longer than this, s. DDS waits for every
# subscriber, also for a recorder that stands still, and the arm is to obey others again.
_LONGEST = 1.0
# A node that ends waits so long for the acknowledgement, s.
_PATIENCE = 1.5


class Hold:
    """Publishes ``hold`` until the arm has received it.

    A hold while the arm holds does no harm; one that is lost leaves the arm with its last effort
    for ever.

    Attributes:
        pending: One has been sent, and is not yet acknowledged.
        missing: No node receives it.
    """

    def __init__(self, node: Node, arm_listens: Callable[[], bool]) -> None:
        """Create the publisher; ``arm_listens`` returns whether the arm subscribes to it."""
        self._node, self._arm_listens = node, arm_listens
        self._publisher = node.create_publisher(Empty, HOLD, _DEPTH)
        self.pending = self.missing = False
        self._last_word = False  # no command has followed
        self._first = self._last = 0.0
        self._connected_at = math.inf  # since when the arm has been connected at every sending
        self._echoes = 0

    def send(self) -> None:
        """Hold the arm."""
        self.pending = self._last_word = True
        self._first = time.monotonic()
        self._connected_at = math.inf
        self._publish()

    def drop(self) -> None:
        """Stop sending: the arm is commanded again, by us or by another node."""
        self.pending = self.missing = self._last_word = False

    def repeat(self) -> None:
        """Hold again, once, an arm that has stood still: it receives the backlog in any order."""
        if self._last_word:
            self.send()
            self._last_word = False

    def look(self) -> None:
        """Send it again where that is due; to be called now and then."""
        if not self.pending:
            return
        now = time.monotonic()
        acknowledged = self._acknowledged(0.0)
        twice = self._last >= self._connected_at + _LATE
        if twice and (acknowledged or now - self._connected_at >= _LONGEST):
            if not acknowledged:
                self._node.get_logger().warning(
                    "not all subscribers to hold have acknowledged it: check that the arm holds"
                )
            self.pending = self.missing = False
        elif now - self._last >= (_LATE if acknowledged else _AGAIN):
            self._publish()
        if self.missing:
            self._node.get_logger().error(
                f"no subscriber to hold for {now - self._first:.1f} s, still sending: the arm may "
                "keep its last effort",
                throttle_duration_sec=5.0,
            )

    def settle(self) -> bool:
        """Finish a pending hold before the node ends; return whether it is acknowledged."""
        if not self.pending:
            return True
        end = max(self._first + _PATIENCE, time.monotonic() + 0.5)
        acknowledged = False
        while time.monotonic() < end:
            twice = self._last >= self._connected_at + _LATE
            acknowledged = self._acknowledged(_LATE)
            if twice and acknowledged:
                break
            time.sleep(max(0.0, self._last + _LATE - time.monotonic()))
            self._publish()
        if not acknowledged:
            self._node.get_logger().error(
                "hold was not acknowledged: check that the arm holds, it may keep its last effort"
            )
        return acknowledged

    def is_echo(self) -> bool:
        """Return whether a received hold is one of ours."""
        if self._echoes == 0:
            return False
        self._echoes -= 1
        return True

    def _publish(self) -> None:
        self._last = time.monotonic()
        self._echoes += 1
        # A known subscriber may not be connected yet, and then gets only what is sent later.
        known = self._node.count_subscribers(self._publisher.topic_name)
        connected = self._publisher.get_subscription_count() >= known and self._arm_listens()
        self._connected_at = min(self._connected_at, self._last) if connected else math.inf
        self.missing = not connected
        self._publisher.publish(Empty())

    def _acknowledged(self, patience: float) -> bool:
        wait = Duration(nanoseconds=int(patience * 1e9))
        return not self.missing and self._publisher.wait_for_all_acked(wait)
