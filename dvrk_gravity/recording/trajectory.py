"""A trajectory of any length prepared for a fit in little memory.

The recording goes through checks, resampling, filters and derivatives piece by piece; of the
low-passed samples, one in several is kept.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import chain

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.recording.checks import check_signals
from dvrk_gravity.recording.data_warning import DataWarning, Note, require_usable
from dvrk_gravity.recording.filters import LowPass, derivative, white_density
from dvrk_gravity.recording.piecewise import Findings, Piece, with_margins
from dvrk_gravity.recording.preparation import (
    DEFAULT_CUTOFF,
    SHORTEST,
    Gaps,
    derived_joints,
    low_pass,
)
from dvrk_gravity.recording.recording import Recording
from dvrk_gravity.recording.samples import Coordinates
from dvrk_gravity.recording.stream import blocks
from dvrk_gravity.recording.timing import (
    SLOWEST_JITTER,
    longest_bridged,
    resample,
    split_at_gaps,
    stale,
)
from dvrk_gravity.recording.unread import (
    FrozenSpan,
    clipped_efforts,
    frozen_efforts,
    limited_efforts,
)

# The motion is filtered less than the torques: friction's sign and products of velocities put
# power above the motion's own frequencies. The columns then go through the torques' filter.
MOTION_BAND = 2.0
# Samples kept for each period of the motion's cut-off: the rest of a fast recording is redundant.
OVERSAMPLING = 16.0
_ABOVE = 4.0  # cut-offs of the motion that a rate must have to show the noise above. Chosen
PIECE = 60_000  # samples that are worked on at a time
# Edges of the torques' filter by which pieces overlap: a margin's end affects the block by
# EDGE_LEVEL to that power, below 1e-12 of the signal.
MARGIN = 4.5
# The same of the far slower filter that separates jitter from wander: 1e-5 of the jitter is enough.
JITTER_MARGIN = 2.0


@dataclass(frozen=True, eq=False)
class Stretch:
    """A gap-free part of a trajectory, on a uniform grid.

    Attributes:
        time: (N,) s.
        position: (N, n) rad, low-passed at ``MOTION_BAND`` times the cut-off of ``filter``.
        velocity: (N, n) rad/s, the same.
        acceleration: (N, n) rad/s^2, the same.
        effort: (N, n) N·m, low-passed by ``filter``; ``None`` where not recorded.
        filter: The low-pass of ``effort``, at the rate of these samples.
        noise: (n,) density of the efforts' noise above the band of the motion, N·m/sqrt(Hz); NaN
            where it is not known.
    """

    time: Array
    position: Array
    velocity: Array
    acceleration: Array
    effort: Array | None
    filter: LowPass
    noise: Array


@dataclass(frozen=True, eq=False)
class Trajectory:
    """All stretches of a recording, in its own coordinates.

    Attributes:
        source: File or folder that it came from.
        joints: Names of the n columns.
        stretches: Gap-free parts, in order.
        warnings: Findings about the recording.
        handling: Steps of the preparation, one sentence each.
        coordinates: Of the columns, or ``None`` where they are not known.
        still: *Joint* positions of joints that were not recorded, by name, rad.
        frozen: Spans of efforts that are no readings, or clipped ones.
    """

    source: str
    joints: tuple[str, ...]
    stretches: tuple[Stretch, ...]
    warnings: tuple[DataWarning, ...]
    handling: tuple[str, ...]
    coordinates: Coordinates | None = None
    still: Mapping[str, float] = field(default_factory=dict)
    frozen: tuple[FrozenSpan, ...] = ()

    @property
    def head(self) -> Trajectory:
        """The part that has the joints: itself, as with recordings."""
        return self


def read_trajectory(
    parts: Iterable[Recording], cutoff: float = DEFAULT_CUTOFF, piece: int = PIECE
) -> Trajectory:
    """Check, clean, filter and thin out a trajectory that comes in consecutive parts.

    As :func:`prepare`, with two filters: of motion and of efforts. The nominal rate is that of the
    first ``piece`` samples.

    Args:
        parts: Of one recording, with time.
        cutoff: Of the efforts' low-pass, Hz; the motion's is ``MOTION_BAND`` times as high.
        piece: Samples that are worked on at a time.

    Raises:
        RecordingError: If a check finds the recording unusable, if it is too short to filter, or
            if the cut-off does not go with the sampling rate.
    """
    stream = blocks(parts, piece)
    first = next(stream)
    if first.time is None:
        raise RecordingError(first.source, "holds static poses, expected a trajectory")
    rate = first.rate
    if rate is None:
        raise RecordingError(first.source, "holds one sample, expected a trajectory")
    low, wide = _filters(first, rate, cutoff)
    findings, work = Findings(), _Work(low, wide)
    notes: list[tuple[Note, ...]] = []

    def counted() -> Iterator[Recording]:
        for block in chain((first,), stream):
            notes.append(block.found)
            yield block

    slow = LowPass(SLOWEST_JITTER, rate)
    margin = max(MARGIN * low.edge, JITTER_MARGIN * slow.edge)
    for index, padded in enumerate(with_margins(counted(), int(np.ceil(margin)))):
        findings.add(padded, notes[index])
        work.add(padded)
    warnings = findings.merged(first)
    derived = derived_joints(first, warnings)
    stretches = work.stretches(first, derived)
    warnings += work.warnings()
    return Trajectory(
        first.source, first.joints, stretches, warnings, work.handling(derived),
        frozen=tuple(work.frozen),
    )  # fmt: skip


def _filters(first: Recording, rate: float, cutoff: float) -> tuple[LowPass, LowPass]:
    """Return the filters of efforts and motion."""
    try:
        return low_pass(first, cutoff, rate), low_pass(first, MOTION_BAND * cutoff, rate)
    except RecordingError:
        # A wrong unit of time explains a filter that cannot be made.
        require_usable(first.source, check_signals(first))
        raise


@dataclass(eq=False)
class _Run:
    """A growing stretch: the next point of its grid, the number of points, and the kept samples."""

    origin: float = 0.0
    count: int = 0
    kept: dict[str, list[Array]] = field(default_factory=dict)


class _Work:
    """Filters pieces and joins their kept samples."""

    def __init__(self, low: LowPass, wide: LowPass) -> None:
        self._low, self._wide = low, wide
        self._stride = max(1, int(low.rate / (OVERSAMPLING * wide.cutoff)))
        self._runs: list[_Run] = []
        self._gaps = Gaps(low, longest_bridged(low.rate, low.cutoff))
        self._stale = self._samples = 0
        self._gridded = False
        self.frozen: list[FrozenSpan] = []

    def add(self, piece: Piece) -> None:
        """Filter a piece, and keep a part of the samples of its block."""
        self.frozen += frozen_efforts(piece.recording)
        self.frozen += clipped_efforts(piece.recording)
        self.frozen += limited_efforts(piece.recording)
        old = stale(piece.recording)
        self._stale += int(old[piece.first : piece.stop].sum())
        self._samples += piece.stop - piece.first
        assert piece.recording.time is not None
        # The interval from the block before belongs to this one.
        self._gaps.count(piece.recording.time[max(piece.first - 1, 0) : piece.stop])
        begin = 0
        for part in split_at_gaps(piece.recording, self._gaps.longest):
            end = begin + len(part)
            inside = min(end, piece.stop) - max(begin, piece.first)
            if inside > 0:
                if len(part) < SHORTEST * self._low.edge:
                    self._gaps.lost += inside
                else:
                    self._extend(part.rows(~old[begin:end]), begin < piece.first,
                                 self._last_time(piece, end))  # fmt: skip
            begin = end

    @staticmethod
    def _last_time(piece: Piece, end: int) -> float:
        time = piece.recording.time
        assert time is not None
        return float("inf") if end <= piece.stop else float(time[piece.stop - 1])

    def _extend(self, part: Recording, continued: bool, last: float) -> None:
        """Add to the last run, or begin one, the samples of a part up to a time."""
        rate = self._low.rate
        if not continued:
            self._runs.append(_Run())
            self._gaps.parts += 1
        run = self._runs[-1]
        uniform = resample(part, rate, run.origin if continued else None)
        self._gridded |= uniform is not part
        time = uniform.time
        assert time is not None
        begin = int(np.searchsorted(time, run.origin - 0.5 / rate)) if continued else 0
        end = int(np.searchsorted(time, last + 1e-9, side="right"))
        if end <= begin:
            return
        kept = slice(begin + (-run.count) % self._stride, end, self._stride)
        run.origin = float(time[end - 1]) + 1.0 / rate
        run.count += end - begin
        for name, array in self._signals(uniform):
            run.kept.setdefault(name, []).append(array[kept].copy())

    def _signals(self, uniform: Recording) -> Iterator[tuple[str, Array]]:
        rate = self._low.rate
        assert uniform.time is not None
        yield "time", uniform.time
        position = self._wide(uniform.position)
        yield "position", position
        derived = derivative(position, rate)
        yield "derived", derived
        yield "derived acceleration", derivative(derived, rate)
        if uniform.velocity is not None:
            measured = self._wide(uniform.velocity)
            yield "measured", measured
            yield "measured acceleration", derivative(measured, rate)
        if uniform.effort is not None:
            yield "effort", self._low(uniform.effort)
            yield "noise", uniform.effort - self._wide(uniform.effort)

    def stretches(self, recording: Recording, derived: tuple[str, ...]) -> tuple[Stretch, ...]:
        """Return the kept samples; ``derived`` names the joints whose velocity column is not used.

        Raises:
            RecordingError: If nothing was long enough.
        """
        if not self._runs:
            raise RecordingError(
                recording.source,
                f"has no {SHORTEST * self._low.edge} samples in a row without a gap, "
                f"as a {self._low.cutoff:g} Hz filter needs",
            )
        slower = LowPass(self._low.cutoff, self._low.rate / self._stride, self._low.order)
        columns = [column for column, joint in enumerate(recording.joints) if joint not in derived]
        found = []
        for run in self._runs:
            kept = {name: np.concatenate(run.kept.pop(name)) for name in tuple(run.kept)}
            for name in ("", " acceleration"):
                if columns:
                    kept[f"derived{name}"][:, columns] = kept.pop(f"measured{name}")[:, columns]
            noise = np.full(len(recording.joints), np.nan)
            if "noise" in kept:
                noise = self._noise(kept["time"], kept["noise"])
            found.append(
                Stretch(kept["time"], kept["position"], kept["derived"],
                        kept["derived acceleration"], kept.get("effort"), slower, noise)
            )  # fmt: skip
        return tuple(found)

    def _noise(self, time: Array, above: Array) -> Array:
        """Return (n,) densities of (N, n) efforts above the band of the motion, NaN: not known."""
        rate, cutoff = self._low.rate, self._wide.cutoff
        counted = np.ones(above.shape, dtype=bool)
        for span in self.frozen:
            first, last = span.span
            counted[(time >= first) & (time <= last), span.joint] = False
        count = counted.sum(axis=0)
        if rate < _ABOVE * cutoff or not count.all():
            return np.full(above.shape[1], np.nan)
        return white_density(np.where(counted, above**2, 0.0).sum(axis=0) / count, cutoff, rate)

    def warnings(self) -> tuple[DataWarning, ...]:
        """Return findings about gaps."""
        return self._gaps.warnings(self._samples)

    def handling(self, derived: tuple[str, ...]) -> tuple[str, ...]:
        """Return the steps taken, one sentence each."""
        lines = []
        if self._stale:
            lines.append(f"{self._stale} stale samples replaced by interpolation")
        if derived:
            lines.append(f"velocity differentiated from position: {', '.join(derived)}")
        if self.frozen:
            lines.append("efforts that are no readings, or clipped (see the warnings), left out")
        lines += self._gaps.handling()
        if self._gridded:
            lines.append(f"interpolated (Akima) onto a uniform grid at {self._low.rate:.6g} Hz")
        lines.append(f"efforts: {self._low}")
        lines.append(
            f"motion low-passed at {self._wide.cutoff:g} Hz; the model's torque then goes through "
            f"the same {self._low.cutoff:g} Hz filter as the measured one"
        )
        if self._stride > 1:
            lines.append(
                f"one of {self._stride} low-passed samples kept: "
                f"{self._low.rate / self._stride:.6g} Hz"
            )
        return tuple(lines)
