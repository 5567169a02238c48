"""The nearest that a URDF or an MJCF can hold of a model, and what it leaves out, by cause."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.arms import PER_LINK, Arm, rigid_body
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import JointDynamics, State, Term, terms
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.exports.bodies import Torque, physical_bodies
from dvrk_gravity.exports.formats import FORMATS, FileFormat, Format
from dvrk_gravity.model import TorqueModel


@dataclass(frozen=True, eq=False)
class FileModel:
    """What a file has of a model.

    Attributes:
        arm: The arm.
        joint_offset: (n,) rad, measured minus true positions.
        gravity: (3,) in the base frame, m/s^2.
        links: (bodies, 10) inertial parameters, in the bodies' joint frames.
        dynamics: Of the joints and motors, those of springs by measured positions.
    """

    arm: Arm
    joint_offset: Array
    gravity: Array
    links: Array
    dynamics: JointDynamics


@dataclass(frozen=True, eq=False)
class TorquePart:
    """A torque of a model, what the file holds of it, and why not all.

    Attributes:
        name: Of the cause, an effect's name.
        why: What the file cannot hold, in words.
        model_torque: The model's.
        file_torque: What the file has for it.
        moves: Whether they are compared in motion; else at rest.
    """

    name: str
    why: str
    model_torque: Torque
    file_torque: Torque
    moves: bool = True


@dataclass(frozen=True, eq=False)
class OmittedTorque:
    """What a file does not have of a model.

    Attributes:
        name: Of the cause, an effect's name.
        why: What the file cannot hold, in words.
        rms: (n,) RMS torque of it, N·m or N.
        largest: (n,) its largest torque.
    """

    name: str
    why: str
    rms: Array
    largest: Array


def project(model: TorqueModel, form: Format) -> tuple[FileModel, list[TorquePart], list[str]]:
    """Return the nearest that a file of a format can hold of a model.

    Returns:
        What the file has, the model's torques beside what the file has for them, and what else the
        file does not say as the model does, a line each.

    Raises:
        ConfigError: A model in another unit than N·m, or without the weight or inertia of links.
    """
    arm = model.arm
    if arm.read_in:
        raise ConfigError(
            "effort_unit", arm.read_in, f"N·m for {form}: identify with --drive-gains"
        )
    if any(term.parameters().get("gravity_enabled") is False for term in model.terms):
        raise ConfigError("gravity_enabled", False, f"true: bodies in {form} weigh something")
    rigid = [term for term in model.terms if _is_rigid(term)]
    if not rigid:
        raise ConfigError("terms", "no weight and no inertia", f"links' parameters for {form}")
    q = np.linspace(*calibrated_range(model), 201) - model.joint_offset
    parts, dynamics = list[TorquePart](), JointDynamics(arm)
    for term in model.terms:
        if not _is_rigid(term):
            part, of_term = _part(term, arm, q, FORMATS[form])
            parts.append(part)
            dynamics = _sum(dynamics, of_term, model.joint_offset)
    file_model, bodies, notes = _with_bodies(model, rigid, dynamics, FORMATS[form])
    return file_model, [bodies, *parts], notes


def _is_rigid(term: Term) -> bool:
    return term.WEIGHT_OF_ARM or term.inertial_parameters is not None


def _with_bodies(
    model: TorqueModel, rigid: list[Term], dynamics: JointDynamics, file: FileFormat
) -> tuple[FileModel, TorquePart, list[str]]:
    """Return what a file has, its bodies those of a model's rigid terms, and notes on them."""
    arm, vector, notes = model.arm, model.gravity, list[str]()
    moves = any(term.OF_LINKS == PER_LINK for term in rigid)
    if not moves:
        lacking = " or ".join(term.NAME for term in terms() if term.OF_LINKS == PER_LINK)
        notes.append(f"the model has no {lacking}: the inertia in the file is plausible only")
    exact = [term.torque for term in rigid]
    if not file.motors:
        rotors = dynamics.inertia  # those that turn like links
        dynamics = replace(dynamics, inertia=0.0 * rotors)
        if moves and rotors.any():
            names = ", ".join(arm.joint_names[i] for i in np.flatnonzero(rotors[1]).tolist())
            notes.append(f"links' inertia has the rotors of {names} in it: same torque")
            exact.append(JointDynamics(arm, inertia=rotors).torque)
    stated = [rows for term in rigid if (rows := term.inertial_parameters) is not None]
    known = np.sum([np.zeros((len(arm.bodies), PER_LINK)), *stated], axis=0)

    def given(state: State) -> Array:
        return np.asarray(np.sum([torque(state) for torque in exact], axis=0))

    links = physical_bodies(arm, given, known, vector, moves)
    strength = float(np.linalg.norm(vector))
    down = vector / strength * file.gravity if file.gravity and strength > 0.0 else vector
    if np.abs(down - vector).max() > 1e-9:
        taken = f"readers of {file.title} take {file.gravity:g}"
        notes.append(f"gravity of {strength:g} m/s^2: {taken}")

    def of_bodies(state: State) -> Array:
        return rigid_body.torque(arm, links.ravel(), state.q, state.qd, state.qdd, down)

    why = "no bodies have this weight and inertia; the nearest that can exist"
    bodies = TorquePart("rigid bodies", why, given, of_bodies, moves)
    file_model = FileModel(arm, model.joint_offset, down, links, dynamics)
    return file_model, bodies, notes


def _part(term: Term, arm: Arm, q: Array, file: FileFormat) -> tuple[TorquePart, JointDynamics]:
    """Return a term that is no rigid body's, and what files of a format hold of it."""
    nearest = term.joint_dynamics(arm, q)
    if nearest is None:
        reading = term.plant().reading is not None
        why = "a reading's, not the arm's" if reading else f"{file.title} has nothing for it"
        held = JointDynamics(arm)
    else:
        why, held = file.missing(nearest), file.representable(nearest)
    return TorquePart(term.NAME, why, term.torque, held.torque), held


def _sum(one: JointDynamics, more: JointDynamics, offset: Array) -> JointDynamics:
    """Return the sum of two, the second one's springs by true positions, the sum's by measured."""
    return JointDynamics(
        one.arm,
        damping=one.damping + more.damping,
        friction=one.friction + more.friction,
        inertia=one.inertia + more.inertia,
        constant=one.constant + more.constant - more.stiffness * offset - more.coupling @ offset,
        stiffness=one.stiffness + more.stiffness,
        coupling=one.coupling + more.coupling,
    )


def calibrated_range(model: TorqueModel) -> tuple[Array, Array]:
    """Return (n,) edges of the measured positions a model was fitted on, else the arm's limits."""
    lower, upper = (edge.copy() for edge in model.arm.range)
    for low, high in _ranges(model):
        low, high = np.maximum(low, lower), np.minimum(high, upper)
        lower, upper = np.where(low < high, low, lower), np.where(low < high, high, upper)
    return lower, upper


def _ranges(model: TorqueModel) -> Iterator[tuple[Array, Array]]:
    offset = model.joint_offset
    if model.uncertainty is not None:
        yield model.uncertainty.lower + offset, model.uncertainty.upper + offset
    for term in model.terms:
        if (valid := term.fitted_range) is not None:
            yield valid.lower + offset, valid.upper + offset
