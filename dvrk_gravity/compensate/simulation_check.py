"""Given and extended model in the simulator: predicted motion, and drift under compensation.

Both with the model's own friction. The drift is what a hand feels if the extended model is true.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arrays import Array
from dvrk_gravity.compensate.settings import Settings
from dvrk_gravity.diagnosis import DURATION, WINDOW, Diagnosis, Drift, InSimulation
from dvrk_gravity.effects import Motion
from dvrk_gravity.errors import ConfigError, RecordingError
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.simulate import Measurement, ModelArm, Plant, SimulatedArm, simulate

STEP = 1e-3  # s
FRICTION = (1.0, 0.1)  # parts of the arm's friction: all, and as little as it may have
_WINDOWS = 60
_POSES = 3
_RATE = 50.0  # Hz of the drift's record
_EVERY = round(1.0 / (_RATE * STEP))  # steps
# s, in which an arm that moved by exactly nothing is stuck (``FrictionSolver``): nothing that acts
# on it changes any more. More where its readings are late.
_REST = 0.1
_AWAY = f"steps of {1e3 * STEP:g} ms are too long for the model's torques, the arm runs away"
_COMPLETED = 0.01  # of the usual torque: a smaller difference of inertia is not reported


def with_simulation(diagnosis: Diagnosis) -> Diagnosis:
    """Return a diagnosis with the given and the extended model compared in the simulator.

    As it is where they are the same model, or no model was given.
    """
    changed = any(finding.in_model and finding.of_arm for finding in diagnosis.findings)
    if diagnosis.against_reference or not changed:
        return diagnosis
    motion = diagnosis.motion
    # The motion's model and positions are without errors of readings.
    extended = replace(diagnosis.model, reading_errors=motion.model.reading_errors)
    result = in_simulation(motion.model, extended, motion, diagnosis.held_out_spans)
    return replace(diagnosis, in_simulation=result)


def in_simulation(
    given: TorqueModel,
    extended: TorqueModel,
    motion: Motion,
    held_out: Sequence[tuple[float, float]],
) -> InSimulation:
    """Compare two models in the simulator.

    Args:
        given: The given model.
        extended: The same with the findings.
        motion: The recording.
        held_out: Beginning and end of each held-out span of time, s.
    """
    names, units = motion.arm.joint_names, motion.arm.units
    try:
        arms = [ModelArm.of(model) for model in (given, extended)]
    except ConfigError as error:
        return InSimulation(names, units, 0, None, None, (), (f"nothing was simulated: {error}",))
    notes = _inertia_notes(*arms)
    before = after = None
    starts = np.zeros(0, dtype=int)
    if motion.static:
        notes.append("static poses: there is no motion to predict")
    elif not motion.present.all():
        notes.append("the motion is predicted only where all joints' efforts are recorded")
    else:
        starts = _window_starts(motion, held_out)
        with np.errstate(over="ignore", invalid="ignore"):  # reported below
            before, after = (_prediction_errors(arm, motion, starts) for arm in arms)
        if not np.isfinite([before, after]).all():
            before = after = None
            notes.append(f"the motion is not predicted: {_AWAY}")
    drifts, reason = _drifts(arms[1], given, extended, _poses(motion))
    if reason:
        notes.append(f"no drift is shown: {reason}")
    return InSimulation(names, units, len(starts), before, after, drifts, tuple(notes))


def _drifts(
    arm: ModelArm, given: TorqueModel, extended: TorqueModel, poses: Array
) -> tuple[tuple[Drift, ...], str]:
    """Return the drift for each part of the arm's friction, or none and why."""
    if not any(term.gravity_vector is not None for term in given.terms):
        return (), "the given model has no gravity term, and compensates nothing"
    for name, model in (("given", given), ("extended", extended)):
        try:
            Settings.from_parameters(model.parameters())
        except ConfigError as error:
            return (), f"the compensator rejects the {name} model ({error})"
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            drifts = tuple(_drift(arm, given, extended, poses, part) for part in FRICTION)
    except (ConfigError, RecordingError):  # efforts or samples overflow
        return (), _AWAY
    if not all(np.isfinite([drift.before, drift.after]).all() for drift in drifts):
        return (), _AWAY
    return drifts, ""


def _inertia_notes(given: ModelArm, extended: ModelArm) -> list[str]:
    """Return where the simulated inertia differs from the models'."""
    notes = {"given": _inertia_note(given), "extended": _inertia_note(extended)}
    if notes["given"] == notes["extended"]:
        return [f"both models have {notes['given']}"] if notes["given"] else []
    return [f"the {name} model has {note}" for name, note in notes.items() if note]


def _inertia_note(arm: ModelArm) -> str:
    if arm.inertia_error is None:
        return f"no inertia: that of {arm.inertia_source} is used instead"
    if arm.inertia_error.max() <= _COMPLETED:
        return ""
    joint, middle = int(np.argmax(arm.inertia_error)), float(np.median(arm.inertia_error))
    return (
        "inertia that no rigid bodies can have: the nearest ones are simulated, whose torque "
        f"differs by {100 * middle:.0f} % (median joint) to {100 * arm.inertia_error[joint]:.0f} % "
        f"({arm.model.arm.joint_names[joint]})"
    )


