"""The order of joints in which an arm takes commands, without ROS.

A controller's array has no names, and a console ignores them: each takes the k-th number for its
k-th joint.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from dvrk_gravity.errors import ConfigError

STATEMENT = "command_joints"
"""The parameter that states the order."""

PATIENCE = 2.0
"""A node that has not answered for so long cannot be asked, s. Chosen: ROS answers in
milliseconds, and a node on a busy machine in tenths of a second."""

BECOMES_KNOWN = 0.3
"""A node that has just appeared is not asked for so long, s: that it is a watchdog, which access
policies let nobody ask, becomes known apart from its subscription. Chosen: on an idle machine
both are known within some milliseconds."""


def stated_order(joints: Sequence[str], stated: str) -> tuple[str, ...]:
    """Return the order that :data:`STATEMENT` states, ``()``: it states none.

    Raises:
        ConfigError: Not each of the model's ``joints`` once.
    """
    order = tuple(name.strip() for name in stated.split(",")) if stated.strip() else ()
    if order and sorted(order) != sorted(joints):
        raise ConfigError(STATEMENT, stated, f"each joint of the model once, as {_list(joints)}")
    return order


def order_mismatch(joints: Sequence[str], names: Sequence[str]) -> str:
    """Return why efforts of ``joints`` would reach others in the order of a message's ``names``.

    ``""``: they would not. Joints of another device behind the arm's own shift none.
    """
    places = [place for place, name in enumerate(names) if name in joints]
    between = [name for name in names[: places[-1]] if name not in joints]
    if not between:
        return ""
    ours = [names[place] for place in places]
    return (
        f"measured_js has {_list(names)}, we would command {_list(ours)}: a console that takes "
        f"efforts by index would apply them to other joints; publish {_list(between)} behind or "
        f"elsewhere, or state the order that it takes ({STATEMENT}:={_list(ours)})"
    )


class CommandSubscribers:
    """Who takes an array of efforts, and in which order of joints, as they answer.

    A subscriber is one subscription to the command topic. Times are seconds of a monotonic clock.
    """

    def __init__(self, topic: str, order: Sequence[str], stated: bool) -> None:
        """Expect them to take commands on ``topic`` in ``order``; ``stated``: by a person."""
        self._topic, self._order, self._stated = topic, tuple(order), stated
        self._nodes: Mapping[bytes, str] = {}
        self._since: dict[bytes, float] = {}
        self._answers: dict[bytes, tuple[str, ...]] = {}
        self._known: set[str] = set()  # nodes that have answered with an order

    def look(self, nodes: Mapping[bytes, str], now: float) -> None:
        """Note the subscribers that are there: their nodes' full names by subscription number."""
        self._nodes = nodes
        self._since = {subscriber: self._since.get(subscriber, now) for subscriber in nodes}
        self._answers = {
            subscriber: each for subscriber, each in self._answers.items() if subscriber in nodes
        }

    def unanswered(self) -> dict[bytes, str]:
        """Return the subscribers that have not answered, late ones included."""
        return {each: node for each, node in self._nodes.items() if each not in self._answers}

    def due_questions(self, now: float) -> dict[bytes, str]:
        """Return the unanswered ones that have been there for :data:`BECOMES_KNOWN`."""
        return {
            each: node
            for each, node in self.unanswered().items()
            if now - self._since[each] >= BECOMES_KNOWN
        }

    def answer(self, subscriber: bytes, joints: Sequence[str]) -> None:
        """Note the joints of a subscriber in its order, none: it has no such parameter."""
        if subscriber in self._nodes:
            self._answers[subscriber] = tuple(joints)
            if joints:
                self._known.add(self._nodes[subscriber])

    def obstacle(self, now: float, active: bool) -> str:
        """Return why the arm must not be commanded, ``""``: it may.

        In flight, one that comes later is waited for only where its node has answered before (a
        controller that starts again): others are recorders, which apply no commands.
        """
        agreed = False
        for subscriber, node in self._nodes.items():
            joints = self._answers.get(subscriber, ())
            if joints and joints != self._order:
                return self._mismatch(node, joints)
            agreed = agreed or bool(joints)
        pending = [
            node
            for subscriber, node in self.unanswered().items()
            if now - self._since[subscriber] < PATIENCE
        ]
        if active:
            pending = [node for node in pending if node in self._known]
        if pending:
            return f"{pending[0]} has not answered yet in which order it takes joints"
        if agreed or self._stated:
            return ""
        who = ", ".join(sorted({*self._nodes.values()})) or "nobody"
        return (
            f"{self._topic} is taken by {who}, who cannot be asked for the order of joints "
            f"(parameter joints): state it, {STATEMENT}:={_list(self._order)} if it is the model's"
        )

    def _mismatch(self, node: str, joints: Sequence[str]) -> str:
        out = f"{STATEMENT}:={_list(joints)}"
        if sorted(joints) != sorted(self._order):
            out = "give the controller the model's joints alone"
        return (
            f"{node} takes efforts of {_list(joints)}, we would command {_list(self._order)}: {out}"
        )


def _list(names: Sequence[str]) -> str:
    return ",".join(names)
