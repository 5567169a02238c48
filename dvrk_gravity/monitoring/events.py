"""What a monitor reports: pushes, changes with their cause, drift, and what it has no name for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from dvrk_gravity.effects import Estimate

Kind = Literal["push", "change", "drift", "unexplained"]


@dataclass(frozen=True)
class Event:
    """Something that the model does not expect.

    Attributes:
        kind: ``push``: from outside, and over; ``change``: of the arm, with a cause; ``drift``: a
            torque that grows while nothing moves; ``unexplained``: it lasts, and no cause fits.
        onset: When it began, s.
        reported: When that was known, s.
        joints: Names of the joints, the most affected one first.
        effect: Name of the cause in the vocabulary; ``""``: none.
        place: Form or site of the cause.
        end: When it was over, s; ``None``: it lasts.
        values: Parameters of the cause; of a push its largest torque at each joint, N·m, whose
            interval is not known.
        certainty: ``perhaps`` where other causes explain it as well.
        alternatives: Effect and joints of these.
        impulse: Of a push: integral of the torque's norm, N·m·s.
    """

    kind: Kind
    onset: float
    reported: float
    joints: tuple[str, ...]
    effect: str = ""
    place: str = ""
    end: float | None = None
    values: Mapping[str, Estimate] = field(default_factory=dict)
    certainty: Literal["certain", "perhaps"] = "certain"
    alternatives: tuple[tuple[str, tuple[str, ...]], ...] = ()
    impulse: float | None = None
