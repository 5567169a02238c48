"""How far an arm was moved in a calibration, and how near its commands came to the limits."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class MotionTally:
    """How the arm was moved.

    Attributes:
        seconds: Time in motion, s: compensation included, rehearsals apart.
        rehearsed: Time in rehearsals, s.
        commands: Commands that were compared with the limits, at 1 kHz; none may leave them.
        used: Greatest part of a limit that a command used; 1 is at the limit.
        most: Which limit that was.
    """

    seconds: float
    rehearsed: float
    commands: int = 0
    used: float = 0.0
    most: str = ""

    def __add__(self, other: MotionTally) -> MotionTally:
        """Return the sum of times and commands, with the greater use of a limit."""
        most = max(self, other, key=lambda part: part.used)
        return MotionTally(
            self.seconds + other.seconds, self.rehearsed + other.rehearsed,
            self.commands + other.commands, most.used, most.most,
        )  # fmt: skip

    @classmethod
    def total(cls, parts: Iterable[Mapping[str, Any]]) -> MotionTally:
        """Return several as one, each as a logbook holds it: its attributes by name.

        Raises:
            TypeError: Other attributes, or no numbers.
        """
        return sum((cls(**part) for part in parts), cls(0.0, 0.0))
