"""Findings about the data of a recording: of its reader (notes) and of its checks (warnings)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import PurePath
from types import MappingProxyType
from typing import Literal

from dvrk_gravity.errors import RecordingError, printable

Kind = Literal[
    "invalid_stamps", "repeated_stamps", "stamps_back", "unreadable", "other_messages",
    "second_publisher", "held_readings", "moving_topic",
    "not_finite", "impossible_readings", "cut_off", "not_recorded", "wrapped", "topic", "columns",
    "duplicate_samples", "stale_samples", "read_jitter", "time_jitter", "gaps", "samples_discarded",
    "velocity_mismatch", "velocity_factor", "wrong_clock", "effort_ripple", "effort_saturation",
    "effort_frozen", "effort_missing", "position_quantisation", "velocity_quantisation",
    "effort_quantisation", "no_motion", "nothing_moves", "position_unit", "effort_unit",
    "position_jump", "exchanged_joints", "effort_sign", "time_unit", "coordinates", "arm_limits",
    "other_hand", "excerpt", "arm_file",
    "held_joints", "effort_read", "drive_gains", "known_errors", "for_file", "no_bodies",
    "not_judged", "larger_errors", "misread",
]  # fmt: skip


@dataclass(frozen=True)
class DataWarning:
    """One fault of a recording.

    Attributes:
        kind: Its kind.
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
        return printable(": ".join(filter(None, (self.recording, self.joint, self.text))))


@dataclass(frozen=True)
class Note:
    """One observation of a reader.

    Attributes:
        kind: Its kind.
        text: A sentence; for samples that were left out, the reason.
        joint: Name of the joint, or ``None`` if it concerns the whole recording.
        count: Samples that were left out for this reason; 0: none were.
    """

    kind: Kind
    text: str
    joint: str | None = None
    count: int = 0

    def warning(self, total: int) -> DataWarning:
        """Return it as a finding about a file of ``total`` samples."""
        if not self.count:
            return DataWarning(self.kind, self.joint, {}, self.text)
        numbers = {"samples": self.count, "share": self.count / total}
        text = f"{self.count} of {total} samples {self.text}, left out"
        return DataWarning(self.kind, self.joint, numbers, text)


def merged(notes: Iterable[Note]) -> tuple[Note, ...]:
    """Return each note once; counts of equal notes are added up."""
    found: dict[tuple[Kind, str, str | None], Note] = {}
    for note in notes:
        key = note.kind, note.text, note.joint
        before = found[key].count if key in found else 0
        found[key] = replace(note, count=before + note.count)
    return tuple(found.values())


def require_usable(source: str, warnings: Iterable[DataWarning]) -> None:
    """Raise ``RecordingError`` with the first warning that makes a recording unusable."""
    for warning in warnings:
        if warning.unusable:
            raise RecordingError(source, str(warning))


def about_arm(doubts: Iterable[str]) -> tuple[DataWarning, ...]:
    """Return ``Arm.doubts`` about the masses in an arm's file as warnings."""
    text = "in the arm's file: "
    return tuple(DataWarning("arm_file", None, {}, text + doubt) for doubt in doubts)


def labels(sources: Sequence[str]) -> tuple[str, ...]:
    """Return short distinct names of recordings: their files' names, or else the whole sources."""
    names = tuple(PurePath(source).name for source in sources)
    return names if len(set(names)) == len(names) else tuple(sources)


def about(
    number: int, sources: Sequence[str], warnings: Iterable[DataWarning]
) -> tuple[DataWarning, ...]:
    """Return the warnings about recording ``number`` of several sources, labelled with its name."""
    if len(sources) == 1:
        return tuple(warnings)
    return tuple(replace(each, recording=labels(sources)[number]) for each in warnings)


def brief(warnings: Iterable[DataWarning]) -> list[str]:
    """Return terminal lines: of like findings at several joints, the first and the joints' names.

    A report lists every one of them.
    """
    groups: dict[tuple[Kind, str, str], list[DataWarning]] = {}
    for warning in warnings:
        key = warning.kind, warning.recording, "" if warning.joint else warning.text
        groups.setdefault(key, []).append(warning)
    lines = []
    for first, *others in groups.values():
        joints = ", ".join(dict.fromkeys(other.joint for other in others if other.joint))
        lines.append(f"{first}; also {joints}" if joints else str(first))
    return lines
