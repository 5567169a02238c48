"""What a user may have to know of recordings."""

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
class Note:
    """What a user may have to know of recordings: found in reading, or by a check.

    Attributes:
        kind: Its kind.
        joint: Name of the joint, or ``None`` if it concerns the whole recording.
        numbers: Figures by name; the unit ends the name where there is one. ``samples``: so many
            were left out.
        text: One line with the figures; of a reader's that left samples out, the reason.
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

    @property
    def left_out(self) -> int:
        """Samples that were left out for this reason."""
        return int(self.numbers.get("samples", 0))

    def of(self, total: int) -> Note:
        """Return a reader's note as one about a file of ``total`` samples."""
        count = self.left_out
        if not count:
            return self
        text = f"{count} of {total} samples {self.text}, left out"
        return replace(self, numbers={"samples": count, "share": count / total}, text=text)


def note(kind: Kind, text: str, joint: str | None = None, left_out: int = 0) -> Note:
    """Return a reader's note: a sentence, or the reason for which so many samples were left out."""
    return Note(kind, joint, {"samples": left_out} if left_out else {}, text)


def merged(notes: Iterable[Note]) -> tuple[Note, ...]:
    """Return each note once; counts of equal notes are added up."""
    found: dict[tuple[Kind, str, str | None], Note] = {}
    for each in notes:
        key = each.kind, each.text, each.joint
        before = found[key].left_out if key in found else 0
        found[key] = note(each.kind, each.text, each.joint, before + each.left_out)
    return tuple(found.values())


def require_usable(source: str, warnings: Iterable[Note]) -> None:
    """Raise ``RecordingError`` with the first warning that makes a recording unusable."""
    for warning in warnings:
        if warning.unusable:
            raise RecordingError(source, str(warning))


def about_arm(doubts: Iterable[str]) -> tuple[Note, ...]:
    """Return ``Arm.warnings`` about the masses in an arm's file as warnings."""
    text = "in the arm's file: "
    return tuple(Note("arm_file", None, {}, text + doubt) for doubt in doubts)


def labels(sources: Sequence[str]) -> tuple[str, ...]:
    """Return short distinct names of recordings: their files' names, or else the whole sources."""
    names = tuple(PurePath(source).name for source in sources)
    return names if len(set(names)) == len(names) else tuple(sources)


def about(number: int, sources: Sequence[str], warnings: Iterable[Note]) -> tuple[Note, ...]:
    """Return the warnings about recording ``number`` of several sources, labelled with its name."""
    if len(sources) == 1:
        return tuple(warnings)
    return tuple(replace(each, recording=labels(sources)[number]) for each in warnings)


def brief(warnings: Iterable[Note]) -> list[str]:
    """Return terminal lines: of like findings at several joints, the first and the joints' names.

    A report lists every one of them.
    """
    groups: dict[tuple[Kind, str, str], list[Note]] = {}
    for warning in warnings:
        key = warning.kind, warning.recording, "" if warning.joint else warning.text
        groups.setdefault(key, []).append(warning)
    lines = []
    for first, *others in groups.values():
        joints = ", ".join(dict.fromkeys(other.joint for other in others if other.joint))
        lines.append(f"{first}; also {joints}" if joints else str(first))
    return lines
