"""What a check of a dVRK console's file found; rendered elsewhere."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum


class Severity(StrEnum):
    """How much a finding matters."""

    SERIOUS = "serious"
    WARNING = "warning"
    NOTE = "note"


@dataclass(frozen=True)
class ConsoleFinding:
    """One thing that is wrong, or worth knowing, about a console file.

    Attributes:
        code: Kind of the finding, one word.
        severity: How much it matters.
        subject: Joint or field.
        numbers: The numbers behind it, by name; the unit ends the name.
        text: All of it in one line.
    """

    code: str
    severity: Severity
    subject: str
    text: str
    numbers: Mapping[str, float] = field(default_factory=dict)
