"""A long recording cut into overlapping pieces, and what was found in each of them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from dvrk_gravity.errors import RecordingError
from dvrk_gravity.recording.checks import (
    CheckSettings,
    check_counts,
    check_motion,
    check_signals,
    in_order,
)
from dvrk_gravity.recording.data import Recording
from dvrk_gravity.recording.data_warning import DataWarning, Kind
from dvrk_gravity.recording.notes import Note
from dvrk_gravity.recording.samples import join

# Found once is found; of the other kinds, most of the time must show it.
ONCE: tuple[Kind, ...] = ("gaps", "effort_saturation", "effort_frozen")


@dataclass(frozen=True)
class PieceSettings:
    """When what some pieces of a recording show holds for all of it.

    Attributes:
        most: Part of the samples of pieces in which the joint moves. Chosen: the majority.
    """

    most: float = 0.5


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


def blocks(parts: Iterable[Recording], size: int) -> Iterator[Recording]:
    """Yield consecutive parts of any length as blocks of ``size`` samples, the last one shorter."""
    held: list[Recording] = []
    count = 0
    for part in parts:
        held.append(part)
        count += len(part)
        while count > size:
            whole = join(held)
            yield whole.rows(slice(0, size))
            # Left-out samples were counted with the block.
            held = [whole.rows(slice(size, None)).counted()]
            count -= size
    if held:
        yield join(held)


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
    """What the checks find in a recording that is seen piece by piece."""

    def __init__(self) -> None:
        """Begin before the first piece."""
        self._samples: list[int] = []
        self._found: list[tuple[DataWarning, ...]] = []
        self._ranges: list[np.ndarray] = []
        self._notes: list[Note] = []

    def add(self, piece: Piece, notes: Iterable[Note]) -> None:
        """Check a piece, of which reading found what some notes say.

        Raises:
            RecordingError: If a finding makes the recording unusable.
        """
        # The interval from the block before belongs to this one.
        block = piece.recording.rows(slice(max(piece.first - 1, 0), piece.stop))
        found = check_signals(block)
        for warning in found:
            if warning.unusable:
                raise RecordingError(block.source, str(warning))
        self._samples.append(piece.stop - piece.first)
        self._found.append(found)
        self._ranges.append(np.array([block.position.min(axis=0), block.position.max(axis=0)]))
        self._notes += notes

    def merged(self, recording: Recording) -> tuple[DataWarning, ...]:
        """Return the findings of the whole; ``recording`` is any part of it.

        Raises:
            RecordingError: If nothing moves.
        """
        ranges = np.array(self._ranges)
        whole = ranges[:, 1].max(axis=0) - ranges[:, 0].min(axis=0)
        samples = np.array(self._samples)
        motion = check_motion(recording, whole)
        for warning in motion:
            if warning.unusable:
                raise RecordingError(recording.source, str(warning))
        moved = ranges[:, 1] - ranges[:, 0] > CheckSettings().still * recording.scale
        most = PieceSettings().most
        found = [*check_counts(int(samples.sum()), self._notes), *motion]
        for (kind, joint), holders in self._by_kind().items():
            counts = moved[:, recording.joint(joint)] if joint else moved.any(axis=1)
            weight = samples * (counts if counts.any() else 1)
            if kind not in ONCE and weight[list(holders)].sum() < most * weight.sum():
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
