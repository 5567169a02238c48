"""An executor that serves one subscription without delay, and the rest as rclpy does.

rclpy builds a wait set for every message, with two event handlers for each publisher and
subscription in it, and wraps the callback in a task: more than half of a relay's time, where this
was measured. Here one small wait set serves the subscription that matters, straight to its
callback, and timers. All else is checked a hundred times a second (every entity in a wait set costs
a microsecond or two in each wait, and a node that listens to all commands has many), and done by
rclpy's own executor.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

from rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

# All but the prompt subscription and timers is checked so often, s.
LOOK = 0.01
# An executor is woken so often, s: half of the shortest default time-out.
_WAKE = 0.05
# Messages of one subscription that are processed at a check.
_MOST = 100
_KINDS = ("subscription", "guard_condition", "client", "service")


def subscribe_raw(
    node: Node,
    kind: Any,
    topic: str,
    callback: Callable[[bytes, dict[str, Any]], None],
    profile: QoSProfile | int,
) -> Subscription:
    """Have messages called back as bytes, with the middleware's information on each."""
    of_both: Any = callback  # rclpy's types know callbacks of messages alone
    return node.create_subscription(kind, topic, of_both, profile, raw=True)


def arrived(subscription: Subscription, most: int) -> Iterator[tuple[Any, dict[str, Any]]]:
    """Yield messages that a subscription has received, and the middleware's information on each."""
    for _ in range(most):
        taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
        if taken is None:
            return
        yield taken


@contextlib.contextmanager
def keep_awake(executor: Executor) -> Iterator[None]:
    """Wake an executor now and then, by the monotonic clock.

    The middleware may wait on the wall clock, as Fast DDS does where it was built for a glibc
    before 2.30. If that clock is set back, a wait takes as much longer, and so do time-outs, unless
    a message comes.
    """
    ended = threading.Event()

    def wake() -> None:
        while not ended.wait(_WAKE):
            executor.wake()

    thread = threading.Thread(target=wake, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


class PromptNode(Node):
    """A node with one subscription that matters more than all else.

    Attributes:
        prompt: That subscription, once it exists; its callback takes a message and the middleware's
            information on it.
    """

    prompt: Subscription | None = None


class PromptExecutor(SingleThreadedExecutor):
    """Spins one node, its ``prompt`` subscription first.

    Events (a peer whose QoS does not fit, say) wake nothing here: they are found once a second.
    """

    def __init__(self, node: PromptNode) -> None:
        super().__init__()
        self.add_node(node)
        self._node = node
        # Of the prompt subscription, and of all entities, by their numbers.
        self._prompt_set = _rclpy.WaitSet(1, 1, 0, 0, 0, 0, self._context.handle)
        self._wait_sets: dict[tuple[int, ...], Any] = {}
        self._next_look = self._next_events = 0.0

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Wait for work, and do some of the prompt subscription and of the rest."""
        prompt = self._node.prompt
        longest = self._until_due(LOOK if timeout_sec is None else min(timeout_sec, LOOK))
        ready: list[int] = []
        if prompt is None:
            ready = self._wait(longest)
        elif self._wait_for_prompt(prompt, longest):
            taken = prompt.handle.take_message(prompt.msg_type, prompt.raw)
            if taken is not None:
                prompt.callback(*taken)
        for timer in list(self._node.timers):
            if timer.handle.is_timer_ready():
                timer.handle.call_timer()
                timer.callback()
        now = time.monotonic()
        if prompt is not None and now > self._next_look:
            self._next_look = now + LOOK  # after the answer, when none is due
            ready = [pointer for pointer in self._wait(0) if pointer != prompt.handle.pointer]
        if ready:
            self._take_others(ready)
        if ready or now > self._next_events:
            self._next_events = now + 1.0
            super().spin_once(0.0)

    def _until_due(self, timeout: float) -> int:
        """Return the time until a timer is due, ns, at most ``timeout`` seconds.

        In a wait set, timers would cost as much as the message that is waited for.
        """
        due = [timer.handle.time_until_next_call() for timer in self._node.timers]
        running = [time_left for time_left in due if time_left is not None]
        return max(0, min([int(timeout * 1e9), *running]))

    def _take_others(self, ready: list[int]) -> None:
        """Process messages of other subscriptions, and remove them from the list."""
        for subscription in list(self._node.subscriptions):
            if subscription is self._node.prompt or subscription.handle.pointer not in ready:
                continue
            ready.remove(subscription.handle.pointer)
            for message, _ in arrived(subscription, _MOST):
                subscription.callback(message)

    def _wait_for_prompt(self, prompt: Subscription, timeout: int) -> bool:
        """Wait at most some ns for a message, or to be woken; return whether a message is there."""
        wait_set = self._prompt_set
        wait_set.clear_entities()
        wait_set.add_subscription(prompt.handle)
        wait_set.add_guard_condition(self._guard.handle)
        wait_set.wait(timeout)
        return bool(wait_set.get_ready_entities("subscription"))

    def _wait(self, timeout: int) -> list[int]:
        """Return the handles of all entities but timers that are ready within some ns."""
        node = self._node
        # A destroyed one leaves these lists at once, so that no handle here is dead.
        entities = (
            [item.handle for item in node.subscriptions],
            [*(item.handle for item in node.guards), self._guard.handle],
            [item.handle for item in node.clients],
            [item.handle for item in node.services],
        )
        subscriptions, guards, clients, services = counts = tuple(map(len, entities))
        wait_set = self._wait_sets.get(counts)
        if wait_set is None:
            sizes = (subscriptions, guards, 0, clients, services, 0)
            wait_set = self._wait_sets[counts] = _rclpy.WaitSet(*sizes, self._context.handle)
        wait_set.clear_entities()
        for kind, handles in zip(_KINDS, entities, strict=True):
            add = getattr(wait_set, f"add_{kind}")
            for handle in handles:
                add(handle)
        wait_set.wait(timeout)
        if not self._context.ok():
            raise ExternalShutdownException
        ready = [pointer for kind in _KINDS for pointer in wait_set.get_ready_entities(kind)]
        # Being woken is no work: rclpy's check of every entity would cost a message or two.
        return [pointer for pointer in ready if pointer != self._guard.handle.pointer]
