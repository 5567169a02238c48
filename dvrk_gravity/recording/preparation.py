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
# The motion is filtered less than the torques: friction's sign and products of velocities put
# power above the motion's own frequencies. The columns then go through the torques' filter.
MOTION_BAND = 2.0
# Samples kept for each period of the motion's cut-off: the rest of a fast recording is redundant.
OVERSAMPLING = 18.0
SHORTEST = 4  # edges of the filter that a part must be long to be kept
# Part of the samples whose loss is a warning: without a tenth, intervals are some 5 % wider than
# the recording promises (1 / sqrt(0.9)).
DISCARDED = 0.1

Filtered = tuple[Recording, Array]  # and its acceleration


@dataclass(frozen=True)
class Bands:
    """How trajectories are filtered.

    Attributes:
        effort: Cut-off of efforts, Hz.
        motion: Cut-off of positions and velocities, Hz.
        used: Hz; below it signals are compared.
        kept: Samples kept a second, about.
        noise: Hz; above it efforts show their noise.
        for_fit: Columns go through the efforts' filter later. Then parts keep their ends, which
            that filter takes; accelerations keep their noise, and clipped efforts are no readings.
    """

    effort: float
    motion: float
    used: float
    kept: float
    noise: float
    for_fit: bool

    @classmethod
    def of_fit(cls, cutoff: float = DEFAULT_CUTOFF) -> Bands:
        """Return those of a fit to efforts below a cut-off, Hz."""
        motion = MOTION_BAND * cutoff
        return cls(cutoff, motion, cutoff, OVERSAMPLING * motion, motion, for_fit=True)

    def within(self, rate: float) -> Bands:
        """Return those for recordings of which the slowest has a rate, Hz.

        A fit's cut-offs are the same for all recordings: too slow a one is refused.
        """
        if self.for_fit:
            return self
        return replace(
            self, effort=min(self.effort, rate / 5.0), motion=min(self.motion, rate / 5.0)
        )

    def stride(self, rate: float) -> int:
        """Return that every so-maniest sample is kept of a recording at a rate, Hz."""
        return max(1, round(rate / self.kept))


@dataclass(frozen=True, eq=False)
class Prepared:
    """A recording, checked and filtered.

    Attributes:
        recording: As it was read.
        bands: How it was filtered.
        filtered: ``(N, n)`` arrays; on uniform time grids and low-passed, unless static.
        acceleration: ``(N, n)`` rad/s^2; zero for static poses.
        parts: Parts of these samples without gaps, in order.
        warnings: Findings about the recording.
        processing_log: Steps of the preparation, one sentence each.
        filter: The low-pass of efforts, at the rate of the samples; ``None`` for static poses.
        stride: Every so-maniest sample was kept.
    """

    recording: Recording
    bands: Bands
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


def _across_gaps(
    time: Array, low: LowPass, longest: float, parts: int, lost: int
) -> tuple[tuple[str, ...], tuple[Note, ...]]:
    """Return what was done at the gaps of a trajectory, and a warning if they cost many samples.

    Args:
        time: (N,) s.
        low: The low-pass that goes over every part.
        longest: Longest interval that is interpolated over, s.
        parts: Number of parts that were kept.
        lost: Samples of parts that are too short for the filter.
    """
    intervals = np.diff(time)
    gaps = intervals[intervals > TimingSettings().gap / low.rate]
    bridged = gaps[gaps <= longest]
    splits = len(gaps) - len(bridged)
    log: tuple[str, ...] = ()
    if len(bridged):
        log += (
            f"{len(bridged)} gaps of up to {1e3 * bridged.max():.3g} ms interpolated "
            f"over (up to {1e3 * longest:.3g} ms is short for the filter)",
        )
    if splits:
        log += (f"split at gaps into {parts} parts, {lost} samples of short ones left out",)
    # Those of short parts, and the filter's ends on either side.
    discarded = lost + 2 * low.edge * max(parts - 1, 0)
    share = discarded / len(time)
    if share <= DISCARDED:
        return log, ()
    numbers = {"samples": discarded, "share": share, "gaps": splits}
    text = (
        f"{discarded} of {len(time)} samples ({100 * share:.0f} %) are not used: "
        f"{splits} gaps of more than {1e3 * longest:.3g} ms leave parts that are "
        f"short for the filter, which takes {low.edge / low.rate:.2g} s at either "
        "end of each; record without gaps"
    )
    return log, (Note("samples_discarded", None, numbers, text),)


