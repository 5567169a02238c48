"""From a raw recording to arrays that a model can be fitted to, saying what was done."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.recording.acceleration import known_acceleration
from dvrk_gravity.recording.checks import check
from dvrk_gravity.recording.data import Recording
from dvrk_gravity.recording.data_warning import DataWarning
from dvrk_gravity.recording.filters import ORDER, LowPass, derivative
from dvrk_gravity.recording.gaps import Gaps
from dvrk_gravity.recording.grid import longest_bridged, resample, split_at_gaps, stale
from dvrk_gravity.recording.quantization import quantum
from dvrk_gravity.recording.samples import not_recorded
from dvrk_gravity.recording.velocity import compare_velocity

DEFAULT_CUTOFF = 5.65  # Hz; the published evaluations of these arms use it
SHORTEST = 4  # edges of the filter that a part must be long to be kept


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
    """A recording made ready, and what that took.

    Attributes:
        segments: Parts without gaps, in order.
        warnings: What was found in the raw recording.
        handling: What was done, one sentence each.
        filter: The low-pass that went over every signal, or ``None`` for static poses.
    """

    segments: tuple[Segment, ...]
    warnings: tuple[DataWarning, ...]
    handling: tuple[str, ...]
    filter: LowPass | None


def prepare(
    recording: Recording,
    cutoff: float = DEFAULT_CUTOFF,
    order: int = ORDER,
    effort_limits: Mapping[str, float] | None = None,
    band: float | None = None,
    warnings: tuple[DataWarning, ...] | None = None,
) -> Prepared:
    """Check a recording and turn it into filtered, uniformly sampled parts.

    Static poses are passed on as they are. In a trajectory, stale samples are taken out; it is
    split at gaps that are too long to interpolate over; every part is interpolated onto a uniform
    grid at the nominal rate (where it is not on one already); position, velocity and effort go
    through one zero-phase low-pass. The velocity of a joint whose column is missing or worse than
    the differentiated position is replaced by that derivative, and so is one that is late, as
    filtered ones are. The acceleration is the derivative of the resulting velocity, as far as the
    steps of the positions let it be known (``known_acceleration``).

    Args:
        recording: What was recorded.
        cutoff: Of the low-pass, Hz.
        order: Of one of its two runs.
        effort_limits: See ``check``.
        band: Frequency below which the signals will be used, Hz; default: the cut-off. Gaps that
            are short against it are interpolated over, see ``longest_bridged``.
        warnings: What was found in the recording that this is a part of; ``None``: it is checked.

    Raises:
        RecordingError: If a check finds the recording unusable, if it is too short to filter, or
            if the cut-off does not go with the sampling rate.
    """
    warnings = check(recording, effort_limits) if warnings is None else warnings
    for warning in warnings:
        if warning.unusable:
            raise RecordingError(recording.source, str(warning))
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
