"""The nearest model that a URDF or an MJCF can hold, and what it leaves out, by cause.

Both have rigid bodies, and at each joint viscous and dry friction, the same in both directions. An
MJCF has rotors, linear springs, and motors that move several joints (fixed tendons) as well.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from dvrk_gravity.arms import OF_WEIGHT, PER_LINK, Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import (
    CoulombFriction,
    DirectionalCable,
    ElasticCable,
    Gravity,
    JointSpring,
    LinkInertia,
    LinkWeight,
    Payload,
    Range,
    RotorInertia,
    State,
    Term,
    ViscousFriction,
    rotors_beside_links,
)
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.exports.bodies import physical_bodies
from dvrk_gravity.exports.links import at_joints
from dvrk_gravity.model import TorqueModel

Format = Literal["URDF", "MJCF"]
EARTH = 9.81  # m/s^2 by which readers of a URDF let it fall; it states none
_RIGID = (Gravity, LinkWeight, LinkInertia, Payload)


@dataclass(frozen=True, eq=False)
class Part:
    """Terms of a model, what the file holds of them, and why not all.

    Attributes:
        name: Of the cause, an effect's name.
        why: What the file cannot hold, in words.
        given: The model's terms.
        held: What the file has for them.
        moves: Whether they are compared in motion; else at rest.
    """

    name: str
    why: str
    given: tuple[Term, ...]
    held: tuple[Term, ...] = ()
    moves: bool = True


@dataclass(frozen=True, eq=False)
class LeftOut:
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


@dataclass(frozen=True, eq=False)
class Form:
    """A model in the form of a file.

    Attributes:
        model: The terms that the file holds; ``joint_offset`` is kept.
        parts: The model's terms and their likenesses in the file.
        notes: What else the file does not say as the model does, a line each.
    """

    model: TorqueModel
    parts: tuple[Part, ...]
    notes: tuple[str, ...] = ()


def project(model: TorqueModel, form: Format) -> Form:
    """Return the nearest model that a file of a format can hold.

    Raises:
        ConfigError: A model in another unit than N·m, or without the weight or inertia of links.
    """
    arm = model.arm
    if arm.read_in:
        raise ConfigError(
            "effort_unit", arm.read_in, f"N·m for {form}: identify with --drive-gains"
        )
    if any(getattr(term, "enabled", True) is False for term in model.terms):
        raise ConfigError("gravity_enabled", False, f"true: bodies in {form} weigh something")
    rigid, notes = _rigid_part(model, form)
    parts = [rigid]
    for term in model.terms:
        if not isinstance(term, _RIGID) and (part := _part(term, form, model)) is not None:
            parts.append(part)
    held = tuple(term for part in parts for term in part.held)
    return Form(replace(model, terms=held, uncertainty=None), tuple(parts), notes)


def _rigid_part(model: TorqueModel, form: Format) -> tuple[Part, tuple[str, ...]]:
    arm, vector, notes = model.arm, model.gravity, list[str]()
    rigid: tuple[Term, ...] = tuple(term for term in model.terms if isinstance(term, _RIGID))
    if not rigid:
        raise ConfigError("terms", "no weight and no inertia", f"links' parameters for {form}")
    moves = any(isinstance(term, LinkInertia) for term in rigid)
    if not moves:
        notes.append("the model has no link_inertia: the inertia in the file is plausible only")
    rotors = model.term(RotorInertia.NAME)
    known, exact = _known_bodies(arm, rigid), rigid
    if form == "URDF" and isinstance(rotors, RotorInertia) and moves:
        beside = np.isin(np.arange(arm.n), rotors_beside_links(arm))
        if (rotors.motor[~beside] > 0.0).any():
            inside = RotorInertia(arm, np.where(beside, 0.0, rotors.motor))
            names = [n for n, own in zip(arm.joint_names, inside.motor, strict=True) if own]
            notes.append(f"links' inertia has the rotors of {', '.join(names)} in it: same torque")
            exact = (*rigid, inside)
    links = physical_bodies(arm, exact, known, vector, moves)
    strength = float(np.linalg.norm(vector))
    down = vector / strength * EARTH if form == "URDF" and strength > 0.0 else vector
    if np.abs(down - vector).max() > 1e-9:
        notes.append(f"gravity of {strength:g} m/s^2: readers of a URDF take {EARTH:g}")
    held = (LinkWeight(arm, links[:, :OF_WEIGHT].copy(), down), LinkInertia(arm, links))
    why = "no bodies have this weight and inertia; the nearest that can exist"
    return Part("rigid bodies", why, exact, held, moves), tuple(notes)


def _known_bodies(arm: Arm, rigid: tuple[Term, ...]) -> Array:
    """Return (bodies, 10) parameters that the terms state, as far as they do."""
    known = np.zeros((len(arm.bodies), PER_LINK))
    for term in rigid:
        if isinstance(term, LinkInertia):
            known += term.links
        elif isinstance(term, Payload):
            row = arm.body(term.link).frame.act(term.inertia).toDynamicParameters()
            known[arm.body_names.index(term.link)] += row
    return known


def _part(term: Term, form: Format, model: TorqueModel) -> Part | None:
    """Return what a file holds of a term that is no rigid body's."""
    mjcf, arm = form == "MJCF", model.arm
    if isinstance(term, RotorInertia):
        if mjcf:
            return Part(term.NAME, "", (term,), (term,))
        beside = np.isin(np.arange(arm.n), rotors_beside_links(arm))
        rest = RotorInertia(arm, np.where(beside, term.motor, 0.0))
        return Part(term.NAME, "a URDF has no rotors", (rest,)) if rest.motor.any() else None
    if isinstance(term, ViscousFriction):
        joint, motor = at_joints(arm, term.joint, term.motor, 2)
        motor = motor if mjcf else 0.0 * motor
        why = "that of motors that move several joints"
        return Part(term.NAME, why, (term,), (replace(term, joint=joint, motor=motor),))
    if isinstance(term, CoulombFriction):
        joint = 0.5 * (term.joint_positive + term.joint_negative)
        motor = 0.5 * (term.motor_positive + term.motor_negative)
        joint, motor = at_joints(arm, joint, motor, 1)
        motor = motor if mjcf else 0.0 * motor
        held = replace(
            term, joint_positive=joint, joint_negative=joint, motor_positive=motor,
            motor_negative=motor,
        )  # fmt: skip
        why = "its difference by direction" + ("" if mjcf else ", and motors' that move several")
        return Part(term.NAME, why, (term,), (held,))
    if not mjcf:
        why = "a reading's, not the arm's" if _of_reading(term) else "a URDF has nothing for it"
        return Part(term.NAME, why, (term,))
    if isinstance(term, JointSpring):
        return Part(term.NAME, "", (term,), (term,))
    if isinstance(term, ElasticCable):
        why = "its curvature: the file has the nearest straight line"
        return Part(term.NAME, why, (term,), (_line(term, model),))
    if isinstance(term, DirectionalCable) and model.term(ElasticCable.NAME) is None:
        why = "its curvature and its difference by direction: the file has a straight line"
        return Part(term.NAME, why, (term,), (_line(term.elastic(), model),))
    why = "a reading's, not the arm's" if _of_reading(term) else "an MJCF has nothing for it"
    return Part(term.NAME, why, (term,))


def _of_reading(term: Term) -> bool:
    return term.plant().reading is not None


def _line(cable: ElasticCable, model: TorqueModel) -> ElasticCable:
    """Return the straight lines nearest to a cable's torque over the calibrated range."""
    lower, upper = calibrated_range(model)
    q = np.linspace(lower, upper, 201) - model.joint_offset
    torque = cable.torque(State(q))
    lines = np.zeros((2, model.arm.n))
    for joint, powers in enumerate(cable.coefficients.T):
        if powers[2:].any() or (cable.valid.hold(q)[:, joint] != q[:, joint]).any():
            lines[:, joint] = np.polynomial.polynomial.polyfit(q[:, joint], torque[:, joint], 1)
        else:
            lines[: len(powers), joint] = powers[:2]
    everywhere = np.full(model.arm.n, np.inf)
    return replace(cable, coefficients=lines, valid=Range(-everywhere, everywhere))


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
        if isinstance(valid := getattr(term, "valid", None), Range):
            yield valid.lower + offset, valid.upper + offset
