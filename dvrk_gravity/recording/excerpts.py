"""A few stretches, evenly spread, of a recording that is too long to be worked on whole."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from dvrk_gravity.recording.data import Recording
from dvrk_gravity.recording.data_warning import DataWarning
from dvrk_gravity.recording.pieces import Findings, Piece, blocks
from dvrk_gravity.recording.samples import join
from dvrk_gravity.recording.stream import RecordingFile

MOST_SAMPLES = 600_000  # of a recording that is held in memory whole: ten minutes at 1 kHz
CHECKED = 60_000  # samples that are checked at a time


@dataclass(frozen=True)
class Excerpt:
    """What is looked at of a recording.

    Attributes:
        stretches: The whole recording, or parts of it in order, read as they are asked for.
        warnings: What the checks find in the whole; ``None`` if that is the only stretch, and not
            checked yet.
    """

    stretches: Iterable[Recording]
    warnings: tuple[DataWarning, ...] | None


def excerpt(source: Recording | RecordingFile, longest: float, stretch: float) -> Excerpt:
    """Return a recording whole if it is short, else stretches of it; all of it is checked.

    Args:
        source: Trajectory or static poses, which are never cut.
        longest: Time that all stretches may last together, s.
        stretch: Length of one, s.

    Raises:
        RecordingError: If the recording cannot be read, or a check finds it unusable.
    """
    whole = _whole_if_short(source, longest)
    if whole is not None:
        return Excerpt((whole,), None)
    start, end = 0.0, 0.0
    findings, head = Findings(), None
    for block in blocks(source.parts(), CHECKED):
        findings.add(Piece(block, 0, len(block)), block.found)
        assert block.time is not None
        if head is None:
            head, start = block, float(block.time[0])
        end = float(block.time[-1])
    assert head is not None
    warnings = findings.merged(head)
    edges = np.linspace(start, np.nextafter(end, np.inf), 1 + int(np.ceil((end - start) / stretch)))
    total, most = len(edges) - 1, max(1, int(longest / stretch))
    chosen = np.arange(total)
    if total > most:
        chosen = ((np.arange(most) + 0.5) * total / most).astype(int)
        kept = len(chosen) * (end - start) / total
        numbers = {"duration_s": end - start, "used_s": kept, "stretches": float(most)}
        text = (
            f"{kept / 60.0:.3g} of {(end - start) / 60.0:.3g} min are looked at: {most} stretches, "
            "evenly spread"
        )
        warnings = (DataWarning("excerpt", None, numbers, text), *warnings)
    return Excerpt(_between(source.parts(), edges[chosen], edges[chosen + 1]), warnings)


def held_if_short(source: Recording | RecordingFile, longest: float) -> Recording | RecordingFile:
    """Return a recording in memory if :func:`excerpt` takes it whole: its file is read once."""
    whole = _whole_if_short(source, longest)
    return source if whole is None else whole


def _whole_if_short(source: Recording | RecordingFile, longest: float) -> Recording | None:
    held: list[Recording] = []
    count = 0
    for part in source.parts():
        held.append(part)
        count += len(part)
        first = held[0].time
        if first is None or part.time is None:
            continue
        if part.time[-1] - first[0] > longest or count > MOST_SAMPLES:
            return None
    return source if isinstance(source, Recording) else join(held)


def _between(
    parts: Iterable[Recording], starts: np.ndarray, stops: np.ndarray
) -> Iterator[Recording]:
    """Yield what consecutive parts hold of each of some stretches of time, s, that do not overlap.

    A stretch without a sample, in a gap, is left out.
    """
    held: list[Recording] = []
    index = 0
    for part in parts:
        assert part.time is not None
        while index < len(starts):
            first, last = np.searchsorted(part.time, [starts[index], stops[index]]).tolist()
            if last > first:
                held.append(part.rows(slice(first, last)))
            if last == len(part):  # it may go on in the next part
                break
            if held:
                yield join(held)
            held, index = [], index + 1
    if held:
        yield join(held)
