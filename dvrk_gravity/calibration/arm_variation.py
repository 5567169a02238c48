"""An arm that differs from its plant as one arm differs from the next: errors drawn by a seed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import pinocchio as pin

from dvrk_gravity.arms import Arm, build_tree, gravity_in_base
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import LinearTerm, State, Term
from dvrk_gravity.effects import terms as effect_terms
from dvrk_gravity.simulate import PlantFile, Sensors

_SLOW = 0.05  # rad/s (Arm.scale): all of dry friction, and hardly any viscous one


@dataclass(frozen=True)
class DrawSettings:
    """How much one arm differs from another. Chosen, as for the simulated arms of the trials.

    Attributes:
        mass: Factors on the mass and inertia of each link.
        rotor: Factors on the inertia of each rotor.
        friction: Factors on the friction of each joint and motor, the same in both directions: a
            difference between them is a constant torque to any motion, and none at rest.
        cable: Greatest coefficient of each joint's cable, a polynomial of degree three of its
            position, from -1 to 1 at the ends of its range, as a part of its effort limit.
        dry: Friction at slow motion, as a part of the effort limit, below which a joint gets a
            usual one (``Term.nominal``): in a console's file it is part of the cables.
        zero: Standard deviation of the joints' zeros, rad (``Arm.scale``).
        tilt: That of the base's roll and pitch, rad.
        step: Steps of encoders, rad (``Arm.scale``), and
        noise: noise of efforts, as a part of their limits, where the plant has perfect sensors.
    """

    mass: tuple[float, float] = (0.8, 1.25)
    rotor: tuple[float, float] = (0.8, 1.2)
    friction: tuple[float, float] = (0.6, 1.5)
    cable: float = 0.02
    dry: float = 0.002
    zero: float = float(np.radians(0.3))
    tilt: float = float(np.radians(0.7))
    step: float = 2e-5
    noise: float = 0.003


def draw_arm(plant: PlantFile, seed: int, settings: DrawSettings | None = None) -> PlantFile:
    """Return a plant with other masses, friction, zeros of joints and mounting, and with cables.

    Cables and springs of the plant are replaced: polynomials of a higher degree, as a console has
    them, go on growing outside of the range that they were fitted on.

    Args:
        plant: What it is like.
        seed: Of all that is drawn.
        settings: How much it differs.
    """
    of, random = settings or DrawSettings(), np.random.default_rng(seed)
    arm = plant.model.arm
    links = {
        name: pin.Inertia(body.mass * factor, body.lever, body.inertia * factor)
        for (name, body), factor in zip(
            plant.links.items(), random.uniform(*of.mass, len(plant.links)), strict=True
        )
    }
    vector = _tilted_gravity(arm, of.tilt * random.standard_normal(2))
    terms = (
        *(_draw_term(term, arm, links, vector, random, of) for term in _kept_terms(plant, of)),
        *(each for effect in effect_terms() if (each := effect.drawn(arm, random, of.cable))),
    )
    offset = of.zero * arm.scale * random.standard_normal(arm.n)
    model = replace(plant.model, terms=terms, joint_offset=plant.model.joint_offset + offset)
    sensors = plant.sensors
    if sensors.position_step is None:
        motor = arm.actuator_effort_limit
        sensors = Sensors(of.step * arm.scale, of.step * arm.scale, None, of.noise * motor)
    rotors = plant.rotor_inertia * random.uniform(*of.rotor, arm.n)
    return PlantFile(model, links, rotors, sensors, f"{plant.source}, with errors of seed {seed}")


def _tilted_gravity(arm: Arm, angles: Array) -> Array:
    roll, pitch, yaw = arm.base_rpy
    return gravity_in_base(roll + float(angles[0]), pitch + float(angles[1]), yaw)


def _kept_terms(plant: PlantFile, of: DrawSettings) -> list[Term]:
    """Return friction, which every joint has, weight and loads."""
    arm, model = plant.model.arm, plant.model
    friction = [term for term in model.terms if term.FRICTION]
    loads = [term for term in model.terms if term.WEIGHT_OF_ARM or not isinstance(term, LinearTerm)]
    # In any combination of directions: a motor that two joints turn rubs in some of them only.
    ways = np.array(list(product((-1.0, 1.0), repeat=arm.n)))
    slow = State(np.zeros_like(ways), _SLOW * arm.scale * ways)
    torque = sum((np.abs(term.torque(slow)) for term in friction), np.zeros_like(ways))
    dry = torque.min(axis=0)
    without = (dry < of.dry * arm.effort_limit).astype(float)
    usual = [each for effect in effect_terms() if effect.FRICTION and (each := effect.nominal(arm))]
    return [*friction, *(each.scaled(without) for each in usual), *loads]


def _draw_term(
    term: Term, arm: Arm, links: Mapping[str, pin.Inertia], vector: Array,
    random: np.random.Generator, of: DrawSettings,
) -> Term:  # fmt: skip
    if term.FRICTION:
        return term.scaled(random.uniform(*of.friction, arm.n))
    if term.WEIGHT_OF_ARM and isinstance(term, LinearTerm):
        term = _with_weight(term, arm, links)
    return term.with_gravity(vector)


def _with_weight(term: LinearTerm, arm: Arm, links: Mapping[str, pin.Inertia]) -> LinearTerm:
    """Return the weight of links, consistent with their inertia."""
    q = np.random.default_rng(0).uniform(*arm.range, (10 * len(term.theta), arm.n))
    tree = build_tree(arm, links, arm.gravity)
    torque = np.ravel([tree.gravity(pose) for pose in q])
    level = term.with_gravity(arm.gravity)
    assert isinstance(level, LinearTerm)
    columns = level.regressor(State(q)).reshape(len(torque), -1)
    return term.with_theta(np.linalg.lstsq(columns, torque, rcond=None)[0])
