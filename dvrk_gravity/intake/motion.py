"""Trajectories prepared for a fit: motion in joint space, torque at the motors, one sample rate."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, compress

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.effects import State
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.estimation import band_noise
from dvrk_gravity.intake.absent_joints import Source, completed, motors_measured, require_all
from dvrk_gravity.intake.arm_side import beyond_limits
from dvrk_gravity.recording import (
    DEFAULT_CUTOFF,
    STILL,
    Coordinates,
    DataWarning,
    Duplicates,
    LowPass,
    Recording,
    RecordingFile,
    Stretch,
    Trajectory,
    about,
    read_trajectory,
)

_SAME_EFFORT = 1e-9  # relative: what filters make of one number
# Relative difference of two clocks of one rate. Chosen: more than clocks differ by, less than any
# two rates in use.
_SAME_RATE = 1e-3


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


def whole(recording: Recording | RecordingFile) -> Recording:
    """Return a recording in memory."""
    return recording.load() if isinstance(recording, RecordingFile) else recording


def read(recording: Source, cutoff: float = DEFAULT_CUTOFF) -> Trajectory:
    """Filter a trajectory, unless that has been done.

    Raises:
        RecordingError: Whatever ``read_trajectory`` refuses.
    """
    if isinstance(recording, Trajectory):
        return recording
    return read_trajectory(recording.parts(), cutoff)


def read_once(
    recordings: Iterable[Source], cutoff: float = DEFAULT_CUTOFF
) -> tuple[list[Trajectory | None], tuple[str, ...], tuple[DataWarning, ...]]:
    """Filter trajectories, each sample once, however often it is given.

    Args:
        recordings: Trajectories; prepared ones are passed on.
        cutoff: Of the torques' low-pass, Hz.

    Returns:
        Trajectories (``None`` where nothing is left), what was left out, and warnings about it.

    Raises:
        RecordingError: Whatever ``read_trajectory`` refuses.
    """
    before = Duplicates()
    found: list[Trajectory | None] = []
    lines: list[str] = []
    warnings: list[DataWarning] = []
    for recording in recordings:
        if isinstance(recording, Trajectory):
            found.append(recording)
            continue
        fresh = before.fresh(recording.parts())
        first = next(fresh, None)
        trajectory = None
        if first is not None:
            try:
                trajectory = read_trajectory(chain([first], fresh), cutoff)
            except RecordingError:
                if not before.skipped:
                    raise
        found.append(None if before.skipped else trajectory)
        if (repeated := before.report()) is not None:
            lines.append(repeated[0])
            warnings += repeated[1]
    return found, tuple(lines), tuple(warnings)


def read_motions(
    recordings: Iterable[Source],
    arm: Arm,
    coordinates: Coordinates,
    cutoff: float = DEFAULT_CUTOFF,
) -> Motions:
    """Filter recordings and transform them to joint space.

    Args:
        recordings: Trajectories with efforts, of all joints unless they carry where the others
            stood.
        arm: The arm, for its transmission.
        coordinates: Of recordings that do not state theirs.
        cutoff: Of the torques' low-pass, Hz.

    Raises:
        RecordingError: No efforts, a joint missing, or whatever ``read_trajectory`` refuses.
    """
    parts: list[CalibrationMotion] = []
    once, left_out, repeated = read_once(recordings, cutoff)
    warnings, handling = list(repeated), list(left_out)
    trajectories = [trajectory for trajectory in once if trajectory is not None]
    same = 1.0 + _SAME_RATE
    rates = [stretch.filter.rate for trajectory in trajectories for stretch in trajectory.stretches]
    sources = [trajectory.source for trajectory in trajectories]
    for source, trajectory in enumerate(trajectories):
        require_all(trajectory, arm, trajectory.still)
        warnings += about(source, sources, trajectory.warnings)
        for warning in trajectory.warnings:
            if warning.kind == "exchanged_joints":  # a diagnosis can say which, a fit cannot
                raise RecordingError(trajectory.source, str(warning))
        handling += [line for line in trajectory.handling if line not in handling]
        for stretch in trajectory.stretches:
            if stretch.filter.rate > same * min(rates):
                stretch = _at_rate(stretch, min(rates))
            parts.append(_motion(stretch, trajectory, arm, coordinates, source))
        efforts = [s.effort for s in trajectory.stretches if s.effort is not None]
        ways = np.ptp(np.concatenate([s.position for s in trajectory.stretches]), axis=0)
        scale = arm.scale[[arm.joint_names.index(joint) for joint in trajectory.joints]]
        moved = ways >= STILL * scale  # efforts of others are not fitted
        require_measured(
            trajectory.source, list(compress(trajectory.joints, moved)),
            np.concatenate(efforts)[:, moved],
        )  # fmt: skip
        seen = np.concatenate(
            [part.state.q[:: max(1, len(part) // 1000)] for part in parts if part.source == source]
        )
        warnings += about(source, sources, beyond_limits(seen, arm))
    if max(rates) > same * min(rates):
        handling.append(f"recordings of several rates, resampled to {min(rates):.6g} Hz")
    return Motions(tuple(parts), tuple(warnings), tuple(handling))


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


def _at_rate(stretch: Stretch, rate: float) -> Stretch:
    """Return a stretch at a lower rate, by cubic splines through low-passed signals."""
    from scipy.interpolate import CubicSpline

    first, last = stretch.time[0], stretch.time[-1]
    time = np.minimum(first + np.arange(int((last - first) * rate + 1e-6) + 1) / rate, last)

    def onto(values: Array) -> Array:
        return np.asarray(CubicSpline(stretch.time, values)(time))

    return Stretch(
        time,
        onto(stretch.position),
        onto(stretch.velocity),
        onto(stretch.acceleration),
        None if stretch.effort is None else onto(stretch.effort),
        replace(stretch.filter, rate=rate),
        stretch.noise,
    )


def _motion(
    stretch: Stretch, trajectory: Trajectory, arm: Arm, coordinates: Coordinates, source: int
) -> CalibrationMotion:
    coordinates = trajectory.coordinates or coordinates
    columns = [arm.joint_names.index(joint) for joint in trajectory.joints]
    q, qd, qdd = stretch.position, stretch.velocity, stretch.acceleration
    effort = stretch.effort
    assert effort is not None
    if len(columns) < arm.n:
        still = np.array([trajectory.still.get(joint, 0.0) for joint in arm.joint_names])
        q = completed(q, columns, still, arm, coordinates)
        qd, qdd = (
            completed(array, columns, np.zeros(arm.n), arm, coordinates) for array in (qd, qdd)
        )
        narrow, effort = effort, np.zeros(q.shape)
        effort[:, columns] = narrow
    measured = motors_measured(columns, arm, coordinates)
    noise = np.full(arm.n, np.nan)
    noise[columns] = band_noise(stretch.noise, stretch.filter.cutoff)
    if coordinates == "actuator":
        q, qd, qdd = (arm.joint_position(array) for array in (q, qd, qdd))
    else:
        effort = arm.actuator_effort(effort)
    if not measured.all():
        effort = np.where(measured, effort, 0.0)
    return CalibrationMotion(
        stretch.time, State(q, qd, qdd), effort, measured, stretch.filter, source, noise,
        ~_frozen(stretch, trajectory, arm, coordinates),
    )  # fmt: skip


def _frozen(stretch: Stretch, trajectory: Trajectory, arm: Arm, coordinates: Coordinates) -> Mask:
    """Return (N, n) samples of motors whose low-passed torque contains a frozen reading."""
    frozen = np.zeros((len(stretch.time), arm.n), dtype=bool)
    reach = stretch.filter.edge / stretch.filter.rate
    for span in trajectory.frozen:
        first, last = span.span
        inside = (stretch.time > first - reach) & (stretch.time < last + reach)
        frozen[inside, arm.joint_names.index(trajectory.joints[span.joint])] = True
    return frozen if coordinates == "actuator" else _motors_loaded(frozen, arm)


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
