"""Duplicate recordings: a file that is given twice, or a copy of it.

Two measurements differ by their noise; recordings equal to the last bit are one. Counted twice it
would weigh double, and a motion would seem to repeat without noise.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from hashlib import blake2b

from dvrk_gravity.recording.notes import Note
from dvrk_gravity.recording.recording import Recording


def is_duplicate(recording: Recording, before: Iterable[Recording]) -> bool:
    """Return whether a recording's content equals that of one of others."""
    return _content(recording) in map(_content, before)


def without_duplicates(
    recordings: Sequence[Recording],
) -> tuple[list[Recording | None], tuple[Note, ...]]:
    """Return recordings, ``None`` for each that equals an earlier one, and warnings about these."""
    kept: list[Recording | None] = []
    warnings: list[Note] = []
    known = set[bytes]()
    for recording in recordings:
        content = _content(recording)
        if content in known:
            kept.append(None)
            warnings.append(_warning(recording))
        else:
            kept.append(recording)
        known.add(content)
    return kept, tuple(warnings)


def _warning(recording: Recording) -> Note:
    numbers = {"samples": len(recording), "share": 1.0}
    text = (
        f"{recording.source}: its {len(recording)} samples are exact duplicates of those of an "
        "earlier recording; it is skipped"
    )
    return Note("duplicate_samples", None, numbers, text)


def _content(recording: Recording) -> bytes:
    """Return a hash of times, positions, efforts and directions."""
    content = blake2b()
    for values in (recording.time, recording.position, recording.effort, recording.direction):
        content.update(b"none" if values is None else repr(values.shape).encode())
        if values is not None:
            content.update((values + 0.0).tobytes())  # -0 is 0
    return content.digest()
