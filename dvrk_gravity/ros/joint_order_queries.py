"""Asks the controllers that take an array of efforts for the order of their joints."""

from __future__ import annotations

import math
import time
from collections.abc import Collection, Sequence
from typing import Any

from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import GetParameters
from rclpy.node import Node

from dvrk_gravity.compensate import CommandSubscribers
from dvrk_gravity.ros.foreign_commands import Endpoints

JOINTS = "joints"
"""The parameter in which controllers of ros2_control list their joints, in their order."""

# A question without an answer is sent again after so long, s: DDS may have known one way only.
_AGAIN = 0.5


class JointOrderQueries:
    """Knows in which order of joints the subscribers to a command topic take efforts.

    Questions are sent and answers fetched without waiting: see :meth:`look`.
    """

    def __init__(self, node: Node, topic: str, order: Sequence[str], stated: bool) -> None:
        """Expect subscribers to ``topic`` to take efforts in ``order``, which may be ``stated``."""
        self._node = node
        self._subscriptions = Endpoints(
            topic, node.count_subscribers, node.get_subscriptions_info_by_topic
        )
        self._subscribers = CommandSubscribers(topic, order, stated)
        # Clients, the questions that they have sent, and when.
        self._queries: dict[bytes, tuple[Any, Any, float]] = {}

    def look(self, active: bool, watchdogs: Collection[str]) -> str:
        """Return why the arm must not be commanded, ``""``: it may; to be called now and then.

        ``watchdogs`` are full names of nodes that subscribe to the topic and apply nothing.
        """
        now = time.monotonic()
        excluded = {self._node.get_fully_qualified_name(), *watchdogs}
        found = self._subscriptions.nodes(seldom=active).items()
        self._subscribers.look({each: name for each, name in found if name not in excluded}, now)
        for subscriber in self._queries.keys() - self._subscribers.unanswered().keys():
            self._forget(subscriber)
        for subscriber, name in self._subscribers.due_questions(now).items():
            self._ask(subscriber, name, now)
        return self._subscribers.obstacle(now, active)

    def _ask(self, subscriber: bytes, name: str, now: float) -> None:
        if subscriber not in self._queries:
            client = self._node.create_client(GetParameters, f"{name}/get_parameters")
            self._queries[subscriber] = client, None, -math.inf
        client, question, sent = self._queries[subscriber]
        if question is not None and question.done():
            values = question.result().values  # none: it has no such parameter
            listed = [v for v in values if v.type == ParameterType.PARAMETER_STRING_ARRAY]
            self._subscribers.answer(subscriber, listed[0].string_array_value if listed else ())
            self._forget(subscriber)
        elif now - sent > _AGAIN and client.service_is_ready():
            question = client.call_async(GetParameters.Request(names=[JOINTS]))
            self._queries[subscriber] = client, question, now

    def _forget(self, subscriber: bytes) -> None:
        self._node.destroy_client(self._queries.pop(subscriber)[0])
