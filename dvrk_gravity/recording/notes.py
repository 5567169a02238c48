"""What reading a file found: samples that were left out, and what was taken for what."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

from dvrk_gravity.recording.data_warning import DataWarning, Kind


@dataclass(frozen=True)
class Note:
    """One thing that reading found.

    Attributes:
        kind: What it is.
        text: A sentence about it; of samples that were left out, what is wrong with them.
        joint: Name of the joint, or ``None`` if it concerns the whole recording.
        count: Samples that were left out for it; 0: none were.
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
    """Return notes each once; what was left out for the same reason is added up."""
    found: dict[tuple[Kind, str, str | None], Note] = {}
    for note in notes:
        key = note.kind, note.text, note.joint
        before = found[key].count if key in found else 0
        found[key] = replace(note, count=before + note.count)
    return tuple(found.values())
