"""Recordings put right by what a model knows to be wrong with its arm's readings.

Time first, then what each sample reads, then efforts laid over the positions they belong to. What
is above a limit of the reading was never read: such efforts are marked, and used by nobody.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import get_args

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import ReadingErrors
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Coordinates, Note, Recording, limited_efforts

_GAP = 3.0  # median intervals, across which efforts are not interpolated. Chosen


def without_known_errors(
    recordings: Iterable[Recording],
    model: TorqueModel,
    coordinates: Coordinates | None = None,
) -> tuple[list[Recording], tuple[Note, ...]]:
    """Return recordings as they would be read correctly, and a note on what was done.

    Args:
        recordings: Trajectories or static poses.
        model: What is known of the arm's readings, ``TorqueModel.reading_errors``.
        coordinates: Of recordings that do not state theirs; ``None``: joint.

    Raises:
        RecordingError: A recording without a joint whose position or effort is part of another's,
            or of which nothing is left.
    """
    errors = model.reading_errors
    if coordinates not in (None, errors.coordinates):  # those of the recordings are given
        errors = replace(errors, coordinates="")
    known = ", ".join(replace(model, reading_errors=errors).of_readings())
    if not errors.any:
        return list(recordings), ()
    line = (
        f"recordings are corrected for the model's known errors of readings: {known}; if the arm "
        "reads correctly by now, remove them from the model"
    )
    note = Note("known_errors", None, {}, line)
    return [_corrected(each, errors, model.arm, coordinates) for each in recordings], (note,)


def stated_coordinates(model: TorqueModel) -> Coordinates | None:
    """Return the coordinates of recordings that do not state theirs, if a model knows them."""
    known = model.reading_errors.coordinates
    return next((system for system in get_args(Coordinates) if system == known), None)


def _corrected(
    recording: Recording, errors: ReadingErrors, arm: Arm, coordinates: Coordinates | None
) -> Recording:
    position, effort = _inverted(errors, arm, recording, coordinates)
    columns = [arm.joint_names.index(joint) for joint in recording.joints]
    limit = errors.true_limit()
    limits = {n: float(v) for n, v in zip(arm.joint_names, limit, strict=True) if np.isfinite(v)}
    velocity, direction = recording.velocity, recording.direction
    result: Recording | None = replace(
        recording,
        time=None if recording.time is None else recording.time / errors.clock,
        position=_mapped(position, recording.position),
        velocity=None
        if velocity is None
        else _mapped(position, velocity / errors.velocity[columns]),
        effort=None if recording.effort is None else _mapped(effort, recording.effort),
        direction=None
        if direction is None
        else np.where(_mapped(position, direction) < 0.0, -1.0, 1.0),
        effort_limit={**recording.effort_limit, **limits},
    )
    assert result is not None
    if recording.time is None and limits:
        read = np.ones(len(result), dtype=bool)
        for span in limited_efforts(result):
            read[slice(*span.rows)] = False
        result = result.rows(read) if read.any() else None
    elif recording.time is not None and errors.delay:
        result = _aligned(result, errors.delay)
    if result is None:
        raise RecordingError(
            recording.source,
            "nothing is left of it: every sample is at reading.effort_limit, or it is shorter than "
            "reading.effort_delay, by the model",
        )
    return result


def _inverted(
    errors: ReadingErrors, arm: Arm, part: Recording, coordinates: Coordinates | None
) -> tuple[Array, Array]:
    """Return the (k, k) maps from read positions and efforts of a part's joints to true ones."""
    position, effort = errors.position, errors.effort
    if "actuator" in (part.coordinates, coordinates):
        forth, back = arm.actuator_to_joint, arm.joint_to_actuator
        position, effort = back @ position @ forth, forth.T @ effort @ back.T
    columns = [arm.joint_names.index(joint) for joint in part.joints]
    absent = [index for index in range(arm.n) if index not in columns]
    for what, read in (("position", position), ("effort", effort)):
        rows, mixed = np.nonzero(read[np.ix_(columns, absent)])
        if len(rows):
            joint, other = part.joints[rows[0]], arm.joint_names[absent[mixed[0]]]
            raise RecordingError(
                part.source,
                f"lacks {other}, of which the {what} read at {joint} has a part by the model "
                f"(reading.*): record all joints",
            )
    few = np.ix_(columns, columns)
    true = (np.asarray(np.linalg.inv(read[few])) for read in (position, effort))
    return next(true), next(true)


def _mapped(by: Array, values: Array) -> Array:
    """Return (N, k) values through a (k, k) map; NaN where one of them is that was not recorded."""
    unknown = np.isnan(values).all(axis=0)
    result = np.where(unknown, 0.0, values) @ by.T
    result[:, (by[:, unknown] != 0.0).any(axis=1)] = np.nan
    return result


def _aligned(recording: Recording, delay: float) -> Recording | None:
    """Return the samples with the efforts of ``delay`` s later, if any.

    Samples whose efforts lie beyond the end of the recording, or in a gap, are left out.
    """
    from scipy.interpolate import CubicSpline  # slow to load

    time, effort = recording.time, recording.effort
    assert time is not None
    then = time + delay
    rows = (then >= time[0]) & (then <= time[-1])
    if effort is None or not rows.any():
        return recording.rows(rows) if rows.any() else None
    left = np.clip(np.searchsorted(time, then, side="right") - 1, 0, len(time) - 2)
    interval = np.diff(time)
    rows &= interval[left] <= _GAP * np.median(interval)
    if not rows.any():
        return None
    known = ~np.isnan(effort).any(axis=0)
    moved = effort.copy()
    moved[:, known] = CubicSpline(time, effort[:, known])(then)
    # What stayed the same stays so to the last bit, by which frozen and clipped efforts are known.
    same = effort[left] == effort[left + 1]
    return replace(recording, effort=np.where(same, effort[left], moved)).rows(rows)
