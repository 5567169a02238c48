"""The watchdog's decision, without ROS: commands that stop without a hold."""

from __future__ import annotations


class CommandWatch:
    """Notices commands that have come and then stopped without a hold.

    Times are seconds of a monotonic clock.
    """

    def __init__(self, timeout: float) -> None:
        """Allow silences up to ``timeout``, s, between commands."""
        self._timeout = timeout
        self._last: float | None = None  # time of the last command; None: the arm is held

    @property
    def commanded(self) -> bool:
        """Whether the arm is under a command that no hold has ended."""
        return self._last is not None

    def note_command(self, now: float) -> bool:
        """Note a command; return whether it is the first one since the arm was held."""
        begins = self._last is None
        self._last = now
        return begins

    def note_hold(self) -> bool:
        """Note another node's hold; return whether it ended commands."""
        ended = self._last is not None
        self._last = None
        return ended

    def check(self, now: float) -> float:
        """Return the silence, s, for which the arm must be held now, 0: there is none.

        It is returned once: from then on the arm counts as held.
        """
        if self._last is None:
            return 0.0
        silence = now - self._last
        if silence <= self._timeout:
            return 0.0
        self._last = None
        return silence
