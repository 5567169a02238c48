"""Notices that somebody else commands the arm.

A publisher alone proves nothing: crtk clients have one for every command and most never use it.
What counts is a command that is not ours, which is told from ours by the mark that ours bear.
Of two compensators the one that started later gives way: marks tell when. It hears the other before
it commands itself, unless both start together or DDS, which may know of a publisher for seconds
before it delivers, brings them together late.

Nothing is listened to while we command and no other publisher exists: hearing all of our own
commands costs as much as taking the measurements does.
"""

from __future__ import annotations

import math
import re
import secrets
import time
from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, ReliabilityPolicy

from dvrk_gravity.ros.others import LATELY, named

LISTEN = LATELY
"""How long nothing must have been heard before we command, s."""

PATIENCE = 1.0
"""How long another compensator that started later is given to notice us and to stop, s."""

_INTRODUCTION = 4.0
"""So late, s, DDS may bring another together with us: lost greetings it repeats after 3 s."""

# Between two looks of the executor our own commands fill ten places at 1 kHz: none must be lost.
_DEPTH = 100

_MARK = re.compile(rb"[0-9a-f]{8} since ([0-9]{20})")


class Rivals:
    """Listens on the topic of our own commands.

    Attributes:
        mark: Text that every command of ours bears, and nobody else's does.
        elder: What was heard last comes from a compensator that started before us.
    """

    def __init__(
        self,
        node: Node,
        publisher: Publisher,
        heard: Callable[[], None],
        reliability: ReliabilityPolicy,
    ) -> None:
        """Listen from now on.

        Args:
            node: The node.
            publisher: Publishes our commands.
            heard: Called for every command that is not ours.
            reliability: That with which the arm listens.
        """
        self._profile = QoSProfile(depth=_DEPTH, reliability=reliability)
        self._start = time.time_ns()
        name = node.get_fully_qualified_name()
        self.mark = f"{name} {secrets.token_hex(4)} since {self._start:020d}"
        self._bytes = self.mark.encode()
        self._node, self._publisher, self._heard = node, publisher, heard
        self._subscription: Any = None
        self._last = -math.inf  # when a command was heard, and the first of those in a row
        self._first = -math.inf
        self.elder = False
        self._commanding, self._commanding_since = False, -math.inf
        self._since = time.monotonic()
        self._others = False
        self.watch(commanding=False)

    @property
    def topic(self) -> str:
        """The commands' topic."""
        return self._publisher.topic_name

    def watch(self, commanding: bool) -> None:
        """Listen where there may be something to hear; to be called now and then."""
        others = self._node.count_publishers(self.topic) > 1
        if others and not self._others:
            self._since = time.monotonic()  # it may just not have been heard yet
        if commanding and not self._commanding:
            self._commanding_since = time.monotonic()
        self._others, self._commanding = others, commanding
        wanted = others or not commanding
        if wanted and self._subscription is None:
            self._subscription = self._node.create_subscription(
                self._publisher.msg_type, self.topic, self._on_command, self._profile, raw=True
            )
        elif not wanted and self._subscription is not None:
            self._node.destroy_subscription(self._subscription)
            self._subscription = None

    def listened(self, to_arm: bool) -> bool:
        """Tell whether others have had the time to be heard.

        Args:
            to_arm: The arm is there. Before DDS has found the arm, it has not found others
                either, and silence means nothing.
        """
        now = time.monotonic()
        if not to_arm:
            self._since = now
        return now - self._since > LISTEN

    def heard_lately(self) -> bool:
        """Tell whether a command that is not ours has just come."""
        return time.monotonic() - self._last < LISTEN

    def reason(self) -> str:
        """Return what to tell a person who wonders why the arm is not commanded."""
        who = named(self._node.get_publishers_info_by_topic(self.topic), self._node)
        return f"another node{who} commands {self.topic}: stop it first, two would fight"

    def _on_command(self, data: bytes) -> None:
        if self._bytes in data:
            return
        now = time.monotonic()
        if now - self._last > LISTEN:
            self._first = now
        self._last = now
        mark = _MARK.search(data)
        later = mark is not None and int(mark[1]) > self._start
        # One that we hear late is an elder; much later it is no compensator but its recording.
        young = not self._commanding or now - self._commanding_since < _INTRODUCTION
        self.elder = mark is not None and not later and young
        if later and self._commanding and now - self._first < PATIENCE:
            return
        self._heard()
