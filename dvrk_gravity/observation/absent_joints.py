"""Joints of the arm that a recording lacks: fingers, a rail, joints held still."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from numbers import Real

import numpy as np

from dvrk_gravity.arms import STAYS, Arm, distal_held_joints, is_mtm
from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.errors import ArgumentError, RecordingError
from dvrk_gravity.model import parts
from dvrk_gravity.parameters import is_finite
from dvrk_gravity.recording import (
    Coordinates,
    Kind,
    Note,
    Recording,
    opened,
)

_MOVES = "has positions, but no efforts (none is a number that an effort can be)"
_PARTS = 3  # of a robot that a refusal names


def all_static(recordings: Sequence[Recording]) -> bool:
    """Return whether recordings hold static poses.

    Raises:
        RecordingError: Poses mixed with trajectories.
    """
    static = [recording.time is None for recording in recordings]
    if any(static) != all(static):
        raise RecordingError(
            recordings[static.index(True)].source,
            "holds static poses, expected trajectories only or poses only",
        )
    return static[0]


def known_fixed_positions(
    fixed_positions: Mapping[str, float] | None, arm: Arm
) -> Mapping[str, float]:
    """Return where joints of an arm stood; an empty mapping if that was not given.

    Raises:
        ArgumentError: Not a mapping from the joints' names to positions.
    """
    if fixed_positions is None:
        return {}
    if not isinstance(fixed_positions, Mapping):
        raise ArgumentError(
            "still", fixed_positions, "a mapping from joints' names to positions, rad"
        )
    for name, position in fixed_positions.items():
        if name not in arm.joint_names:
            raise ArgumentError("still", name, f"some of {', '.join(arm.joint_names)}")
        if not isinstance(position, Real) or not is_finite(float(position)):
            raise ArgumentError(f"still of {name}", position, "a number, rad or m")
    return fixed_positions


def held_beyond(
    recordings: Sequence[Recording], arm: Arm, fixed_positions: Mapping[str, float]
) -> tuple[dict[str, float], tuple[Note, ...]]:
    """Return where unrecorded joints stood, and a note on those that were assumed.

    Joints beyond all recorded ones are assumed held at zero, or at the limit next to it.
    An MTM's recording has all seven joints; there, a missing one is a mistake.
    """
    seen = _recorded(recordings)
    moving = {note.joint for each in recordings for note in _notes(each, "effort_missing")}
    missing = [
        joint for joint in arm.joint_names if joint not in (*seen, *fixed_positions, *moving)
    ]
    if not missing or is_mtm(arm):
        return dict(fixed_positions), ()
    # A joint whose position is given may itself be carried by one that is beyond.
    where = (
        distal_held_joints(arm, seen) or distal_held_joints(arm, (*seen, *fixed_positions)) or {}
    )
    where = {name: position for name, position in where.items() if name in missing}
    if not where:
        return dict(fixed_positions), ()
    return {**fixed_positions, **where}, (_held("not recorded, assumed held", where),)


def _held(how: str, where: Mapping[str, float]) -> Note:
    return Note("held_joints", None, {}, f"{how} (rad, m): {_shown(where)}")


def with_held(
    recordings: Sequence[Recording], arm: Arm, fixed_positions: Mapping[str, float]
) -> tuple[Arm, list[Recording], tuple[Note, ...]]:
    """Return the arm without the joints beyond all recorded ones, and notes that name them.

    They stand where it was given, or at zero. Joints with a given position that no recording has,
    or that stood there in all of them, are dropped, too: nothing of them moved. Where motors share
    joints, of trajectories, those alone that lie beyond.
    """
    stood, notes = held_beyond(recordings, arm, fixed_positions)
    held = {name: at for name, at in stood.items() if name not in fixed_positions}
    if fixed_positions and not is_mtm(arm):
        seen = _recorded(recordings)
        free = all_static(recordings) or arm.direct_drive
        ends = fixed_positions if free else distal_held_joints(arm, seen) or ()
        given = {
            name: at
            for name, at in fixed_positions.items()
            if name in ends and (name not in seen or (free and _stood(recordings, name, at)))
        }
        held |= given
        notes += (_held("held as given", given),) if given else ()
    if not held:
        return arm, list(recordings), ()
    arm = arm.with_held_joints(held)
    left_out = tuple(replace(note, text=f"{note.text}: not joints of the model") for note in notes)
    return arm, opened(recordings, arm=arm), left_out


def stood_at(recording: Recording, joint: str, position: float) -> bool:
    """Return whether a recording has a joint, and has it at a position, rad or m, all the time."""
    if joint not in recording.joints:
        return False
    low, high = travel(recording, joint)
    return position - STAYS < low and high < position + STAYS


def travel(recording: Recording, joint: str) -> tuple[float, float]:
    """Return the lowest and highest position of a recorded joint, rad or m."""
    position = recording.position[:, recording.joint(joint)]
    return float(position.min()), float(position.max())


def _stood(recordings: Iterable[Recording], joint: str, position: float) -> bool:
    return all(stood_at(recording, joint, position) for recording in recordings)


def _recorded(recordings: Iterable[Recording]) -> tuple[str, ...]:
    return tuple({joint for recording in recordings for joint in recording.joints})


def _notes(recording: Recording, kind: Kind) -> Iterator[Note]:
    """Yield the reader's notes of a kind about a recording's joints."""
    return (note for note in recording.notes if note.kind == kind and note.joint)


def _shown(where: Mapping[str, float]) -> str:
    return ", ".join(f"{name} at {position:g}" for name, position in where.items())


def require_all(
    recording: Recording, arm: Arm, fixed_positions: Mapping[str, float] | None = None
) -> None:
    """Refuse a recording without efforts, or without a joint whose position is not known.

    Raises:
        RecordingError: Naming what is missing.
    """
    unknown = [
        name
        for name in arm.joint_names
        if name not in (*recording.joints, *(fixed_positions or {}))
    ]
    if unknown:
        what = f"has no {', '.join(unknown)}"
        expected = "all joints"
        moving = [n.joint for n in _notes(recording, "effort_missing") if n.joint in unknown]
        if moving:
            what = f"{', '.join(filter(None, moving))}: {_MOVES}"
            expected = "measured ones"
        elif fixed_positions is not None:  # only a fit to trajectories can do with less
            turns = arm.joints[arm.joint_names.index(unknown[0])].kind == "revolute"
            at = f"--at {unknown[0]}={'0deg' if turns else '0mm'},..."
            expected += f", or `{at}` for the positions of joints that were not recorded"
        if some := " or ".join(parts(arm, recording.joints)[:_PARTS]):
            expected += f", or a part of the robot: --arm {some}"
        raise RecordingError(recording.source, f"{what}: expected {expected}")
    if recording.effort is None:
        read = "".join(f"; {note.text}" for note in recording.notes if note.kind == "columns")
        expected = f"<joint>.effort columns{read}"
        raise RecordingError(recording.source, f"has no efforts, expected {expected}")


def motors_measured(columns: Sequence[int], arm: Arm, coordinates: Coordinates) -> Mask:
    """Return (n,) the motors whose torque the efforts of some columns determine.

    tau_actuator = M^T tau_joint: all joint torques that a motor contributes to must be known.
    """
    known = np.isin(np.arange(arm.n), columns)
    if coordinates == "actuator":
        return known
    return ~np.any((arm.actuator_to_joint != 0.0) & ~known[:, None], axis=0)


def completed(
    values: Array,
    columns: Sequence[int],
    fixed_positions: Array,
    arm: Arm,
    coordinates: Coordinates,
) -> Array:
    """Return (N, n) positions from the (N, k) columns of some joints.

    Args:
        values: (N, k), in the coordinates.
        columns: (k,) indices of the joints.
        fixed_positions: (n,) where the other *joints* are.
        arm: The arm.
        coordinates: Of values and result.
    """
    result = np.tile(fixed_positions, (len(values), 1))
    result[:, columns] = values
    if coordinates == "actuator":
        # The motors of joints that stand still follow the recorded ones.
        others = [joint for joint in range(arm.n) if joint not in columns]
        matrix = arm.actuator_to_joint
        follow = fixed_positions[others] - values @ matrix[np.ix_(others, columns)].T
        result[:, others] = np.linalg.solve(matrix[np.ix_(others, others)], follow.T).T
    return result
