"""What an extension of the model changes in the simulator: motion predicted, drift under it.

Both are simulated with the model's own friction. The drift is that of an arm as the extended model
has it: if that is right, this is what a hand will feel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arrays import Array
from dvrk_gravity.compensate import Settings
from dvrk_gravity.diagnosis.data.motion import MeasuredMotion
from dvrk_gravity.errors import ConfigError, RecordingError
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.simulate import ModelArm, Plant, SimulatedArm, simulate

WINDOW = 0.1  # s: what is predicted open loop diverges soon
STEP = 1e-3  # s
FRICTION = (1.0, 0.1)  # parts of the arm's friction: what it has, and what little it may have
DURATION = 2.0  # s of drift, as long as the console looks at it to accept a calibration
_WINDOWS = 60
_POSES = 3
_RATE = 50.0  # Hz of the drift's record
_AWAY = f"steps of {1e3 * STEP:g} ms are too long for the model's torques, the arm runs away"
_COMPLETED = 0.01  # of the usual torque, that an inertia may differ by without a word


@dataclass(frozen=True, eq=False)
class Drift:
    """How an arm that is let go moves under compensation.

    Attributes:
        friction: Part of the arm's friction that there is, and of its compensation.
        time: (T,) s.
        before: (P, T, n) way from each pose under the given model's compensation, rad or m.
        after: (P, T, n) the same under the extended model's.
    """

    friction: float
    time: Array
    before: Array
    after: Array


@dataclass(frozen=True, eq=False)
class InSimulation:
    """The given and the extended model in the simulator.

    Attributes:
        joints: Names of the joints.
        units: Units of their positions.
        windows: How many pieces of held-out motion were predicted.
        before: (n,) RMS error of the position that the given model predicts at the end of
            :data:`WINDOW`, rad or m; ``None`` where motion could not be simulated.
        after: (n,) the same of the extended model.
        drifts: One for each of :data:`FRICTION`; none where nothing can be compensated.
        notes: What was not simulated, and why.
    """

    joints: tuple[str, ...]
    units: tuple[str, ...]
    windows: int
    before: Array | None
    after: Array | None
    drifts: tuple[Drift, ...]
    notes: tuple[str, ...]

    def _by_joint(self, values: Array) -> dict[str, float]:
        return dict(zip(self.joints, values.tolist(), strict=True))

    def to_dict(self) -> dict[str, Any]:
        """Return what findings.json holds of it."""
        motion = None
        if self.before is not None and self.after is not None:
            motion = {
                "seconds": WINDOW,
                "windows": self.windows,
                "rmse_before": self._by_joint(self.before),
                "rmse_after": self._by_joint(self.after),
            }
        drifts = [
            {
                "friction": drift.friction,
                "seconds": DURATION,
                "poses": len(drift.before),
                "largest_before": self._by_joint(np.abs(drift.before).max(axis=(0, 1))),
                "largest_after": self._by_joint(np.abs(drift.after).max(axis=(0, 1))),
            }
            for drift in self.drifts
        ]
        units = dict(zip(self.joints, self.units, strict=True))
        return {"units": units, "motion": motion, "drift": drifts, "notes": list(self.notes)}


def in_simulation(
    given: TorqueModel,
    extended: TorqueModel,
    motion: MeasuredMotion,
    held_out: Sequence[tuple[float, float]],
) -> InSimulation:
    """Compare two models in the simulator.

    Args:
        given: The model on trial.
        extended: The same with what was found.
        motion: The recording.
        held_out: Beginnings and ends of the pieces of time that fit and choice have not seen, s.
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
        starts = _starts(motion, held_out)
        with np.errstate(over="ignore", invalid="ignore"):  # told below
            before, after = (_missed(arm, motion, starts) for arm in arms)
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
    """Return the drift with each part of the arm's friction, or none and why."""
    if not any(term.gravity_vector is not None for term in given.terms):
        return (), "the given model has no weights, and compensates nothing"
    for name, model in (("given", given), ("extended", extended)):
        try:
            Settings.from_parameters(model.parameters())
        except ConfigError as error:
            return (), f"the compensator refuses the {name} model ({error})"
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            drifts = tuple(_drift(arm, given, extended, poses, part) for part in FRICTION)
    except (ConfigError, RecordingError):  # no effort, and no sample, beyond all numbers
        return (), _AWAY
    if not all(np.isfinite([drift.before, drift.after]).all() for drift in drifts):
        return (), _AWAY
    return drifts, ""


def _inertia_notes(given: ModelArm, extended: ModelArm) -> list[str]:
    """Return in words where the simulated inertia is not the models' own."""
    notes = {"given": _inertia_note(given), "extended": _inertia_note(extended)}
    if notes["given"] == notes["extended"]:
        notes = {"given and the extended": notes["given"]}
    return [f"the {name} model has {note}" for name, note in notes.items() if note]


