"""Trajectories made ready for a fit: motion in joint space, torque at the motors."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, compress
from numbers import Real

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import State
from dvrk_gravity.errors import ArgumentError, RecordingError
from dvrk_gravity.identification.hand import beyond_limits
from dvrk_gravity.model import parts
from dvrk_gravity.parameters import is_finite
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

# What can be fitted to: in memory, in a file, or prepared already.
Source = Recording | RecordingFile | Trajectory

_SAME = 1e-9  # of an effort: what filters make of one number
_PARTS = 3  # of a robot that a refusal names


@dataclass(frozen=True)
class RateSettings:
    """When recordings count as of one rate.

    Attributes:
        same: Relative difference of two clocks of one rate. Chosen: more than
            clocks differ by, less than any two rates in use.
    """

    same: float = 1e-3


@dataclass(frozen=True, eq=False)
class CalibrationMotion:
    """A gap-free part of a recording.

    Attributes:
        time: (N,) s.
        state: (N, n) positions, velocities, accelerations in joint space.
        effort: (N, n) torque at the motors, low-passed, N·m; zero where not measured.
        measured: (n,) motors whose torque was measured.
        told: (N, n) samples of the motors whose torque says something; by default all.
        filter: The low-pass of ``effort``, at the rate of these samples.
        source: Index of the recording that it came from.
    """

    time: Array
    state: State
    effort: Array
    measured: NDArray[np.bool_]
    filter: LowPass
    source: int
    told: NDArray[np.bool_] = field(default_factory=lambda: np.ones((), dtype=bool))

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.time)


@dataclass(frozen=True, eq=False)
class Motions:
    """All parts of some recordings, and what was found and done on the way."""

    parts: tuple[CalibrationMotion, ...]
    warnings: tuple[DataWarning, ...]
    handling: tuple[str, ...]


def all_static(recordings: Sequence[Recording | RecordingFile]) -> bool:
    """Return whether recordings hold static poses.

    Raises:
        RecordingError: Poses mixed with trajectories.
    """
    heads = [recording.head for recording in recordings]
    static = [isinstance(first, Recording) and first.time is None for first in heads]
    if any(static) != all(static):
        raise RecordingError(
            heads[static.index(True)].source,
            "holds static poses, expected trajectories only or poses only",
        )
    return static[0]


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
    """Filter trajectories without what was read before, in them or in others before them.

    Args:
        recordings: Trajectories; what is prepared already is passed on.
        cutoff: Of the torques' low-pass, Hz.

    Returns:
        Trajectories, ``None`` for those of which nothing is left; what was left out, and warnings
        of it.

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
        if (told := before.report()) is not None:
            lines.append(told[0])
            warnings += told[1]
    return found, tuple(lines), tuple(warnings)