def simulate_release(
    plant: Plant, model: TorqueModel, pose: Array, duration: float = DURATION, part: float = 1.0
) -> Array:
    """Return how an arm drifts after release at a pose, compensated as by the node.

    Args:
        plant: The arm; starts at rest.
        model: The model that compensates.
        pose: (n,) measured position, rad or m.
        duration: s.
        part: Of the node's friction compensation: an arm with less friction than is compensated
            runs away.

    Returns:
        (T, n) displacement from the pose at 50 Hz, rad or m.

    Raises:
        ConfigError: A model that the compensator rejects.
    """
    settings = Settings.from_parameters(model.parameters() | {"allow_poor_model": True})
    settings = replace(settings, friction_ratio=part * settings.friction_ratio)
    arm_type, offset = plant.model.arm, plant.model.joint_offset
    plant.reset(np.clip(pose - offset, arm_type.lower, arm_type.upper))
    arm = SimulatedArm(plant, builtin_compensation=False, dt=STEP)

    def effort(position: Array, velocity: Array) -> Array:
        return settings.limits.clip(settings.torque(position, velocity))

    def control(arm: SimulatedArm, read: Measurement) -> None:
        arm.servo_jf(effort(read.position, read.velocity))

    start = plant.q + offset
    arm.servo_jf(effort(start, np.zeros(len(start))))
    steps, rows = round(duration / STEP), math.ceil(round(duration / STEP) / _EVERY)
    piece = _EVERY * math.ceil((_REST + abs(plant.model.reading_errors.delay)) * _RATE)
    found = np.empty((0, len(start)))
    for first in range(0, steps, piece):
        before = plant.q
        moved = simulate(arm, control, min(piece, steps - first) * STEP, _RATE).position
        found = np.concatenate([found, moved])
        if not plant.v.any() and (plant.q == before).all() and (moved == moved[0]).all():
            break
    return np.pad(found, ((0, rows - len(found)), (0, 0)), mode="edge") - start


def _drift(
    arm: ModelArm, given: TorqueModel, extended: TorqueModel, poses: Array, part: float
) -> Drift:
    plant = arm.plant(part)
    before, after = (
        np.array([simulate_release(plant, model, pose, part=part) for pose in poses])
        for model in (given, extended)
    )
    return Drift(part, np.arange(before.shape[1]) / _RATE, before, after)


def _poses(motion: Motion) -> Array:
    """Return (P, n) poses of the motion that are far apart."""
    arm = motion.arm
    q = np.clip(motion.q[:: max(1, len(motion.q) // 500)], arm.lower, arm.upper)
    scaled = q / motion.travel[1]
    chosen = [int(np.argmin(np.linalg.norm(scaled - np.median(scaled, axis=0), axis=1)))]
    while len(chosen) < _POSES:
        ways = np.linalg.norm(scaled[:, None] - scaled[chosen], axis=2)
        chosen.append(int(np.argmax(ways.min(axis=1))))
    return q[chosen]


def _window_starts(motion: Motion, held_out: Sequence[tuple[float, float]]) -> NDArray[np.int64]:
    """Return the first samples of the predicted pieces, evenly spread over held-out spans."""
    inside = np.zeros(len(motion.q), dtype=bool)
    for first, last in held_out:
        inside |= (motion.time >= first) & (motion.time + WINDOW <= last)
    for part in motion.parts:
        inside[part] &= motion.time[part] + WINDOW <= motion.time[part][-1]
    found = np.flatnonzero(inside)
    return found[np.unique(np.linspace(0, len(found) - 1, min(_WINDOWS, len(found))).astype(int))]


def _prediction_errors(simulated: ModelArm, motion: Motion, starts: NDArray[np.int64]) -> Array:
    """Return (n,) RMS error of predicted positions at the end of each piece."""
    plant = simulated.plant()
    arm, offset = plant.model.arm, plant.model.joint_offset
    steps = np.arange(round(WINDOW / STEP)) * STEP
    missed = []
    for row in starts.tolist():
        begin = motion.time[row]
        step = motion.time[row + 1] - begin
        rows = slice(row, row + int(1.0 + 1.5 * WINDOW / step))
        efforts = _applied_efforts(plant, motion, rows, offset)
        effort, there = (
            np.stack([np.interp(begin + at, motion.time[rows], column) for column in of.T], -1)
            for of, at in ((efforts, steps + 0.5 * STEP), (motion.q[rows], np.array([WINDOW])))
        )
        plant.reset(np.clip(motion.q[row] - offset, arm.lower, arm.upper), motion.qd[row])
        for torque in effort:
            plant.step(torque, dt=STEP)
        missed.append(plant.q + offset - there[0])
    return np.sqrt(np.mean(np.square(missed), axis=0))


def _applied_efforts(plant: Plant, motion: Motion, rows: slice, offset: Array) -> Array:
    """Return (N, n) efforts that acted on the arm: measured ones without sensor bias."""
    efforts = motion.effort[rows].copy()
    for part in plant.parts:
        if part.reading is not None:
            states = zip(motion.q[rows] - offset, motion.qd[rows], strict=True)
            efforts -= [part.reading(q, qd) for q, qd in states]
    return efforts
