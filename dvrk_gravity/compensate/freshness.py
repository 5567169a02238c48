"""Whether what is measured is of now: stamps move on as time does, and messages keep coming."""

from __future__ import annotations

import math
from dataclasses import dataclass

from dvrk_gravity.compensate.sample import DroppedSampleError


@dataclass(frozen=True)
class FreshnessSettings:
    """When stamps count as moving on.

    Attributes:
        least_pace: Part of the time that passes which they have to cover: simulated time may run
            at a tenth of real time; what is slower (nanoseconds a message, say) stands still for
            all that matters here.
    """

    least_pace: float = 0.1


SETTINGS = FreshnessSettings()


class Freshness:
    """Judges stamps against each other, against the clock, and against the time that passes.

    Times are seconds of a monotonic clock: a step of the wall clock or of simulated time neither
    hides stale input nor makes fresh input look stale.
    """

    def __init__(self) -> None:
        """Start with nothing received."""
        self._valid = -math.inf  # when the last message came whose stamp passed
        self._advance = -math.inf  # when the stamp last moved on
        self._advanced_to = -(2**63)  # what it moved on to
        self._stamp = 0  # of the last message that passed
        self._seen = 0  # of the last message, whether it passed or not
        self._advances = False  # the stamp that was judged last moves on

    def silence(self, now: float, timeout: float) -> str:
        """Return what has been missing for longer than ``timeout`` seconds, ``""``: nothing."""
        if now - self._valid > timeout:
            return f"no valid measured_js for {timeout:g} s"
        if now - self._advance > timeout:
            return f"the stamp of measured_js has not moved on for {timeout:g} s"
        return ""

    def judge(
        self, stamp: int, now: float, clock: int, timeout: float, oldest: float, active: bool
    ) -> tuple[float, float]:
        """Look at the stamp of a message; :meth:`accept` is to follow if all else is well, too.

        Args:
            stamp: Its stamp, ns.
            now: Monotonic time at which it came, s.
            clock: The node's clock, ns.
            timeout: Longest time without fresh input, s.
            oldest: How far the stamp may be from the clock, s; 0: not checked.
            active: The arm is under our command.

        Returns:
            Seconds since the message before it, and since the stamp last moved on before it.

        Raises:
            DroppedSampleError: The stamp disqualifies it.
        """
        known, self._seen = (self._stamp, self._seen), stamp
        if stamp < self._stamp:
            # Once nothing valid has come for long, the clock has been stepped for good.
            if active or now - self._valid <= timeout:
                late = (self._stamp - stamp) * 1e-9
                raise DroppedSampleError(
                    "stamp_backwards", f"stamp {late:.3f} s before the last one"
                )
            self._advanced_to = min(self._advanced_to, stamp)
        if oldest > 0.0:
            _compare(stamp, clock, oldest)
        step, gap = now - self._valid, now - self._advance
        due = SETTINGS.least_pace * min(gap, timeout)
        self._advances = stamp not in known and (stamp - self._advanced_to) * 1e-9 >= due
        if not self._advances and gap > timeout:
            self._valid = now
            raise DroppedSampleError("stamp_repeated", "the stamp does not move on")
        return step, gap

    def accept(self, stamp: int, now: float) -> None:
        """Count the message that was judged last as a valid one.

        Times count for messages that pass; a message that waited in a queue while the process or
        the arm stood still is the first after a gap, and is not answered.
        """
        self._valid, self._stamp = now, stamp
        if self._advances:
            self._advance, self._advanced_to = now, stamp


def _compare(stamp: int, clock: int, oldest: float) -> None:
    """Refuse a stamp that is too far from the clock."""
    age = (clock - stamp) * 1e-9
    if abs(age) <= oldest:
        return
    if clock == 0:
        raise DroppedSampleError(
            "no_clock", "use_sim_time is set, but nobody publishes the time on /clock"
        )
    cause, where = ("stamp_too_old", "old") if age > 0.0 else ("stamp_ahead", "ahead")
    raise DroppedSampleError(
        cause,
        f"stamp {abs(age):.3f} s {where} by this computer's clock, at most {oldest:g} s: stale "
        "data, or clocks of two computers that differ (max_stamp_age 0 leaves this unchecked)",
    )
