"""Stamps of a recording that is read part by part: increasing times, and what was left out."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.errors import RecordingError
from dvrk_gravity.recording.samples import Array, Samples


class Timeline:
    """Makes times relative to the first stamp, and leaves repeated stamps out.

    Attributes:
        start_ns: First stamp, ns, or ``None`` before there was one.
    """

    def __init__(self) -> None:
        """Begin before the first stamp."""
        self.start_ns: int | None = None
        self._previous = 0

    def advance(
        self, stamps: NDArray[np.int64], numbers: Sequence[int], where: str
    ) -> tuple[NDArray[np.bool_], Array]:
        """Take the stamps of the next part.

        Args:
            stamps: ``(N,)`` ns.
            numbers: Line or message numbers of the N, for errors.
            where: What goes before such a number in an error.

        Returns:
            Which of the N are later than the one before, and their times, s after ``start_ns``.

        Raises:
            RecordingError: If a stamp is earlier than the one before.
        """
        if not len(stamps):
            return np.zeros(0, dtype=bool), np.zeros(0)
        if self.start_ns is None:
            self.start_ns = int(stamps[0])
            self._previous = self.start_ns - 1
        steps = np.diff(stamps, prepend=self._previous)
        back = np.flatnonzero(steps < 0)
        if len(back):
            raise RecordingError(
                f"{where} {numbers[int(back[0])]}",
                f"time goes back by {-steps[back[0]] / 1e9:g} s, expected increasing times",
            )
        self._previous = int(stamps[-1])
        later = steps > 0
        return later, (stamps[later] - self.start_ns) / 1e9


def with_counts(parts: Iterable[tuple[Samples | None, int, int]]) -> Iterator[Samples]:
    """Yield the recordings among ``parts`` with their counts of invalid and repeated samples.

    What parts without a recording left out is counted with the next one, or at the end with the
    last, which is why every recording is held back until the next.
    """
    held: Samples | None = None
    invalid = repeated = 0
    for recording, part_invalid, part_repeated in parts:
        invalid += part_invalid
        repeated += part_repeated
        if recording is None:
            continue
        if held is not None:
            yield held
        held = replace(recording, invalid=invalid, repeated=repeated)
        invalid = repeated = 0
    if held is not None:
        yield replace(held, invalid=held.invalid + invalid, repeated=held.repeated + repeated)
