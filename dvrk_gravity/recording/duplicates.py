"""Duplicate samples: a file given twice, a copy of it, a recording appended to itself.

Two measurements differ by their noise; samples equal to the last bit are one measurement. Counted
twice it would weigh double, and a motion would seem to repeat without noise.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from itertools import chain, pairwise

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arrays import Mask
from dvrk_gravity.recording.data_warning import DataWarning
from dvrk_gravity.recording.recording import Recording
from dvrk_gravity.recording.samples import join
from dvrk_gravity.recording.stream import RecordingFile

Hashes = NDArray[np.uint64]


_DURATION = 1.0  # s that must be equal, sample by sample. Chosen: noise makes no two samples equal
# Part of them that must differ from the sample before: samples at rest, or not renewed, are always
# equal. Chosen.
_CHANGING = 0.1
_MOST_LAGS = 100  # that are tried in one part. Chosen: recordings are copied a few times
# Samples of that time, at least, by which it is looked up. Chosen: none of them is found once in
# exp(16), for memory of an eighth or less.
_MARKS = 16
_LEAST = 2.0  # s left of a recording below which it is not used. Chosen: some lengths of the filter


class Duplicates:
    """Reads recordings one after the other, and leaves out duplicate samples.

    It remembers a 64-bit hash of position and effort of every sample, not the samples.

    Attributes:
        samples: Samples of the last recording.
        left_out: Spans [start, stop) of its rows that were left out.
        remaining: s that are left of it; infinite for static poses.
    """

    def __init__(self) -> None:
        """Begin before the first recording."""
        self._hashes: Hashes = np.zeros(1024, dtype=np.uint64)
        self._count = 0
        self._first: dict[int, int] = {}  # where a hash was read first, of some samples
        self._begin("", 0)

    def _begin(self, source: str, samples: int) -> None:
        self._source, self.samples = source, samples
        self.left_out: list[tuple[int, int]] = []
        self.remaining = float("inf")

    @property
    def number(self) -> int:
        """Samples that were left out of the last recording."""
        return sum(stop - start for start, stop in self.left_out)

    def fresh(self, parts: Iterable[Recording]) -> Iterator[Recording]:
        """Yield the samples of consecutive parts of a recording that are no duplicates."""
        self._begin("", 0)
        held: Recording | None = None
        run, rate = 1, None
        active: set[int] = set()
        skipped: list[Recording] = []
        for part, last in _with_last(parts):
            if held is None:
                self._source, rate = part.source, part.rate
                run = 1 if part.time is None else max(2, round(_DURATION * (rate or 1)))
            self._add(part, run, part.time is None)
            self.samples += len(part)
            block = part if held is None else join([held, part])
            decided = len(block) if last else len(block) - run
            if decided <= 0:
                held = block
                continue
            begin = self._count - len(block)
            if block.time is None:
                again = self._poses(begin, decided)
            elif rate is None:
                again = np.zeros(decided, dtype=bool)
            else:
                again, active = self._runs(begin, decided, run, active)
            row = self.samples - len(block)
            self.left_out += [(row + a, row + b) for a, b in _spans(again)]
            if again.all():
                skipped.append(block.rows(slice(0, 1)))
            else:
                yield block.rows(np.flatnonzero(~again)).with_found(skipped)
                skipped = []
            if decided < len(block):
                held = block.rows(slice(decided, None)).counted()
        if rate is not None:
            self.remaining = (self.samples - self.number) / rate

    def read(self, recording: Recording | RecordingFile) -> None:
        """Read a recording only to find its duplicates."""
        for _ in self.fresh(recording.parts()):
            pass

    def report(self) -> tuple[str, tuple[DataWarning, ...]] | None:
        """Return the duplicates of the last recording, in a line and as a warning, if any."""
        if not self.left_out:
            return None
        kept = self.samples - self.number
        text = (
            f"{self._source}: {self.number} of {self.samples} samples are exact duplicates of "
            "earlier samples, and count once"
        )
        if not kept:
            text += "; it is skipped"
        elif self.remaining < _LEAST:
            text += f"; the other {self.remaining:.2g} s are too short to be used"
        numbers = {"samples": self.number, "share": self.number / self.samples}
        return text, (DataWarning("duplicate_samples", None, numbers, text),)

    @property
    def skipped(self) -> bool:
        """Whether the rest of the last recording is too short to be used."""
        return bool(self.left_out) and (self.number == self.samples or self.remaining < _LEAST)

    def _add(self, part: Recording, run: int, poses: bool) -> None:
        """Remember the hashes of a part."""
        hashes = _hashes(part)
        while self._count + len(hashes) > len(self._hashes):
            self._hashes = np.concatenate([self._hashes, np.zeros_like(self._hashes)])
        begin, self._count = self._count, self._count + len(hashes)
        self._hashes[begin : self._count] = hashes
        for sample in self._marks(begin, self._count, run, poses).tolist():
            self._first.setdefault(int(self._hashes[sample]), sample)

    def _marks(self, begin: int, end: int, run: int, poses: bool) -> NDArray[np.int64]:
        """Return the samples that are looked up: those with the same hashes in every recording."""
        hashes = self._hashes[begin:end]
        if poses:
            return np.arange(begin, end)
        every = 1 << max(0, int(np.log2(run / _MARKS)))  # of each other a multiple
        chosen = hashes % np.uint64(every) == 0
        chosen[1:] &= hashes[1:] != hashes[:-1]
        return begin + np.flatnonzero(chosen)

    def _poses(self, begin: int, decided: int) -> Mask:
        samples = range(begin, begin + decided)
        return np.array([self._first[int(self._hashes[sample])] < sample for sample in samples])

    def _runs(self, begin: int, decided: int, run: int, active: set[int]) -> tuple[Mask, set[int]]:
        """Return the mask of duplicates from one sample on, and the lags to their originals.

        Args:
            begin: Number of the first sample.
            decided: Samples to decide on; as many as make a run are known beyond, if there are.
            run: Samples that make one.
            active: Lags at which the samples just before were duplicates.
        """
        votes: Counter[int] = Counter()
        for sample in self._marks(begin, self._count, run, False).tolist():
            votes[sample - self._first[int(self._hashes[sample])]] += 1
        again = np.zeros(decided, dtype=bool)
        continued = set()
        del votes[0]
        for back in {lag for lag, _ in votes.most_common(_MOST_LAGS)} | active:
            # A run may have begun in the part before.
            start = max(begin - run, back)
            here = self._hashes[start : self._count]
            same = here == self._hashes[start - back : self._count - back]
            changes = np.cumsum(np.append(False, here[1:] != here[:-1]))
            for first, stop in _spans(same):
                goes_on = back in active and start + first <= begin < start + stop
                moving = changes[stop - 1] - changes[first]
                if not goes_on and (stop - first < run or moving < _CHANGING * (stop - first)):
                    continue
                again[max(start + first - begin, 0) : max(start + stop - begin, 0)] = True
                if start + stop > begin + decided:
                    continued.add(back)
        return again, continued


def without_duplicates(
    recordings: Sequence[Recording | RecordingFile],
) -> tuple[list[Recording | RecordingFile], tuple[str, ...], tuple[DataWarning, ...]]:
    """Return recordings without duplicate samples, lines about these, and warnings.

    Recordings of duplicates alone are left out. Files are read once for it.
    """
    before = Duplicates()
    kept: list[Recording | RecordingFile] = []
    lines: list[str] = []
    warnings: list[DataWarning] = []
    for recording in recordings:
        before.read(recording)
        found = before.report()
        if found is not None:
            lines.append(found[0])
            warnings += found[1]
        if not before.skipped:
            kept.append(recording.without(before.left_out) if found else recording)
    return kept, tuple(lines), tuple(warnings)


def _with_last(parts: Iterable[Recording]) -> Iterator[tuple[Recording, bool]]:
    """Yield parts, and whether they are the last."""
    held: Recording | None = None
    for part in chain(parts, (None,)):
        if held is not None:
            yield held, part is None
        held = part


def _spans(mask: Mask) -> list[tuple[int, int]]:
    """Return where runs of true values begin and end."""
    edges = np.flatnonzero(np.diff(mask, prepend=False, append=False)).tolist()
    return list(pairwise(edges))[::2]


def _hashes(part: Recording) -> Hashes:
    """Return (N,) hashes of positions, efforts and directions."""
    values = [a for a in (part.position, part.effort, part.direction) if a is not None]
    bits = (np.hstack(values) + 0.0).view(np.uint64)  # -0 is 0
    total = np.zeros(len(bits), dtype=np.uint64)
    for column in bits.T:
        total = _mixed(total ^ column)
    return total


def _mixed(bits: Hashes) -> Hashes:
    """Return 64 bits that each depend on all (the finaliser of SplitMix64, Steele et al. 2014)."""
    bits = bits + np.uint64(0x9E3779B97F4A7C15)
    bits = (bits ^ (bits >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    bits = (bits ^ (bits >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return bits ^ (bits >> np.uint64(31))
