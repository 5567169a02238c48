"""What a monitor reports: pushes, changes with their cause, drift, and what it has no name for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from dvrk_gravity.effects import Estimate

Kind = Literal["push", "change", "drift", "unexplained"]


@dataclass(frozen=True)
class Alternative:
    """A cause that explains an event as well as the one that it names.

    Attributes:
        effect: Its name in the vocabulary.
        joints: Names of its joints, the most affected one first.
        where: Its site in words.
    """

    effect: str
    joints: tuple[str, ...]
    where: str


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
        where: Site of the cause in words; ``""``: none.
        end: When it was over, s; ``None``: it lasts.
        values: Parameters of the cause; of a push its largest torque at each joint, N·m, whose
            interval is not known.
        certainty: ``perhaps`` where other causes explain it as well.
        alternatives: These.
        impulse: Of a push: integral of the torque's norm, N·m·s.
    """

    kind: Kind
    onset: float
    reported: float
    joints: tuple[str, ...]
    effect: str = ""
    where: str = ""
    end: float | None = None
    values: Mapping[str, Estimate] = field(default_factory=dict)
    certainty: Literal["certain", "perhaps"] = "certain"
    alternatives: tuple[Alternative, ...] = ()
    impulse: float | None = None
