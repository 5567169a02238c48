"""Typed findings about the data of a recording."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import PurePath
from types import MappingProxyType
from typing import Literal

Kind = Literal[
    "invalid_stamps",
    "repeated_stamps",
    "stamps_back",
    "unreadable",
    "other_messages",
    "not_finite",
    "impossible_readings",
    "cut_off",
    "not_recorded",
    "wrapped",
    "topic",
    "columns",
    "read_before",
    "stale_samples",
    "read_jitter",
    "time_jitter",
    "gaps",
    "samples_discarded",
    "velocity_mismatch",
    "velocity_factor",
    "wrong_clock",
    "effort_ripple",
    "effort_saturation",
    "effort_frozen",
    "position_quantisation",
    "velocity_quantisation",
    "effort_quantisation",
    "no_motion",
    "nothing_moves",
    "position_unit",
    "effort_unit",
    "position_jump",
    "exchanged_joints",
    "effort_sign",
    "time_unit",
    "coordinates",
    "arm_limits",
    "other_hand",
    "excerpt",
    "arm_file",
]


@dataclass(frozen=True)
class DataWarning:
    """One thing that is wrong with a recording.

    Attributes:
        kind: What it is.
        joint: Name of the joint, or ``None`` if it concerns the whole recording.
        numbers: Figures by name; the unit ends the name where there is one.
        text: One line with the figures.
        unusable: Whether nothing should be fitted to such data.
        recording: Which of several it is about; ``""`` of one.
    """

    kind: Kind
    joint: str | None
    numbers: Mapping[str, float]
    text: str
    unusable: bool = False
    recording: str = ""

    def __post_init__(self) -> None:
        """Make the figures read-only."""
        object.__setattr__(self, "numbers", MappingProxyType(dict(self.numbers)))

    def __str__(self) -> str:
        """Return ``file: joint: text``."""
        return ": ".join(part for part in (self.recording, self.joint, self.text) if part)


def about_arm(doubts: Iterable[str]) -> tuple[DataWarning, ...]:
    """Return warnings about the masses in an arm's file, of what ``Arm.doubts`` says of it."""
    text = "in the arm's file: "
    return tuple(DataWarning("arm_file", None, {}, text + doubt) for doubt in doubts)


def labels(sources: Sequence[str]) -> tuple[str, ...]:
    """Return what tells recordings apart: the files' names, or else their whole sources."""
    names = tuple(PurePath(source).name for source in sources)
    return names if len(set(names)) == len(names) else tuple(sources)


def about(
    number: int, sources: Sequence[str], warnings: Iterable[DataWarning]
) -> tuple[DataWarning, ...]:
    """Return warnings that say which of several recordings they are about.

    Args:
        number: Which of the sources it is.
        sources: Of all recordings.
        warnings: What was found in it.
    """
    if len(sources) == 1:
        return tuple(warnings)
    return tuple(replace(each, recording=labels(sources)[number]) for each in warnings)


def brief(warnings: Iterable[DataWarning]) -> list[str]:
    """Return the lines of a terminal: what is alike at several joints is said of the first.

    A report lists every one of them.
    """
    alike: dict[tuple[Kind, str, str], list[DataWarning]] = {}
    for warning in warnings:
        key = warning.kind, warning.recording, "" if warning.joint else warning.text
        alike.setdefault(key, []).append(warning)
    lines = []
    for first, *others in alike.values():
        joints = ", ".join(dict.fromkeys(other.joint for other in others if other.joint))
        lines.append(f"{first}; likewise {joints}" if joints else str(first))
    return lines
