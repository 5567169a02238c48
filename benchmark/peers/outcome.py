"""What the methods made of the cases."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

US = "dvrk_gravity"
METHODS = (US, "least squares", "figaroh", "figaroh LMI", "mujoco.sysid")


@dataclass
class Outcome:
    """What a method made of a case.

    Attributes:
        errors: (n,) held-out error over torque, RMS below 8 Hz.
        known: RMS error of the torque without sensors over that torque, mean of joints.
        holding: The same of the torque that holds the arm.
        cpu: Processor seconds of the process up to the fit, start-up included.
        gib: Peak memory; NaN where it was not measured.
        held: Intervals that hold the truth, and how many are finite, and how many there are.
        bodies: Physically consistent links, and how many there are.
        without_bodies: Why there are none.
        diagnoses: One for each further recording: time and what was found.
        failure: Why there is nothing.
    """

    errors: list[float] = field(default_factory=list)
    known: float | None = None
    holding: float | None = None
    cpu: float = float("nan")
    gib: float = float("nan")
    held: tuple[int, int, int] = (0, 0, 0)
    bodies: tuple[int, int] = (0, 0)
    without_bodies: str = ""
    diagnoses: list[dict[str, Any]] = field(default_factory=list)
    failure: str = ""


@dataclass
class Row:
    """A case with what every method made of it.

    Attributes:
        name: Of the case.
        what: One line about it.
        joints: Their names.
        hidden: Effect and joint in each further recording.
        outcomes: By method.
    """

    name: str
    what: str
    joints: list[str]
    hidden: list[tuple[str, str]]
    outcomes: dict[str, Outcome]
