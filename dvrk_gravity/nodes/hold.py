"""A hold that reaches the arm: sent again until the arm has acknowledged it."""

from __future__ import annotations

import time
from collections.abc import Callable

from rclpy.duration import Duration
from rclpy.node import Node
from std_msgs.msg import Empty

TOPIC = "hold"
_AGAIN = 0.1
"""A hold that is not acknowledged is sent again after so long, s."""

_DEPTH = 1
"""Fast DDS asks for an acknowledgement at once only with a message that fills the publisher's
history, otherwise every three seconds."""

_COMPLAIN = 1.0
"""A hold that is not acknowledged after so long is told as an error, s."""

_PATIENCE = 1.5
"""How long a node that ends waits for the acknowledgement, s."""


class Hold:
    """Publishes ``hold`` and sees to it that the arm gets it.

    A hold while the arm holds does no harm; one that nobody has received leaves the arm with its
    last effort for ever.

    Attributes:
        pending: One has been sent, and the arm has not acknowledged it.
    """

    def __init__(self, node: Node, arm_listens: Callable[[], bool]) -> None:
        """Create the publisher; ``arm_listens`` tells whether the arm subscribes to it."""
        self._node, self._arm_listens = node, arm_listens
        self._publisher = node.create_publisher(Empty, TOPIC, _DEPTH)
        self.pending = False
        self._first = self._last = 0.0
        self._addressed = False  # the arm was connected when the last one was sent
        self._echoes = 0

    def send(self) -> None:
        """Hold the arm."""
        self.pending = True
        self._first = time.monotonic()
        self._publish()

    def drop(self) -> None:
        """Leave it at that: the arm is commanded again, by us or by somebody else."""
        self.pending = False

    def look(self) -> None:
        """See whether it has arrived, and send it again if not; to be called now and then."""
        if not self.pending:
            return
        if self._arrived(0.0):
            self.pending = False
            return
        now = time.monotonic()
        if now - self._last >= _AGAIN:
            self._publish()
        if now - self._first >= _COMPLAIN:
            self._node.get_logger().error(
                f"hold has not been acknowledged for {now - self._first:.0f} s, sending it again "
                "and again: check that the arm holds",
                throttle_duration_sec=5.0,
            )

    def settle(self) -> bool:
        """Wait, before the node ends, until a pending hold has arrived; return whether it has."""
        end = time.monotonic() + _PATIENCE
        while self.pending and time.monotonic() < end:
            if self._arrived(_AGAIN):
                self.pending = False
            else:
                self._publish()
                time.sleep(0.01)
        if self.pending:
            self._node.get_logger().error(
                "hold was not acknowledged: check that the arm holds, it may keep its last effort"
            )
        return not self.pending

    def echo(self) -> bool:
        """Tell whether a hold that was heard is one of ours coming back."""
        if self._echoes == 0:
            return False
        self._echoes -= 1
        return True

    def _publish(self) -> None:
        self._last = time.monotonic()
        self._echoes += 1
        # Who is known to be there may not be connected yet, and gets what is sent after that only.
        known = self._node.count_subscribers(self._publisher.topic_name)
        connected = self._publisher.get_subscription_count() >= known
        self._addressed = connected and self._arm_listens()
        self._publisher.publish(Empty())

    def _arrived(self, patience: float) -> bool:
        wait = Duration(nanoseconds=int(patience * 1e9))
        return self._addressed and self._publisher.wait_for_all_acked(wait)
