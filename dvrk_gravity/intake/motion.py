"""Trajectories prepared for a fit: motion in joint space, torque at the motors, one sample rate."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import compress

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.effects import State
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.estimation import band_noise
from dvrk_gravity.intake.absent_joints import completed, motors_measured, require_all
from dvrk_gravity.intake.arm_side import beyond_limits
from dvrk_gravity.recording import (
    DEFAULT_CUTOFF,
    STILL,
    DataWarning,
    FrozenSpan,
    LowPass,
    Prepared,
    Recording,
    Segment,
    about,
    clipped_efforts,
    noise_density,
    prepare,
    unread_efforts,
)

# What can be fitted to: as recorded, or filtered already.
Source = Recording | Prepared

# The motion is filtered less than the torques: friction's sign and products of velocities put
# power above the motion's own frequencies. The columns then go through the torques' filter.
MOTION_BAND = 2.0
# Samples kept for each period of the motion's cut-off: the rest of a fast recording is redundant.
OVERSAMPLING = 16.0
_ABOVE = 4.0  # cut-offs of the motion that a rate must have to show the noise above. Chosen
_SAME_EFFORT = 1e-9  # relative: what filters make of one number
# Ratio of two clocks of one rate. Chosen: they differ by more than clocks do, by less than any two
# rates in use.
_SAME_RATE = 1.001
UNUSED = "efforts that are no readings, or clipped (see the warnings), left out"


@dataclass(frozen=True, eq=False)
class CalibrationMotion:
    """A gap-free part of a recording.

    Attributes:
        time: (N,) s.
        state: (N, n) positions, velocities, accelerations in joint space.
        effort: (N, n) torque at the motors, low-passed, N·m; zero where not measured.
        measured: (n,) motors whose torque was measured.
        informative: (N, n) samples whose torque a fit may use; by default all.
        filter: The low-pass of ``effort``, at the rate of these samples.
        source: Index of its recording.
        noise: (n,) RMS noise that is left of the efforts as recorded, joints' or motors'; NaN
            where it is not known.
    """

    time: Array
    state: State
    effort: Array
    measured: Mask
    filter: LowPass
    source: int
    noise: Array
    informative: Mask = field(default_factory=lambda: np.ones((), dtype=bool))

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.time)


@dataclass(frozen=True, eq=False)
class Motions:
    """All parts of some recordings, with warnings and a line for each step of preparation."""

    parts: tuple[CalibrationMotion, ...]
    warnings: tuple[DataWarning, ...]
    handling: tuple[str, ...]


def noise_floor(noise: Sequence[Array], lengths: Sequence[int]) -> Array:
    """Return (n,) RMS noise of all of some motions, by that of each and its number of samples."""
    return np.asarray(np.sqrt(np.average(np.square(noise), axis=0, weights=lengths)))


def recorded_as(source: Source) -> Recording:
    """Return what was recorded."""
    return source.recording if isinstance(source, Prepared) else source


def read(recording: Source, cutoff: float = DEFAULT_CUTOFF) -> Prepared:
    """Filter a trajectory for a fit, unless that has been done.

    Args:
        recording: With time.
        cutoff: Of the efforts' low-pass, Hz; the motion's is ``MOTION_BAND`` times as high.

    Raises:
        RecordingError: Whatever ``prepare`` refuses.
    """
    if isinstance(recording, Prepared):
        return recording
    if recording.time is None:
        raise RecordingError(recording.source, "holds static poses, expected a trajectory")
    motion = MOTION_BAND * cutoff
    stride = max(1, int((recording.rate or 0.0) / (OVERSAMPLING * motion)))
    return prepare(recording, cutoff, motion=motion, limit_acceleration=False, stride=stride)


def read_motions(
    recordings: Iterable[Source],
    arm: Arm,
    cutoff: float = DEFAULT_CUTOFF,
    fixed_positions: Mapping[str, float] | None = None,
) -> Motions:
    """Filter recordings and transform them to joint space.

    Args:
        recordings: Trajectories with efforts, of all joints but those that stood.
        arm: The arm, for its transmission.
        cutoff: Of the torques' low-pass, Hz.
        fixed_positions: Where joints stood that a recording lacks, rad.

    Raises:
        RecordingError: No efforts, a joint missing, or whatever ``prepare`` refuses.
    """
    parts: list[CalibrationMotion] = []
    each = [read(recording, cutoff) for recording in recordings]
    warnings, log = list[DataWarning](), list[str]()
    rates = [prepared.filter.rate for prepared in each if prepared.filter is not None]
    sources = [prepared.recording.source for prepared in each]
    for source, prepared in enumerate(each):
        recording = prepared.recording
        require_all(recording, arm, fixed_positions)
        warnings += about(source, sources, prepared.warnings)
        for warning in prepared.warnings:
            if warning.kind == "exchanged_joints":  # a diagnosis can say which, a fit cannot
                raise RecordingError(recording.source, str(warning))
        log += [line for line in prepared.processing_log if line not in log]
        own = _motions(prepared, arm, fixed_positions or {}, min(rates), source)
        if not all(part.informative.all() for part in own) and UNUSED not in log:
            log.append(UNUSED)
        parts += own
        _require_measured_where_moved(prepared, arm)
        seen = np.concatenate([part.state.q[:: max(1, len(part) // 1000)] for part in own])
        warnings += about(source, sources, beyond_limits(seen, arm))
    if max(rates) > _SAME_RATE * min(rates):
        log.append(f"recordings of several rates, resampled to {min(rates):.6g} Hz")
    return Motions(tuple(parts), tuple(warnings), tuple(log))


def _require_measured_where_moved(prepared: Prepared, arm: Arm) -> None:
    """Refuse constant efforts of joints that move; those of others are not fitted."""
    recording = prepared.recording
    efforts = [s.recording.effort for s in prepared.segments if s.recording.effort is not None]
    ways = np.ptp(np.concatenate([s.recording.position for s in prepared.segments]), axis=0)
    moved = ways >= STILL * arm.scale[[arm.joint_names.index(joint) for joint in recording.joints]]
    joints = list(compress(recording.joints, moved))
    require_measured(recording.source, joints, np.concatenate(efforts)[:, moved])


def require_measured(source: str, joints: Sequence[str], effort: Array) -> None:
    """Refuse (N, n) efforts that are constant on a joint: zeros, or those of a dead sensor.

    Raises:
        RecordingError: Naming the joints.
    """
    least, greatest = effort.min(axis=0), effort.max(axis=0)
    same = greatest - least <= _SAME_EFFORT * np.abs(effort).max(axis=0)
    if same.any():
        named = ", ".join(compress(joints, same))
        values = ", ".join(f"{value:g}" for value in dict.fromkeys(least[same].tolist()))
        what = "zero" if not least[same].any() else f"the same ({values})"
        raise RecordingError(source, f"efforts of {named} are all {what}, expected measured ones")


def _motions(
    prepared: Prepared, arm: Arm, fixed_positions: Mapping[str, float], rate: float, source: int
) -> list[CalibrationMotion]:
    """Return the segments of a recording in joint space, at a rate that is not higher."""
    recording, given = prepared.recording, prepared.filter
    assert given is not None
    low = replace(given, rate=rate) if given.rate > _SAME_RATE * rate else given
    actuator = recording.coordinates == "actuator"
    columns = [arm.joint_names.index(joint) for joint in recording.joints]
    measured = motors_measured(columns, arm, recording.coordinates)
    spans = [*unread_efforts(recording), *clipped_efforts(recording)]
    noise = np.full(arm.n, np.nan)
    noise[columns] = band_noise(_noise(recording, spans, MOTION_BAND * low.cutoff), low.cutoff)
    stood = np.array([fixed_positions.get(joint, 0.0) for joint in arm.joint_names])
    found = []
    for segment in prepared.segments:
        time, (q, qd, qdd, effort) = _signals(segment)
        if low is not given:
            time, (q, qd, qdd, effort) = _at_rate(time, (q, qd, qdd, effort), rate)
        if len(columns) < arm.n:
            q = completed(q, columns, stood, arm, recording.coordinates)
            qd, qdd = (
                completed(array, columns, np.zeros(arm.n), arm, recording.coordinates)
                for array in (qd, qdd)
            )
            narrow, effort = effort, np.zeros(q.shape)
            effort[:, columns] = narrow
        if actuator:
            q, qd, qdd = (arm.joint_position(array) for array in (q, qd, qdd))
        else:
            effort = arm.actuator_effort(effort)
        if not measured.all():
            effort = np.where(measured, effort, 0.0)
        unread = np.zeros(effort.shape, dtype=bool)
        reach = low.edge / low.rate
        for span in spans:
            inside = (time > span.span[0] - reach) & (time < span.span[1] + reach)
            unread[inside, columns[span.joint]] = True
        usable = ~(unread if actuator else _motors_loaded(unread, arm))
        found.append(
            CalibrationMotion(time, State(q, qd, qdd), effort, measured, low, source, noise, usable)
        )
    return found


def _signals(segment: Segment) -> tuple[Array, tuple[Array, ...]]:
    """Return times, and positions, velocities, accelerations, efforts."""
    own = segment.recording
    assert own.time is not None
    assert own.velocity is not None
    assert segment.acceleration is not None
    assert own.effort is not None
    return own.time, (own.position, own.velocity, segment.acceleration, own.effort)


def _noise(recording: Recording, spans: Sequence[FrozenSpan], above: float) -> Array:
    """Return (n,) densities of the efforts' noise above the motion's cut-off, NaN: not known."""
    rate, effort, time = recording.rate, recording.effort, recording.time
    assert effort is not None
    if rate is None or time is None or rate < _ABOVE * above:
        return np.full(effort.shape[1], np.nan)
    used = np.ones(effort.shape, dtype=bool)
    for span in spans:
        used[slice(*span.rows), span.joint] = False
    return noise_density(time, effort, used, above, rate)


def _at_rate(time: Array, signals: Sequence[Array], rate: float) -> tuple[Array, tuple[Array, ...]]:
    """Return times and low-passed signals at a lower rate, by cubic splines."""
    from scipy.interpolate import CubicSpline

    first, last = time[0], time[-1]
    new = np.minimum(first + np.arange(int((last - first) * rate + 1e-6) + 1) / rate, last)
    return new, tuple(np.asarray(CubicSpline(time, values)(new)) for values in signals)


def _motors_loaded(joints: Mask, arm: Arm) -> Mask:
    """Return (…, n) motors that carry part of the torque of some of (…, n) joints."""
    return np.asarray(joints @ (arm.actuator_to_joint != 0.0))


def without_standing(
    motions: Sequence[CalibrationMotion], arm: Arm
) -> tuple[list[CalibrationMotion], tuple[str, ...]]:
    """Return motions without the torque of joints that never move, and the names of these joints.

    Friction may hold any torque there up to its level, and so at every motor that carries part of
    such a joint's torque.
    """
    lower = np.min([motion.state.q.min(axis=0) for motion in motions], axis=0)
    upper = np.max([motion.state.q.max(axis=0) for motion in motions], axis=0)
    standing = stands(lower, upper, arm)
    loaded = _motors_loaded(standing, arm)
    parts = [replace(motion, informative=motion.informative & ~loaded) for motion in motions]
    return parts, tuple(compress(arm.joint_names, standing))


def stands(lower: Array, upper: Array, arm: Arm) -> Mask:
    """Return (n,) joints that friction may hold all the time, by their least and greatest q."""
    return np.asarray((upper - lower < STILL * arm.scale) & arm.rubs)
