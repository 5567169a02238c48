"""Long recordings: checked in overlapping pieces, and excerpts of them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.recording.checks import check_counts, check_motion, check_signals, in_order
from dvrk_gravity.recording.data_warning import DataWarning, Kind, Note, require_usable
from dvrk_gravity.recording.limits import STILL
from dvrk_gravity.recording.recording import Recording
from dvrk_gravity.recording.samples import join
from dvrk_gravity.recording.stream import RecordingFile, blocks

# One piece is enough for these kinds; others must hold in most of the time.
ONCE: tuple[Kind, ...] = ("gaps", "effort_saturation", "effort_frozen")
_MAJORITY = 0.5  # part of the samples of pieces in which the joint moves
MOST_SAMPLES = 600_000  # of a recording that is held in memory whole: ten minutes at 1 kHz
CHECKED = 60_000  # samples that are checked at a time


@dataclass(frozen=True, eq=False)
class Piece:
    """A block of a recording with samples of its neighbours on either side.

    Attributes:
        recording: Block and margins.
        first: First row of the block.
        stop: Row after its last.
    """

    recording: Recording
    first: int
    stop: int


def with_margins(parts: Iterable[Recording], margin: int) -> Iterator[Piece]:
    """Yield blocks with ``margin`` samples of the one before and the one after."""
    before: Recording | None = None
    current: Recording | None = None
    for after in chain(parts, (None,)):
        if current is not None:
            around = [current]
            first = 0
            if before is not None:
                around.insert(0, before.rows(slice(-margin, None)))
                first = len(around[0])
            if after is not None:
                around.append(after.rows(slice(0, margin)))
            yield Piece(join(around), first, first + len(current))
        before, current = current, after


class Findings:
    """Findings of the checks about a recording that is checked piece by piece."""

    def __init__(self) -> None:
        """Begin before the first piece."""
        self._samples: list[int] = []
        self._found: list[tuple[DataWarning, ...]] = []
        self._ranges: list[Array] = []
        self._notes: list[Note] = []

    def add(self, piece: Piece, notes: Iterable[Note]) -> None:
        """Check a piece with the reader's notes; raise ``RecordingError`` if it is unusable."""
        # The interval from the block before belongs to this one.
        block = piece.recording.rows(slice(max(piece.first - 1, 0), piece.stop))
        found = check_signals(block)
        require_usable(block.source, found)
        self._samples.append(piece.stop - piece.first)
        self._found.append(found)
        self._ranges.append(np.array([block.position.min(axis=0), block.position.max(axis=0)]))
        self._notes += notes

    def merged(self, recording: Recording) -> tuple[DataWarning, ...]:
        """Return the findings about the whole, of which ``recording`` is any part.

        Raises:
            RecordingError: If nothing moves.
        """
        ranges = np.array(self._ranges)
        whole = ranges[:, 1].max(axis=0) - ranges[:, 0].min(axis=0)
        samples = np.array(self._samples)
        motion = check_motion(recording, whole, self._notes)
        require_usable(recording.source, motion)
        moved = ranges[:, 1] - ranges[:, 0] > STILL * recording.scale
        found = [*check_counts(int(samples.sum()), self._notes), *motion]
        for (kind, joint), holders in self._by_kind().items():
            counts = moved[:, recording.joint(joint)] if joint else moved.any(axis=1)
            weight = samples * (counts if counts.any() else 1)
            if kind not in ONCE and weight[list(holders)].sum() < _MAJORITY * weight.sum():
                continue
            worst = holders[max(holders, key=lambda index: samples[index])]
            if len(samples) > 1:
                text = f"{worst.text} (so in {len(holders)} of {len(samples)} pieces)"
                worst = replace(worst, text=text)
            found.append(worst)
        return in_order(found)

    def _by_kind(self) -> dict[tuple[Kind, str | None], dict[int, DataWarning]]:
        """Return the findings by kind and joint, and by piece."""
        found: dict[tuple[Kind, str | None], dict[int, DataWarning]] = {}
        for index, warnings in enumerate(self._found):
            for warning in warnings:
                found.setdefault((warning.kind, warning.joint), {})[index] = warning
        return found


@dataclass(frozen=True)
class Excerpt:
    """A recording, or a few stretches of one that is too long.

    Attributes:
        stretches: The whole recording, or parts of it in order, read on iteration.
        warnings: Findings about the whole; ``None`` if that is the only stretch, and not checked.
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
            f"{kept / 60.0:.3g} of {(end - start) / 60.0:.3g} min are analysed: {most} stretches, "
            "evenly spread"
        )
        warnings = (DataWarning("excerpt", None, numbers, text), *warnings)
    return Excerpt(_between(source.parts(), edges[chosen], edges[chosen + 1]), warnings)


def loaded_if_short(source: Recording | RecordingFile, longest: float) -> Recording | RecordingFile:
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


def _between(parts: Iterable[Recording], starts: Array, stops: Array) -> Iterator[Recording]:
    """Yield stretches of time, s, that do not overlap, from consecutive parts; not empty ones."""
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
