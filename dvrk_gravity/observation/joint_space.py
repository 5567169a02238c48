"""A filtered recording in joint space."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import compress

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.observation.absent_joints import completed, motors_measured
from dvrk_gravity.observation.observation import Observation
from dvrk_gravity.recording import (
    STILL,
    Bands,
    InvalidSpan,
    Prepared,
    Recording,
    clipped_efforts,
    invalid_efforts,
    noise_density,
    quantum,
)

# Rate over the cut-off above which noise is seen, at least. Chosen: a low-pass passes little above.
_NOISE_RATE = 8.0 / 3.0
# s, by which low-passes early or late at 20 Hz smear a wrong effort: half a period.
SMEARED = 0.025
_SAME_EFFORT = 1e-9  # relative: what filters make of one number


def in_joint_space(
    prepared: Prepared, arm: Arm, fixed_positions: Mapping[str, float] | None = None
) -> Observation:
    """Return what a recording shows of an arm.

    Args:
        prepared: With efforts.
        arm: The arm, for its transmission.
        fixed_positions: Where joints stood that it lacks, rad; at zero, otherwise.

    Raises:
        RecordingError: Efforts that no model can be fitted to, where one is to be.
    """
    recording, bands, static = prepared.recording, prepared.bands, prepared.filter is None
    if bands.for_fit and not static:
        _require_fittable(prepared, arm)
    columns = [arm.joint_names.index(joint) for joint in recording.joints]
    actuator = recording.coordinates == "actuator"

    def full(values: Array, fill: float = 0.0) -> Array:
        result = np.full((len(values), arm.n), fill)
        result[:, columns] = values
        return result

    def positions(values: Array, stood: Array) -> Array:
        if len(columns) < arm.n:
            values = completed(values, columns, stood, arm, recording.coordinates)
        return arm.joint_position(values) if actuator else values

    stood = np.array([(fixed_positions or {}).get(joint, 0.0) for joint in arm.joint_names])
    own = prepared.filtered
    assert own.effort is not None
    q, torque = positions(own.position, stood), full(own.effort)
    qd = qdd = np.zeros_like(q)
    if own.velocity is not None and not static:
        qd, qdd = (
            positions(each, np.zeros(arm.n)) for each in (own.velocity, prepared.acceleration)
        )
    time = np.arange(len(q), dtype=float) if own.time is None else own.time
    spans = invalid_efforts(recording) + (clipped_efforts(recording) if bands.for_fit else [])
    invalid_effort, invalid_motor_effort = _both(
        _invalid(time, spans, prepared, columns, arm), arm, actuator
    )
    noise, motor_noise = _noise(recording, full, spans, columns, arm, bands)
    present = np.isin(np.arange(arm.n), columns)
    measured = motors_measured(columns, arm, recording.coordinates)
    return Observation(
        q=q, qd=qd, qdd=qdd, effort=arm.joint_effort(torque) if actuator else torque,
        # Each joint's own, in either coordinates.
        direction=None if own.direction is None else full(own.direction, 1.0),
        time=time, parts=prepared.parts,
        rate=None if prepared.filter is None else prepared.filter.rate,
        present=present, measured=measured, invalid_effort=invalid_effort,
        invalid_motor_effort=invalid_motor_effort,
        step=_step(recording, full, arm), thinned=prepared.stride,
        rounding=_rounding(recording, full, arm),
        noise=np.where(present, noise, np.nan), motor_noise=np.where(measured, motor_noise, np.nan),
        timed=recording.velocity is not None, filter=prepared.filter, start_ns=recording.start_ns,
        sources=(recording.source,), coordinates=recording.coordinates, warnings=prepared.warnings,
        processing_log=prepared.processing_log,
    )  # fmt: skip


def _require_fittable(prepared: Prepared, arm: Arm) -> None:
    """Refuse exchanged joints, and constant efforts of joints that move."""
    recording = prepared.recording
    for warning in prepared.warnings:
        if warning.kind == "exchanged_joints":  # a diagnosis can say which, a fit cannot
            raise RecordingError(recording.source, str(warning))
    columns = [arm.joint_names.index(joint) for joint in recording.joints]
    moved = np.ptp(prepared.filtered.position, axis=0) >= STILL * arm.scale[columns]
    effort = prepared.filtered.effort
    assert effort is not None
    require_measured(recording.source, list(compress(recording.joints, moved)), effort[:, moved])


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


def _both(columns: Mask, arm: Arm, actuator: bool) -> tuple[Mask, Mask]:
    """Return (N, n) joints and motors whose efforts contain some of those recorded."""
    if actuator:
        return arm.joints_of(columns), columns
    return columns, motors_loaded(columns, arm)


def motors_loaded(joints: Mask, arm: Arm) -> Mask:
    """Return (…, n) motors that carry part of the torque of some of (…, n) joints."""
    return np.asarray(joints @ (arm.actuator_to_joint != 0.0))


def _invalid(
    time: Array, spans: list[InvalidSpan], prepared: Prepared, columns: list[int], arm: Arm
) -> Mask:
    """Return (N, n) low-passed efforts that contain one that is not a reading."""
    low, found = prepared.filter, np.zeros((len(time), arm.n), dtype=bool)
    reach = low.edge / low.rate if prepared.bands.for_fit and low is not None else SMEARED
    for span in spans:
        first, last = span.span
        found[(time >= first - reach) & (time <= last + reach), columns[span.joint]] = True
    return found


def _noise(
    recording: Recording, full: Callable[[Array], Array], spans: list[InvalidSpan],
    columns: list[int], arm: Arm, bands: Bands,
) -> tuple[Array, Array]:  # fmt: skip
    """Return (n,) densities of the noise of efforts of joints and motors, N·m/sqrt(Hz).

    Each from its own efforts: the motors' noises need not be independent.
    """
    time, rate, effort = recording.time, recording.rate, recording.effort
    if time is None or rate is None or effort is None or rate < _NOISE_RATE * bands.noise:
        return np.full(arm.n, np.nan), np.full(arm.n, np.nan)
    torque, wrong = full(effort), np.zeros((len(effort), arm.n), dtype=bool)
    for span in spans:
        wrong[slice(*span.rows), columns[span.joint]] = True
    above = min(bands.noise, 0.3 * rate)
    if arm.direct_drive:
        density = noise_density(time, torque, ~wrong, above, rate)
        return density, density
    actuator = recording.coordinates == "actuator"
    joint = arm.joint_effort(torque) if actuator else torque
    motor = torque if actuator else arm.actuator_effort(torque)
    wrong_joint, wrong_motor = _both(wrong, arm, actuator)
    return (
        noise_density(time, joint, ~wrong_joint, above, rate),
        noise_density(time, motor, ~wrong_motor, above, rate),
    )


def _step(recording: Recording, full: Callable[[Array], Array], arm: Arm) -> Array:
    """Return (n,) resolution of the joints' positions, rad; 0 of those not recorded."""
    steps = full(_quanta(recording.position))[0]
    return np.abs(arm.actuator_to_joint) @ steps if recording.coordinates == "actuator" else steps