def prepare(
    recording: Recording,
    bands: Bands | None = None,
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
        bands: How it is filtered; default: as for a fit. Gaps that are short against the band below
            which signals are used are interpolated over, see ``longest_bridged``. What is not for a
            fit loses the ends of parts, which the efforts' filter disturbs, and its acceleration is
            limited to the band that position steps allow (``known_acceleration``).
        warnings: Findings about the recording; ``None``: it is checked.

    Raises:
        RecordingError: If a check finds the recording unusable, if it is too short to filter, or
            if the cut-off does not go with the sampling rate.
    """
    rate, bands = recording.rate, bands or Bands.of_fit()
    if recording.time is not None and rate is None:
        raise RecordingError(recording.source, "holds one sample, expected a trajectory")
    warnings = check(recording) if warnings is None else warnings
    require_usable(recording.source, warnings)
    if recording.time is None or rate is None:
        used = "static poses are used as they are"
        still, whole = np.zeros_like(recording.position), (slice(0, len(recording)),)
        return Prepared(recording, bands, recording, still, whole, warnings, (used,))
    low, wide = (_low_pass(recording, cutoff, rate) for cutoff in (bands.effort, bands.motion))
    stride = bands.stride(rate)
    old = stale(recording)
    log: tuple[str, ...] = ()
    if old.any():
        log += (f"{old.sum()} stale samples replaced by interpolation",)
    derived = _derived_joints(recording, warnings)
    if derived:
        log += (f"velocity differentiated from position: {', '.join(derived)}",)
    longest = longest_bridged(rate, bands.used)
    step = np.zeros(len(recording.joints))
    if not bands.for_fit:
        step = np.array([quantum(column) for column in recording.position.T])
    parts: list[Filtered] = []
    first, lost, gridded = 0, 0, False
    for part in split_at_gaps(recording, longest):
        fresh = part.rows(~old[first : first + len(part)])
        first += len(part)
        if len(part) < SHORTEST * low.edge:
            lost += len(part)
            continue
        uniform = resample(fresh, rate)
        gridded = gridded or uniform is not fresh
        kept = slice(None, None, stride) if bands.for_fit else slice(low.edge, -low.edge, stride)
        parts.append(_filtered(uniform, low, wide, derived, step, bands.used, kept))
    if not parts:
        raise RecordingError(
            recording.source,
            f"has no {SHORTEST * low.edge} samples in a row without a gap, "
            f"as a {bands.effort:g} Hz filter needs",
        )
    done, costs = _across_gaps(recording.time, low, longest, len(parts), lost)
    log, warnings = log + done, warnings + costs
    if gridded:
        log += (f"interpolated (Akima) onto a uniform grid at {rate:.6g} Hz",)
    if bands.motion == bands.effort:
        log += (f"{low}, over position, velocity and effort",)
    else:
        log += (
            f"efforts: {low}",
            f"motion low-passed at {bands.motion:g} Hz; the model's torque then goes through the "
            f"same {bands.effort:g} Hz filter as the measured one",
        )
    if stride > 1:
        log += (f"one of {stride} low-passed samples kept: {rate / stride:.6g} Hz",)
    slower = LowPass(bands.effort, rate / stride)
    return Prepared(
        recording, bands, warnings=warnings, processing_log=log, filter=slower, stride=stride,
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
