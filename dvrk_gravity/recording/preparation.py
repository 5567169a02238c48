"""From a raw recording to arrays for a fit, with a description of each step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.recording.checks import check
from dvrk_gravity.recording.data_warning import DataWarning, require_usable
from dvrk_gravity.recording.filters import ORDER, LowPass, derivative
from dvrk_gravity.recording.quantization import known_acceleration, quantum
from dvrk_gravity.recording.recording import Recording
from dvrk_gravity.recording.samples import not_recorded
from dvrk_gravity.recording.timing import (
    TimingSettings,
    longest_bridged,
    resample,
    split_at_gaps,
    stale,
)
from dvrk_gravity.recording.velocity import compare_velocity

DEFAULT_CUTOFF = 5.65  # Hz; the published evaluations of these arms use it
SHORTEST = 4  # edges of the filter that a part must be long to be kept
# Part of the samples whose loss is a warning: without a tenth, intervals are some 5 % wider than
# the recording promises (1 / sqrt(0.9)).
DISCARDED = 0.1


@dataclass(frozen=True, eq=False)
class Segment:
    """A contiguous part of a prepared recording.

    Attributes:
        recording: ``(N, n)`` arrays; on a uniform time grid and low-passed, unless static.
        acceleration: ``(N, n)`` rad/s^2, or ``None`` for static poses.
        edge: Samples at either end that the filter's end transients reach.
    """

    recording: Recording
    acceleration: Array | None
    edge: int

    @property
    def core(self) -> slice:
        """Samples that no end transient reaches."""
        return slice(self.edge, len(self.recording) - self.edge)


@dataclass(frozen=True, eq=False)
class Prepared:
    """A prepared recording.

    Attributes:
        segments: Parts without gaps, in order.
        warnings: Findings about the raw recording.
        handling: Steps of the preparation, one sentence each.
        filter: The low-pass that went over every signal, or ``None`` for static poses.
    """

    segments: tuple[Segment, ...]
    warnings: tuple[DataWarning, ...]
    handling: tuple[str, ...]
    filter: LowPass | None


@dataclass
class Gaps:
    """Counts the gaps of a trajectory.

    Attributes:
        low: The low-pass that goes over every part.
        longest: Longest interval that is interpolated over, s.
        bridged: Gaps that were.
        longest_bridged: The longest of these, s.
        splits: Gaps that were not.
        parts: Parts that were kept.
        lost: Samples of parts that are too short for the filter.
    """

    low: LowPass
    longest: float
    bridged: int = 0
    longest_bridged: float = 0.0
    splits: int = 0
    parts: int = 0
    lost: int = 0

    def count(self, time: Array) -> None:
        """Count the gaps between (N,) times, s."""
        intervals = np.diff(time)
        gaps = intervals[intervals > TimingSettings().gap / self.low.rate]
        bridged = gaps[gaps <= self.longest]
        self.bridged += len(bridged)
        self.longest_bridged = max(self.longest_bridged, float(bridged.max(initial=0.0)))
        self.splits += len(gaps) - len(bridged)

    @property
    def discarded(self) -> int:
        """Samples that gaps cost: those of short parts, and the filter's ends on either side."""
        return self.lost + 2 * self.low.edge * max(self.parts - 1, 0)

    def handling(self) -> list[str]:
        """Return the steps taken, one sentence each."""
        lines = []
        if self.bridged:
            lines.append(
                f"{self.bridged} gaps of up to {1e3 * self.longest_bridged:.3g} ms interpolated "
                f"over (up to {1e3 * self.longest:.3g} ms is short for the filter)"
            )
        if self.splits:
            lines.append(
                f"split at gaps into {self.parts} parts, {self.lost} samples of short ones left out"
            )
        return lines

    def warnings(self, samples: int) -> tuple[DataWarning, ...]:
        """Return a warning if gaps cost too many of the samples of a recording."""
        share = self.discarded / samples
        if share <= DISCARDED:
            return ()
        numbers = {"samples": self.discarded, "share": share, "gaps": self.splits}
        text = (
            f"{self.discarded} of {samples} samples ({100 * share:.0f} %) are not used: "
            f"{self.splits} gaps of more than {1e3 * self.longest:.3g} ms leave parts that are "
            f"short for the filter, which takes {self.low.edge / self.low.rate:.2g} s at either "
            "end of each; record without gaps"
        )
        return (DataWarning("samples_discarded", None, numbers, text),)