def _rounding(recording: Recording, full: Callable[[Array], Array], arm: Arm) -> Array:
    """Return (n,) noise density of rounded efforts, N·m/sqrt(Hz).

    An effort that passes many steps is rounded by step / sqrt(12), evenly over all frequencies up
    to half the rate (Bennett 1948); one that changes slowly, by as much at lower ones.
    """
    if recording.rate is None or recording.effort is None:
        return np.zeros(arm.n)
    density = full(_quanta(recording.effort))[0] / np.sqrt(12.0 * recording.rate / 2.0)
    if recording.coordinates == "actuator":
        density = np.sqrt(density**2 @ arm.joint_effort(np.eye(arm.n)) ** 2)
    return density


def _quanta(values: Array) -> Array:
    """Return (1, k) steps of (N, k) columns."""
    return np.array([[quantum(column) for column in values.T]])


def without_standing(
    parts: Sequence[Observation], arm: Arm
) -> tuple[list[Observation], tuple[str, ...]]:
    """Return parts without the torque of joints that never move, and the names of these joints.

    Friction may hold any torque there up to its level, and so at every motor that carries part of
    such a joint's torque.
    """
    lower = np.min([part.q.min(axis=0) for part in parts], axis=0)
    upper = np.max([part.q.max(axis=0) for part in parts], axis=0)
    standing = stands(lower, upper, arm)
    loaded = motors_loaded(standing, arm)
    without = [
        replace(part, invalid_motor_effort=part.invalid_motor_effort | loaded) for part in parts
    ]
    return without, tuple(compress(arm.joint_names, standing))


def stands(lower: Array, upper: Array, arm: Arm) -> Mask:
    """Return (n,) joints that friction may hold all the time, by their least and greatest q."""
    return np.asarray((upper - lower < STILL * arm.scale) & arm.has_friction)
