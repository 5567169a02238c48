"""A stretch of a recording as parts of a motion, with the steps and the noise of its readings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.motion import MeasuredMotion
from dvrk_gravity.intake import completed
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import FrozenSpan, LowPass, Recording, Segment, frozen_efforts, quantum


def motions(
    stretch: Recording,
    segments: Iterable[Segment],
    model: TorqueModel,
    start: float,
    still: Mapping[str, float],
    thin: int,
) -> list[MeasuredMotion]:
    """Return the segments of a stretch in joint space, beside the model on trial.

    Args:
        stretch: As it was recorded.
        segments: Parts of it, filtered.
        model: The model on trial.
        start: When the stretch began, s.
        still: Where joints stood that were not recorded: joint position, rad.
        thin: Every so-maniest sample is kept.
    """
    step, rounding = _step(stretch, model.arm), _rounding(stretch, model.arm)
    unread = frozen_efforts(stretch)
    pieces = (_piece(segment, thin, model, start, still, step) for segment in segments)
    timed = stretch.velocity is not None
    return [
        _without(
            replace(piece, rounding=rounding, thinned=thin, timed=timed), unread, stretch, start
        )
        for piece in pieces
    ]


def noise_density(recording: Recording, arm: Arm, band: float) -> Array:
    """Return (n,) effort noise in N·m/sqrt(Hz) from what lies above a band; NaN where untold.

    Args:
        recording: Evenly sampled.
        arm: The arm.
        band: Of the kinematics, Hz.
    """
    unknown = np.full(arm.n, np.nan)
    rate = recording.rate
    if rate is None or recording.effort is None or rate < 4.0 * band:
        return unknown
    cutoff = min(1.5 * band, 0.3 * rate)
    low = LowPass(cutoff, rate)
    if len(recording) <= 4 * low.edge:
        return unknown
    columns = [arm.joint_names.index(joint) for joint in recording.joints]
    effort = np.zeros((len(recording), arm.n))
    effort[:, columns] = recording.effort
    if recording.coordinates == "actuator":
        # Of the joints' efforts themselves: the motors' noises need not be independent.
        effort = arm.joint_effort(effort)
    high = effort - low(effort)
    read = np.ones(high.shape, dtype=bool)
    for span in frozen_efforts(recording):
        read[slice(*span.rows), columns[span.joint]] = False
    if recording.coordinates == "actuator":
        read = ~arm.joints_of(~read)
    counted = np.maximum(read[low.edge : -low.edge].sum(axis=0), 1)
    frequency = np.linspace(0.0, rate / 2.0, 2000)
    # Two runs of a second-order Butterworth: amplitude 1 / (1 + (f / fc)^4).
    passed = np.mean((1.0 - 1.0 / (1.0 + (frequency / cutoff) ** 4)) ** 2)
    square = np.where(read, high**2, 0.0)[low.edge : -low.edge].sum(axis=0)
    variance = square / counted / passed
    known = np.isin(np.arange(arm.n), columns)
    return np.where(known, np.sqrt(variance / (rate / 2.0)), np.nan)


def _piece(
    segment: Segment,
    thin: int,
    model: TorqueModel,
    start: float,
    still: Mapping[str, float],
    step: Array,
) -> MeasuredMotion:
    recording, rows = segment.recording, segment.core
    names = model.arm.joint_names

    def full(values: Array | None, fill: float = 0.0) -> Array:
        result = np.full((len(recording), len(names)), fill)
        if values is not None:
            result[:, columns] = values
        return result[rows][::thin]

    columns = [names.index(joint) for joint in recording.joints]
    present = np.isin(np.arange(len(names)), columns)
    q, qd, qdd = full(recording.position), full(recording.velocity), full(segment.acceleration)
    if not present.all():
        there = np.array([still.get(joint, 0.0) for joint in names])
        arm, which = model.arm, recording.coordinates
        q = completed(q[:, columns], columns, there, arm, which)
        there = np.zeros(len(names))
        qd, qdd = (
            completed(values[:, columns], columns, there, arm, which) for values in (qd, qdd)
        )
    effort = full(recording.effort)
    direction = None if recording.direction is None else full(recording.direction, 1.0)
    if recording.coordinates == "actuator":
        arm = model.arm
        q, qd, qdd = (arm.joint_position(array) for array in (q, qd, qdd))
        effort = arm.joint_effort(effort)
        if direction is not None:
            direction = np.sign(arm.joint_position(direction))
    if recording.time is None:
        qd, qdd = np.zeros_like(q), np.zeros_like(q)
        time, rate = np.arange(len(q), dtype=float), None
    else:
        time = recording.time[rows][::thin] + start
        rate = (recording.rate or 1.0) / thin
    parts = (slice(0, len(q)),)
    return MeasuredMotion(model, q, qd, qdd, effort, direction, time, parts, rate, present, step)


def _without(
    piece: MeasuredMotion, spans: Sequence[FrozenSpan], recording: Recording, start: float
) -> MeasuredMotion:
    """Return a piece that knows which of its efforts are no readings.

    Args:
        piece: Of the recording.
        spans: Of the recording's efforts.
        recording: Whose joints, or motors, they are of.
        start: Of the recording, s, in the piece's time.
    """
    if not spans:
        return piece
    arm, wide = piece.arm, piece.settings.smeared
    unread = np.zeros(piece.q.shape, dtype=bool)
    for span in spans:
        column = arm.joint_names.index(recording.joints[span.joint])
        first, last = span.span
        unread[:, column] |= (piece.time >= start + first - wide) & (
            piece.time <= start + last + wide
        )
    if recording.coordinates == "actuator":
        unread = arm.joints_of(unread)
    return replace(piece, unread=unread)


def _step(recording: Recording, arm: Arm) -> Array:
    """Return (n,) steps in which the joints' positions are read, rad; 0 of those that are not."""
    steps = np.zeros(arm.n)
    for joint, column in zip(recording.joints, recording.position.T, strict=True):
        steps[arm.joint_names.index(joint)] = quantum(column)
    if recording.coordinates == "actuator":
        steps = np.abs(arm.actuator_to_joint) @ steps
    return steps


def _rounding(recording: Recording, arm: Arm) -> Array:
    """Return (n,) density of the noise that the steps of the efforts leave, N·m/sqrt(Hz).

    An effort that goes over many steps is rounded by step / sqrt(12), evenly over all frequencies
    up to half the rate (Bennett 1948); one that goes slowly, by as much at lower ones.
    """
    density = np.zeros(arm.n)
    if recording.rate is None or recording.effort is None:
        return density
    for joint, column in zip(recording.joints, recording.effort.T, strict=True):
        density[arm.joint_names.index(joint)] = quantum(column)
    density /= np.sqrt(12.0 * recording.rate / 2.0)
    if recording.coordinates == "actuator":
        density = np.sqrt(density**2 @ arm.joint_effort(np.eye(arm.n)) ** 2)
    return density