def read_motions(
    recordings: Iterable[Source],
    arm: Arm,
    coordinates: Coordinates,
    cutoff: float = DEFAULT_CUTOFF,
) -> Motions:
    """Filter recordings and bring them to joint space.

    Args:
        recordings: Trajectories with efforts, of all joints unless they tell where the
            others stood.
        arm: The arm, for its transmission.
        coordinates: What the columns are of recordings that do not tell themselves.
        cutoff: Of the torques' low-pass, Hz.

    Raises:
        RecordingError: No efforts, a joint missing, or whatever ``read_trajectory`` refuses.
    """
    parts: list[CalibrationMotion] = []
    once, left_out, repeated = read_once(recordings, cutoff)
    warnings, handling = list(repeated), list(left_out)
    trajectories = [trajectory for trajectory in once if trajectory is not None]
    same = 1.0 + RateSettings().same
    rates = [stretch.filter.rate for trajectory in trajectories for stretch in trajectory.stretches]
    sources = [trajectory.source for trajectory in trajectories]
    for source, trajectory in enumerate(trajectories):
        require_all(trajectory, arm, trajectory.still)
        warnings += about(source, sources, trajectory.warnings)
        for warning in trajectory.warnings:
            if warning.kind == "exchanged_joints":  # a diagnosis can tell which, a fit cannot
                raise RecordingError(trajectory.source, str(warning))
        handling += [line for line in trajectory.handling if line not in handling]
        for stretch in trajectory.stretches:
            if stretch.filter.rate > same * min(rates):
                stretch = _at_rate(stretch, min(rates))
            parts.append(_motion(stretch, trajectory, arm, coordinates, source))
        _require_torque(trajectory)
        seen = np.concatenate(
            [part.state.q[:: max(1, len(part) // 1000)] for part in parts if part.source == source]
        )
        warnings += about(source, sources, beyond_limits(seen, arm))
    if max(rates) > same * min(rates):
        handling.append(f"recordings of several rates, brought to {min(rates):.6g} Hz")
    return Motions(tuple(parts), tuple(warnings), tuple(handling))


def known_still(still: Mapping[str, float] | None, arm: Arm) -> Mapping[str, float]:
    """Return where joints of an arm stood, an empty mapping where that is not said.

    Raises:
        ArgumentError: What is no mapping from the joints' names to positions.
    """
    if still is None:
        return {}
    if not isinstance(still, Mapping):
        raise ArgumentError("still", still, "a mapping from joints' names to positions, rad")
    for name, position in still.items():
        if name not in arm.joint_names:
            raise ArgumentError("still", name, f"some of {', '.join(arm.joint_names)}")
        if not isinstance(position, Real) or not is_finite(float(position)):
            raise ArgumentError(f"still of {name}", position, "a number, rad or m")
    return still


def _example(arm: Arm, joint: str) -> str:
    """Return a position of a joint as options take it."""
    turns = arm.joints[arm.joint_names.index(joint)].kind == "revolute"
    return "0deg" if turns else "0mm"


def require_all(
    recording: Recording | Trajectory, arm: Arm, still: Mapping[str, float] | None = None
) -> None:
    """Refuse a recording without efforts, or without a joint of which nothing is known.

    Raises:
        RecordingError: Naming what is missing.
    """
    missing = [joint for joint in arm.joint_names if joint not in recording.joints]
    unknown = [joint for joint in missing if joint not in (still or {})]
    if unknown:
        expected = "all joints"
        if still is not None:  # only a fit to trajectories can do with less
            at = f"--at {unknown[0]}={_example(arm, unknown[0])},..."
            expected += f", or `{at}` to say where those stood that were not recorded"
        if some := " or ".join(parts(arm, recording.joints)[:_PARTS]):
            expected += f", or a part of the robot: --arm {some}"
        raise RecordingError(recording.source, f"has no {', '.join(unknown)}: expected {expected}")
    if isinstance(recording, Trajectory):
        without = any(stretch.effort is None for stretch in recording.stretches)
    else:
        without = recording.effort is None
    if without:
        raise RecordingError(recording.source, "has no efforts, expected <joint>.effort columns")


def _require_torque(trajectory: Trajectory) -> None:
    """Refuse efforts that were not measured."""
    efforts = [s.effort for s in trajectory.stretches if s.effort is not None]
    require_measured(trajectory.source, trajectory.joints, np.concatenate(efforts))


def require_measured(source: str, joints: Sequence[str], effort: Array) -> None:
    """Refuse (N, n) efforts that one number stands for on a joint: zeros, or what a sensor died at.

    Raises:
        RecordingError: Naming the joints.
    """
    least, greatest = effort.min(axis=0), effort.max(axis=0)
    same = greatest - least <= _SAME * np.abs(effort).max(axis=0)
    if same.any():
        named = ", ".join(joint for joint, never in zip(joints, same, strict=True) if never)
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
    if coordinates == "actuator":
        q, qd, qdd = (arm.joint_position(array) for array in (q, qd, qdd))
    else:
        effort = arm.actuator_effort(effort)
    if not measured.all():
        effort = np.where(measured, effort, 0.0)
    told = ~_unread(stretch, trajectory, arm, coordinates)
    return CalibrationMotion(
        stretch.time, State(q, qd, qdd), effort, measured, stretch.filter, source, told
    )


def _unread(
    stretch: Stretch, trajectory: Trajectory, arm: Arm, coordinates: Coordinates
) -> NDArray[np.bool_]:
    """Return (N, n) samples of motors in whose low-passed torque there are no readings."""
    unread = np.zeros((len(stretch.time), arm.n), dtype=bool)
    reach = stretch.filter.edge / stretch.filter.rate
    for span in trajectory.frozen:
        first, last = span.span
        inside = (stretch.time > first - reach) & (stretch.time < last + reach)
        unread[inside, arm.joint_names.index(trajectory.joints[span.joint])] = True
    return unread if coordinates == "actuator" else _felt(unread, arm)


def _felt(joints: NDArray[np.bool_], arm: Arm) -> NDArray[np.bool_]:
    """Return (…, n) motors that take a part of the torque of some of (…, n) joints."""
    return np.asarray(joints @ (arm.actuator_to_joint != 0.0))


def without_standing(
    motions: Sequence[CalibrationMotion], arm: Arm
) -> tuple[list[CalibrationMotion], tuple[str, ...]]:
    """Return motions of which the torque says nothing where a joint never moves, and these joints.

    Friction may hold any torque there up to its level. A motor says nothing if it takes a part of
    such a joint's.
    """
    lower = np.min([motion.state.q.min(axis=0) for motion in motions], axis=0)
    upper = np.max([motion.state.q.max(axis=0) for motion in motions], axis=0)
    standing = stands(lower, upper, arm)
    felt = _felt(standing, arm)
    parts = [replace(motion, told=motion.told & ~felt) for motion in motions]
    return parts, tuple(compress(arm.joint_names, standing))


def stands(lower: Array, upper: Array, arm: Arm) -> NDArray[np.bool_]:
    """Return (n,) joints that friction may hold all the time, by their least and greatest q."""
    return np.asarray((upper - lower < STILL * arm.scale) & arm.rubs)


def motors_measured(
    columns: Sequence[int], arm: Arm, coordinates: Coordinates
) -> NDArray[np.bool_]:
    """Return (n,) whether the efforts of some columns tell a motor's torque.

    tau_actuator = M^T tau_joint: of a joint's torques, all must be known that a motor adds to.
    """
    known = np.isin(np.arange(arm.n), columns)
    if coordinates == "actuator":
        return known
    return ~np.any((arm.actuator_to_joint != 0.0) & ~known[:, None], axis=0)


def completed(
    values: Array, columns: Sequence[int], still: Array, arm: Arm, coordinates: Coordinates
) -> Array:
    """Return (N, n) from the (N, k) columns of some joints.

    Args:
        values: (N, n), in the coordinates.
        columns: Indices of the joints.
        still: (n,) where the other *joints* are.
        arm: The arm.
        coordinates: Of values and result.
    """
    result = np.tile(still, (len(values), 1))
    result[:, columns] = values
    if coordinates == "actuator":
        # The motors of joints that stand still follow the recorded ones.
        others = [joint for joint in range(arm.n) if joint not in columns]
        matrix = arm.actuator_to_joint
        follow = still[others] - values @ matrix[np.ix_(others, columns)].T
        result[:, others] = np.linalg.solve(matrix[np.ix_(others, others)], follow.T).T
    return result
