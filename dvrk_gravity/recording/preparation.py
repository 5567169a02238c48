"""From a raw recording to arrays for a fit, with a description of each step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.recording.checks import check
from dvrk_gravity.recording.filters import LowPass, derivative, white_density
from dvrk_gravity.recording.notes import Note, require_usable
from dvrk_gravity.recording.quantization import known_acceleration, quantum
from dvrk_gravity.recording.recording import Recording
from dvrk_gravity.recording.samples import QUANTITIES, Coordinates, not_recorded
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

Filtered = tuple[Recording, Array]  # and its acceleration


@dataclass(frozen=True, eq=False)
class Prepared:
    """A recording, checked and filtered.

    Attributes:
        recording: As it was read.
        filtered: ``(N, n)`` arrays; on uniform time grids and low-passed, unless static.
        acceleration: ``(N, n)`` rad/s^2; zero for static poses.
        parts: Parts of these samples without gaps, in order.
        warnings: Findings about the recording.
        processing_log: Steps of the preparation, one sentence each.
        filter: The low-pass of efforts, at the rate of the samples; ``None`` for static poses.
        stride: Every so-maniest sample was kept.
    """

    recording: Recording
    filtered: Recording
    acceleration: Array
    parts: tuple[slice, ...]
    warnings: tuple[Note, ...]
    processing_log: tuple[str, ...]
    filter: LowPass | None = None
    stride: int = 1

    def read_as(self, coordinates: Coordinates) -> Prepared:
        """Return the same in the coordinates that the recording's columns really have."""
        return replace(self, recording=replace(self.recording, coordinates=coordinates))

    def at_rate(self, rate: float) -> Prepared:
        """Return it at a lower rate, Hz, by cubic splines through the signals of each part."""
        assert self.filter is not None
        parts = [(self.filtered.rows(part), self.acceleration[part]) for part in self.parts]
        slower = _joined([_slower(*part, rate) for part in parts])
        return replace(self, **slower, filter=replace(self.filter, rate=rate))


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

    def processing_log(self) -> tuple[str, ...]:
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
        return tuple(lines)

    def warnings(self, samples: int) -> tuple[Note, ...]:
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
        return (Note("samples_discarded", None, numbers, text),)


def prepare(
    recording: Recording,
    cutoff: float = DEFAULT_CUTOFF,
    band: float | None = None,
    motion: float | None = None,
    stride: int = 1,
    for_fit: bool = True,
    warnings: tuple[Note, ...] | None = None,
) -> Prepared:
    """Check a recording and turn it into filtered, uniformly sampled parts.

    Static poses are not changed. In a trajectory, stale samples are removed; it is split at gaps
    that are too long to interpolate over; every part is interpolated onto a uniform grid at the
    nominal rate; position, velocity and effort go through zero-phase low-passes. A velocity
    column that is missing, late (as filtered ones are) or worse than the differentiated position is
    replaced by that derivative. The acceleration is the derivative of the resulting velocity.

    Args:
        recording: Trajectory or static poses.
        cutoff: Of the low-pass of efforts, Hz.
        band: Frequency below which the signals will be used, Hz; default: the cut-off. Gaps that
            are short against it are interpolated over, see ``longest_bridged``.
        motion: Cut-off of the low-pass of positions and velocities, Hz; default: that of efforts.
        stride: Every so-maniest low-passed sample is kept.
        for_fit: Whether the signals, and columns made of them, go through a further filter. Else
            the ends of parts, which the efforts' filter disturbs, are left out, and the
            acceleration is limited to the band that position steps allow
            (``known_acceleration``).
        warnings: Findings about the recording; ``None``: it is checked.

    Raises:
        RecordingError: If a check finds the recording unusable, if it is too short to filter, or
            if the cut-off does not go with the sampling rate.
    """
    rate = recording.rate
    if recording.time is not None and rate is None:
        raise RecordingError(recording.source, "holds one sample, expected a trajectory")
    warnings = check(recording) if warnings is None else warnings
    require_usable(recording.source, warnings)
    if recording.time is None or rate is None:
        used = "static poses are used as they are"
        still, whole = np.zeros_like(recording.position), (slice(0, len(recording)),)
        return Prepared(recording, recording, still, whole, warnings, (used,))
    low, band, motion = _low_pass(recording, cutoff, rate), band or cutoff, motion or cutoff
    wide = _low_pass(recording, motion, rate)
    old = stale(recording)
    log: tuple[str, ...] = ()
    if old.any():
        log += (f"{old.sum()} stale samples replaced by interpolation",)
    derived = _derived_joints(recording, warnings)
    if derived:
        log += (f"velocity differentiated from position: {', '.join(derived)}",)
    gaps = Gaps(low, longest_bridged(rate, band))
    gaps.count(recording.time)
    step = np.zeros(len(recording.joints))
    if not for_fit:
        step = np.array([quantum(column) for column in recording.position.T])
    parts: list[Filtered] = []
    first, gridded = 0, False
    for part in split_at_gaps(recording, gaps.longest):
        fresh = part.rows(~old[first : first + len(part)])
        first += len(part)
        if len(part) < SHORTEST * low.edge:
            gaps.lost += len(part)
            continue
        uniform = resample(fresh, rate)
        gridded = gridded or uniform is not fresh
        kept = slice(None, None, stride) if for_fit else slice(low.edge, -low.edge, stride)
        parts.append(_filtered(uniform, low, wide, derived, step, band, kept))
    if not parts:
        raise RecordingError(
            recording.source,
            f"has no {SHORTEST * low.edge} samples in a row without a gap, "
            f"as a {cutoff:g} Hz filter needs",
        )
    gaps.parts = len(parts)
    log += gaps.processing_log()
    warnings += gaps.warnings(len(recording))
    if gridded:
        log += (f"interpolated (Akima) onto a uniform grid at {rate:.6g} Hz",)
    if motion == cutoff:
        log += (f"{low}, over position, velocity and effort",)
    else:
        log += (
            f"efforts: {low}",
            f"motion low-passed at {motion:g} Hz; the model's torque then goes through the same "
            f"{cutoff:g} Hz filter as the measured one",
        )
    if stride > 1:
        log += (f"one of {stride} low-passed samples kept: {rate / stride:.6g} Hz",)
    slower = LowPass(cutoff, rate / stride)
    return Prepared(
        recording, warnings=warnings, processing_log=log, filter=slower, stride=stride,
        **_joined(parts),
    )  # fmt: skip


