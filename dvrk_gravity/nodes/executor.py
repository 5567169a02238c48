"""An executor that serves one subscription without delay, and the rest as rclpy does.

rclpy builds a wait set anew for every message, with two event handlers for each publisher and
subscription in it, and wraps the callback in a task: on the machine where this was measured, more
than half of a relay's time. Here one small wait set is kept for what can bring work; the message
for which the node is there goes straight to its callback, timers too, and for all else the wait
set only tells that there is something to do, which rclpy's own executor then does.
"""

from __future__ import annotations

import time
from typing import Any

from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.node import Node
from rclpy.subscription import Subscription

_KINDS = ("subscription", "guard_condition", "timer", "client", "service")


class PromptNode(Node):
    """A node with one subscription that matters more than all else.

    Attributes:
        prompt: That subscription; its callback takes a message and the middleware's information
            about it. ``None`` as long as it does not exist.
    """

    prompt: Subscription | None = None


class PromptExecutor(SingleThreadedExecutor):
    """Spins one node in which one subscription matters more than all else.

    Events (a peer whose QoS does not fit, say) wake nothing here: they are found once a second.
    """

    def __init__(self, node: PromptNode) -> None:
        """Spin ``node``, whose ``prompt`` is the subscription that is served first."""
        super().__init__()
        self.add_node(node)
        self._node = node
        self._counts: tuple[int, ...] = ()
        self._wait_set: Any = None
        self._next_look = 0.0

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Wait for work and do a piece of it: of the prompt subscription and of the rest."""
        ready = self._wait(0.1 if timeout_sec is None else timeout_sec)
        prompt = self._node.prompt
        if prompt is not None and prompt.handle.pointer in ready:
            ready.remove(prompt.handle.pointer)
            taken = prompt.handle.take_message(prompt.msg_type, prompt.raw)
            if taken is not None:
                prompt.callback(*taken)
        for timer in list(self._node.timers):
            if timer.handle.pointer in ready:
                ready.remove(timer.handle.pointer)
                if timer.handle.is_timer_ready():
                    timer.handle.call_timer()
                    timer.callback()
        if ready or time.monotonic() > self._next_look:
            self._next_look = time.monotonic() + 1.0
            super().spin_once(0.0)

    def _wait(self, timeout: float) -> list[int]:
        """Return the handles that are ready after at most ``timeout`` seconds."""
        node = self._node
        # A destroyed one leaves these lists at once, so that no handle here is dead.
        entities = (
            [item.handle for item in node.subscriptions],
            [*(item.handle for item in node.guards), self._guard.handle],
            [item.handle for item in node.timers],
            [item.handle for item in node.clients],
            [item.handle for item in node.services],
        )
        counts = tuple(map(len, entities))
        if counts != self._counts:
            self._counts = counts
            self._wait_set = _rclpy.WaitSet(*counts, 0, self._context.handle)
        wait_set = self._wait_set
        wait_set.clear_entities()
        for kind, handles in zip(_KINDS, entities, strict=True):
            add = getattr(wait_set, f"add_{kind}")
            for handle in handles:
                add(handle)
        wait_set.wait(int(timeout * 1e9))
        if not self._context.ok():
            raise ExternalShutdownException
        return [pointer for kind in _KINDS for pointer in wait_set.get_ready_entities(kind)]