def prepare(
    recording: Recording,
    cutoff: float = DEFAULT_CUTOFF,
    order: int = ORDER,
    effort_limits: Mapping[str, float] | None = None,
    band: float | None = None,
    warnings: tuple[DataWarning, ...] | None = None,
) -> Prepared:
    """Check a recording and turn it into filtered, uniformly sampled parts.

    Static poses are not changed. In a trajectory, stale samples are removed; it is split at gaps
    that are too long to interpolate over; every part is interpolated onto a uniform grid at the
    nominal rate; position, velocity and effort go through one zero-phase low-pass. A velocity
    column that is missing, late (as filtered ones are) or worse than the differentiated position is
    replaced by that derivative. The acceleration is the derivative of the resulting velocity,
    limited to the band that position steps allow (``known_acceleration``).

    Args:
        recording: Trajectory or static poses.
        cutoff: Of the low-pass, Hz.
        order: Of one of its two runs.
        effort_limits: See ``check``.
        band: Frequency below which the signals will be used, Hz; default: the cut-off. Gaps that
            are short against it are interpolated over, see ``longest_bridged``.
        warnings: Findings about the recording that this is a part of; ``None``: it is checked.

    Raises:
        RecordingError: If a check finds the recording unusable, if it is too short to filter, or
            if the cut-off does not go with the sampling rate.
    """
    warnings = check(recording, effort_limits) if warnings is None else warnings
    require_usable(recording.source, warnings)
    rate = recording.rate
    if recording.time is None:
        segment = Segment(recording, None, 0)
        return Prepared((segment,), warnings, ("static poses are used as they are",), None)
    if rate is None:
        raise RecordingError(recording.source, "holds one sample, expected a trajectory")
    handling = []
    low = low_pass(recording, cutoff, rate, order)
    old = stale(recording)
    if old.any():
        handling.append(f"{old.sum()} stale samples replaced by interpolation")
    derived = derived_joints(recording, warnings)
    if derived:
        handling.append(f"velocity differentiated from position: {', '.join(derived)}")
    gaps = Gaps(low, longest_bridged(rate, band or cutoff))
    gaps.count(recording.time)
    parts = split_at_gaps(recording, gaps.longest)
    step = np.array([quantum(column) for column in recording.position.T])
    segments: list[Segment] = []
    first, gridded = 0, False
    for part in parts:
        fresh = part.rows(~old[first : first + len(part)])
        first += len(part)
        if len(part) < SHORTEST * low.edge:
            continue
        uniform = resample(fresh, rate)
        gridded = gridded or uniform is not fresh
        segments.append(_filtered(uniform, low, derived, step, band or cutoff))
    if not segments:
        raise RecordingError(
            recording.source,
            f"has no {SHORTEST * low.edge} samples in a row without a gap, "
            f"as a {cutoff:g} Hz filter needs",
        )
    gaps.lost = sum(len(part) for part in parts if len(part) < SHORTEST * low.edge)
    gaps.parts = len(segments)
    handling += gaps.handling()
    warnings += gaps.warnings(len(recording))
    if gridded:
        handling.append(f"interpolated (Akima) onto a uniform grid at {rate:.6g} Hz")
    handling.append(f"{low}, over position, velocity and effort")
    return Prepared(tuple(segments), warnings, tuple(handling), low)


def low_pass(recording: Recording, cutoff: float, rate: float, order: int = ORDER) -> LowPass:
    """Return the filter, or the error that names the recording."""
    try:
        return LowPass(cutoff, rate, order)
    except RecordingError as error:
        raise RecordingError(recording.source, error.problem) from error


def derived_joints(recording: Recording, warnings: tuple[DataWarning, ...]) -> tuple[str, ...]:
    """Return the joints whose velocity is differentiated from the position."""
    if recording.velocity is None:
        return recording.joints
    # Once the times are right, the encoders' positions are better than any velocity column.
    if any(warning.kind == "read_jitter" and warning.numbers["corrected"] for warning in warnings):
        return recording.joints
    kinds = ("velocity_mismatch", "velocity_factor")
    worse = {warning.joint for warning in warnings if warning.kind in kinds}
    absent = zip(recording.joints, not_recorded(recording.velocity).tolist(), strict=True)
    worse |= {joint for joint, missing in absent if missing}
    # A filter's delay is no fault of the recording, but would pass for one of the effort.
    fits = zip(recording.joints, compare_velocity(recording), strict=True)
    return tuple(joint for joint, fit in fits if joint in worse or (fit and fit.late))


def _filtered(
    raw: Recording, low: LowPass, derived: tuple[str, ...], step: Array, band: float
) -> Segment:
    position = low(raw.position)
    velocity = derivative(position, low.rate)
    if raw.velocity is not None:
        measured = low(raw.velocity)
        for column, joint in enumerate(raw.joints):
            if joint not in derived:
                velocity[:, column] = measured[:, column]
    effort = None if raw.effort is None else low(raw.effort)
    acceleration = known_acceleration(derivative(velocity, low.rate), step, low.rate, band)
    acceleration.flags.writeable = False
    result = replace(raw, position=position, velocity=velocity, effort=effort)
    return Segment(result, acceleration, low.edge)