def _inertia_note(arm: ModelArm) -> str:
    if arm.off is None:
        return f"no inertia: that of {arm.known} stands in"
    if arm.off.max() <= _COMPLETED:
        return ""
    joint, middle = int(np.argmax(arm.off)), float(np.median(arm.off))
    return (
        "inertia that no bodies can have: simulated are the nearest bodies, whose torque "
        f"differs by {100 * middle:.0f} % (median joint) to {100 * arm.off[joint]:.0f} % "
        f"({arm.model.arm.joint_names[joint]})"
    )


def let_go(
    plant: Plant, model: TorqueModel, pose: Array, duration: float = DURATION, part: float = 1.0
) -> Array:
    """Let an arm go at a pose, compensated by a model as the node does it.

    Args:
        plant: The arm; is put at the pose, at rest.
        model: The model that compensates.
        pose: (n,) measured position, rad or m.
        duration: s.
        part: Of the friction that the node compensates. An arm with less friction than that
            compensation takes it to have runs away, whatever else the model says.

    Returns:
        (T, n) way from the pose at 50 Hz, rad or m.

    Raises:
        ConfigError: A model that the compensator refuses.
    """
    settings = Settings.from_parameters(model.parameters() | {"allow_poor_model": True})
    settings = replace(settings, friction_ratio=part * settings.friction_ratio)
    arm_type, offset = plant.model.arm, plant.model.joint_offset
    plant.reset(np.clip(pose - offset, arm_type.lower, arm_type.upper))
    arm = SimulatedArm(plant, builtin_compensation=False, dt=STEP)

    def effort(position: Array, velocity: Array) -> Array:
        return settings.limits.clip(settings.torque(position, velocity))

    start = plant.q + offset
    arm.servo_jf(effort(start, np.zeros(len(start))))
    recording = simulate(
        arm, lambda arm, m: arm.servo_jf(effort(m.position, m.velocity)), duration, _RATE
    )
    return recording.position - start


def _drift(
    arm: ModelArm, given: TorqueModel, extended: TorqueModel, poses: Array, part: float
) -> Drift:
    plant = arm.plant(part)
    before, after = (
        np.array([let_go(plant, model, pose, part=part) for pose in poses])
        for model in (given, extended)
    )
    return Drift(part, np.arange(before.shape[1]) / _RATE, before, after)


def _poses(motion: MeasuredMotion) -> Array:
    """Return (P, n) poses of the motion that are far from one another."""
    arm = motion.arm
    q = np.clip(motion.q[:: max(1, len(motion.q) // 500)], arm.lower, arm.upper)
    scaled = q / motion.travel[1]
    chosen = [int(np.argmin(np.linalg.norm(scaled - np.median(scaled, axis=0), axis=1)))]
    while len(chosen) < _POSES:
        ways = np.linalg.norm(scaled[:, None] - scaled[chosen], axis=2)
        chosen.append(int(np.argmax(ways.min(axis=1))))
    return q[chosen]


def _starts(motion: MeasuredMotion, held_out: Sequence[tuple[float, float]]) -> NDArray[np.int64]:
    """Return where the predicted pieces begin: within what is held out, evenly spread."""
    inside = np.zeros(len(motion.q), dtype=bool)
    for first, last in held_out:
        inside |= (motion.time >= first) & (motion.time + WINDOW <= last)
    for part in motion.parts:
        inside[part] &= motion.time[part] + WINDOW <= motion.time[part][-1]
    found = np.flatnonzero(inside)
    return found[np.unique(np.linspace(0, len(found) - 1, min(_WINDOWS, len(found))).astype(int))]


def _missed(simulated: ModelArm, motion: MeasuredMotion, starts: NDArray[np.int64]) -> Array:
    """Return (n,) RMS error of the positions that a model predicts at the end of each piece."""
    plant = simulated.plant()
    arm, offset = plant.model.arm, plant.model.joint_offset
    steps = np.arange(round(WINDOW / STEP)) * STEP
    missed = []
    for row in starts.tolist():
        begin = motion.time[row]
        rows = slice(row, row + int(1.0 + 1.5 * WINDOW * (motion.rate or 1.0)))
        efforts = _applied(plant, motion, rows, offset)
        effort, there = (
            np.stack([np.interp(begin + at, motion.time[rows], column) for column in of.T], -1)
            for of, at in ((efforts, steps + 0.5 * STEP), (motion.q[rows], np.array([WINDOW])))
        )
        plant.reset(np.clip(motion.q[row] - offset, arm.lower, arm.upper), motion.qd[row])
        for torque in effort:
            plant.step(torque, dt=STEP)
        missed.append(plant.q + offset - there[0])
    return np.sqrt(np.mean(np.square(missed), axis=0))


def _applied(plant: Plant, motion: MeasuredMotion, rows: slice, offset: Array) -> Array:
    """Return (N, n) efforts that acted on the arm: measured ones less what its sensors add."""
    efforts = motion.effort[rows].copy()
    for part in plant.parts:
        if part.reading is not None:
            states = zip(motion.q[rows] - offset, motion.qd[rows], strict=True)
            efforts -= [part.reading(q, qd) for q, qd in states]
    return efforts
