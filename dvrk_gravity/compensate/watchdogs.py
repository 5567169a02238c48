"""Which watchdog holds the arm if the compensator dies, without ROS."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass

UNWATCHED = "nothing will hold the arm if this node dies"
"""What a compensator says that commands without a watchdog."""

SAME_TOPIC = (
    "start watchdog and compensator with the same namespace, output, output_topic and remappings"
)
SILENCE = 5.0
"""A watchdog that has said nothing for so long watches nothing, s: it says what it does every
second. Chosen: a busy machine stalls for less."""

NOT_YET = "the watchdog has not said yet what it watches"
NONE_YET = "no watchdog yet (await_watchdog 0 does without)"


@dataclass(frozen=True)
class WatchdogStatus:
    """What one watchdog does; topics by their full names.

    Attributes:
        node: Its full name.
        topic: Topic of the commands that it watches.
        hold: Topic on which it sends a hold.
        timeout: Silence after which it does, s.
        heard: The publishers whose commands would reach it, by the numbers that DDS gives them. A
            name would not do: the publisher of a killed node is remembered for a while.
    """

    node: str
    topic: str
    hold: str
    timeout: float
    heard: frozenset[str] = frozenset()

    def values(self) -> dict[str, str]:
        """Return all but the node, in words, as the watchdog publishes them."""
        return {
            "topic": self.topic,
            "hold": self.hold,
            "timeout s": repr(self.timeout),
            "heard": " ".join(sorted(self.heard)),
        }

    @classmethod
    def of(cls, node: str, values: Mapping[str, str]) -> WatchdogStatus | None:
        """Return what published values say, ``None``: they are not a watchdog's."""
        try:
            topic, hold, timeout = values["topic"], values["hold"], float(values["timeout s"])
            heard = frozenset(values["heard"].split())
        except (KeyError, ValueError):
            return None
        return cls(node, topic, hold, timeout, heard) if 0.0 < timeout < math.inf else None


class Watchdogs:
    """The watchdogs in a compensator's namespace, by what they say of themselves."""

    def __init__(self, topic: str, hold: str, appear: float = -math.inf) -> None:
        """Expect one that watches commands on ``topic`` and sends its holds to ``hold``.

        Args:
            topic: Ours.
            hold: Of our arm.
            appear: Until then one that is there may have to be discovered: DDS repeats lost
                greetings after 3 s.
        """
        self._topic, self._hold, self._appear = topic, hold, appear
        self._own: Collection[str] = ()  # our publishers there
        # What each has said last, by name, and when, s of a monotonic clock.
        self._said: dict[str, tuple[WatchdogStatus, float]] = {}
        self._present: Collection[str] = ()

    def note(self, status: WatchdogStatus, now: float) -> None:
        """Note what a watchdog says: it replaces what one of that name said before."""
        self._said[status.node] = status, now

    def look(self, present: Collection[str], own: Collection[str]) -> None:
        """Note the full names of the watchdogs that are there, and our publishers by number.

        What one has said that is gone does not hold for another one of its name. What is published
        may arrive before its publisher is known.
        """
        for name in set(self._present).difference(present):
            self._said.pop(name, None)
        self._present, self._own = present, own

    def _known(self) -> list[WatchdogStatus]:
        return [self._said[name][0] for name in sorted(self._present) if name in self._said]

    def _own_watchdogs(self) -> list[WatchdogStatus]:
        return [
            each for each in self._known() if (each.topic, each.hold) == (self._topic, self._hold)
        ]

    def unwatched_reason(self, now: float) -> str:
        """Return for a person that no watchdog watches our commands, ``""``: one does."""
        ours = self._own_watchdogs()
        speaking = [each for each in ours if now - self._said[each.node][1] < SILENCE]
        if speaking:
            return (
                "" if self._hears_us(speaking) else f"{self._deaf_reason(speaking[0])}: {UNWATCHED}"
            )
        if ours:
            return f"the watchdog {ours[0].node} has been silent for {SILENCE:g} s: {UNWATCHED}"
        return f"no watchdog watches {self._topic}: {UNWATCHED}"

    def _hears_us(self, among: Iterable[WatchdogStatus]) -> bool:
        return bool(self._own) and any(each.heard.issuperset(self._own) for each in among)

    def _deaf_reason(self, watchdog: WatchdogStatus) -> str:
        return f"the watchdog {watchdog.node} does not hear our commands on {self._topic} yet"

    def timeout_conflict(self, timeout: float) -> str:
        """Return why our ``timeout``, s, is longer than our watchdog allows, ``""``: it is not."""
        shortest = min((each.timeout for each in self._own_watchdogs()), default=math.inf)
        if timeout <= shortest:
            return ""
        return (
            f"the watchdog holds the arm after {shortest:g} s without a command, "
            f"sooner than timeout ({timeout:g} s): raise watchdog_timeout or lower timeout"
        )

    def obstacle(self, timeout: float, now: float, active: bool) -> str:
        """Return why the arm must not be commanded, ``""``: it may; ``timeout`` is ours, s.

        Without any watchdog it may: see :meth:`unwatched_reason`. One that has not spoken yet, or
        that our first commands would not reach yet, is waited for, unless the arm is commanded
        already: what it publishes may arrive seconds after it.
        """
        others, ours = self._known(), self._own_watchdogs()
        if ours and not active and not self._hears_us(ours):
            return self._deaf_reason(ours[0])
        if ours:
            return self.timeout_conflict(timeout)
        if others:
            other = others[0]
            return (
                f"the watchdog {other.node} watches {other.topic} and sends hold to {other.hold}, "
                f"we command {self._topic} and the arm holds at {self._hold}: {SAME_TOPIC}"
            )
        if active or not (self._present or now < self._appear):
            return ""
        return NOT_YET if self._present else NONE_YET


def unseen_commands(topic: str, commands: Mapping[str, Collection[str]]) -> str:
    """Return for a person whose commands a watchdog of ``topic`` does not see, ``""``: nobody's.

    ``commands`` has the command topics of each compensator in its namespace, by the node's name.
    """
    elsewhere = {node: topics for node, topics in commands.items() if topics}
    if not elsewhere or any(topic in topics for topics in elsewhere.values()):
        return ""
    node = min(elsewhere)
    return (
        f"nobody commands {topic}, which is watched here: {node} commands "
        f"{', '.join(sorted(elsewhere[node]))}, and nothing will hold the arm if it dies: "
        f"{SAME_TOPIC}"
    )
