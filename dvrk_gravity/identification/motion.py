"""Trajectories made ready for a fit: motion in joint space, torque at the motors."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from dvrk_gravity.arm import Arm
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.recording import DataWarning, LowPass, Recording, Segment, prepare
from dvrk_gravity.recording.data import Array, Coordinates
from dvrk_gravity.recording.prepare import DEFAULT_CUTOFF
from dvrk_gravity.terms import State

# The motion is filtered less than the torques: friction's sign and products of velocities put
# power above the motion's own frequencies. The columns then go through the torques' filter.
MOTION_BAND = 2.0
# Samples kept for each period of the motion's cut-off: the rest of a fast recording is redundant.
OVERSAMPLING = 16.0


@dataclass(frozen=True, eq=False)
class Motion:
    """A gap-free part of a recording.

    Attributes:
        time: (N,) s.
        state: (N, 7) positions, velocities, accelerations in joint space.
        effort: (N, 7) torque at the motors, low-passed, N·m.
        filter: The low-pass of ``effort``, at the rate of these samples.
        source: Index of the recording that it came from.
    """

    time: Array
    state: State
    effort: Array
    filter: LowPass
    source: int

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.time)


@dataclass(frozen=True, eq=False)
class Motions:
    """All parts of some recordings, and what was found and done on the way."""

    parts: tuple[Motion, ...]
    warnings: tuple[DataWarning, ...]
    handling: tuple[str, ...]


def read_motions(
    recordings: Iterable[Recording],
    arm: Arm,
    coordinates: Coordinates,
    cutoff: float = DEFAULT_CUTOFF,
) -> Motions:
    """Filter recordings and bring them to joint space.

    Args:
        recordings: Trajectories of all seven joints with efforts.
        arm: The arm, for its transmission.
        coordinates: What the recordings' columns are.
        cutoff: Of the torques' low-pass, Hz.

    Raises:
        RecordingError: No efforts, a joint missing, or whatever ``prepare`` refuses.
    """
    parts: list[Motion] = []
    warnings: list[DataWarning] = []
    handling: list[str] = []
    for source, recording in enumerate(recordings):
        require_all(recording, arm)
        wide = prepare(recording, MOTION_BAND * cutoff)
        narrow = prepare(recording, cutoff)
        warnings += narrow.warnings
        handling += [line for line in narrow.handling if line not in handling]
        # The wider filter has the shorter edge, so it may keep short parts that the other drops.
        starts = {float(segment.recording.time[0]): segment for segment in wide.segments
                  if segment.recording.time is not None}  # fmt: skip
        for segment in narrow.segments:
            time = segment.recording.time
            assert time is not None
            assert narrow.filter is not None
            moving = starts[float(time[0])]
            parts.append(
                _motion(moving, segment.recording.effort, arm, coordinates, narrow.filter, source)
            )
    handling.append(
        f"motion low-passed at {MOTION_BAND * cutoff:g} Hz; the model's torque then goes through "
        f"the same {cutoff:g} Hz filter as the measured one"
    )
    return Motions(tuple(parts), tuple(warnings), tuple(handling))


def require_all(recording: Recording, arm: Arm) -> None:
    """Refuse a recording without efforts or without one of the joints.

    Raises:
        RecordingError: Naming what is missing.
    """
    missing = [joint for joint in arm.joint_names if joint not in recording.joints]
    if missing:
        raise RecordingError(
            recording.source,
            f"has no {', '.join(missing)}: expected all of {', '.join(arm.joint_names)}",
        )
    if recording.effort is None:
        raise RecordingError(recording.source, "has no efforts, expected <joint>.effort columns")


def _motion(
    segment: Segment,
    effort: Array | None,
    arm: Arm,
    coordinates: Coordinates,
    low: LowPass,
    source: int,
) -> Motion:
    recording = segment.recording
    time, q, qd, qdd = (
        recording.time,
        recording.position,
        recording.velocity,
        segment.acceleration,
    )
    assert time is not None
    assert qd is not None
    assert qdd is not None
    assert effort is not None
    stride = max(1, int(low.rate / (OVERSAMPLING * MOTION_BAND * low.cutoff)))
    rows = slice(None, None, stride)
    q, qd, qdd, effort = q[rows], qd[rows], qdd[rows], effort[rows]
    if coordinates == "actuator":
        q, qd, qdd = (arm.joint_position(array) for array in (q, qd, qdd))
    else:
        effort = arm.actuator_effort(effort)
    slower = LowPass(low.cutoff, low.rate / stride, low.order)
    return Motion(time[rows], State(q, qd, qdd), effort, slower, source)