def _joined(parts: Sequence[Filtered]) -> dict[str, Any]:
    """Return parts, and their accelerations, as one recording with gaps."""
    first = parts[0][0]
    arrays: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part, _ in parts]) for name in first.arrays()
    }
    edges = np.cumsum([0, *(len(part) for part, _ in parts)]).tolist()
    return {
        "filtered": replace(first, **arrays),
        "acceleration": np.concatenate([acceleration for _, acceleration in parts]),
        "parts": tuple(slice(a, b) for a, b in pairwise(edges)),
    }


def _slower(part: Recording, acceleration: Array, rate: float) -> Filtered:
    from scipy.interpolate import CubicSpline

    assert part.time is not None
    first, last = part.time[0], part.time[-1]
    number = int((last - first) * rate + 1e-6) + 1
    time = np.minimum(first + np.arange(number) / rate, last)
    signals: dict[str, Any] = {
        name: CubicSpline(part.time, values)(time)
        for name, values in part.arrays().items()
        if name in QUANTITIES
    }
    slower = replace(part, time=time, direction=None, **signals)
    return slower, np.asarray(CubicSpline(part.time, acceleration)(time))


def noise_density(time: Array, effort: Array, used: Mask, cutoff: float, rate: float) -> Array:
    """Return (n,) densities of the noise of efforts above a cut-off, N·m/sqrt(Hz); NaN: unknown.

    Args:
        time: (N,) s.
        effort: (N, n) as recorded, in joint or actuator coordinates.
        used: (N, n) which of them are readings.
        cutoff: Hz.
        rate: Hz.
    """
    low = LowPass(cutoff, rate)
    square, count = np.zeros((2, effort.shape[1]))
    ends = np.flatnonzero(np.diff(time) > longest_bridged(rate, cutoff)) + 1
    for first, stop in pairwise([0, *ends.tolist(), len(time)]):
        if stop - first <= SHORTEST * low.edge:
            continue
        inner = slice(low.edge, -low.edge)
        high, counted = (effort[first:stop] - low(effort[first:stop]))[inner], used[first:stop]
        square += np.where(counted[inner], high**2, 0.0).sum(axis=0)
        count += counted[inner].sum(axis=0)
    known = count > 0
    return np.where(known, white_density(square / np.maximum(count, 1), cutoff, rate), np.nan)


def _low_pass(recording: Recording, cutoff: float, rate: float) -> LowPass:
    """Return the filter, or the error that names the recording."""
    try:
        return LowPass(cutoff, rate)
    except RecordingError as error:
        raise RecordingError(recording.source, error.problem) from error


def _derived_joints(recording: Recording, warnings: tuple[Note, ...]) -> tuple[str, ...]:
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
    raw: Recording, low: LowPass, wide: LowPass, derived: tuple[str, ...], step: Array, band: float,
    kept: slice,
) -> Filtered:  # fmt: skip
    """Return a uniform part low-passed: efforts by ``low``, motion by ``wide``."""
    position = wide(raw.position)
    velocity = derivative(position, wide.rate)
    if raw.velocity is not None:
        columns = [column for column, joint in enumerate(raw.joints) if joint not in derived]
        velocity[:, columns] = wide(raw.velocity[:, columns])
    effort = None if raw.effort is None else low(raw.effort)
    acceleration = known_acceleration(derivative(velocity, wide.rate), step, wide.rate, band)
    result = replace(raw, position=position, velocity=velocity, effort=effort).rows(kept)
    return result, acceleration[kept]
