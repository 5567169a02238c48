"""Hide an effect of the vocabulary in a simulated MTM or in what its sensors say.

Causes of torque go into the plant and bend its motion; wrong readings go into the sensors.
Neither uses the columns that the diagnosis fits.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import pinocchio as pin

from dvrk_gravity.arms import gravity_in_base
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.planning import Multisine
from testing.hidden_parts import (
    INERTIA,
    LEVEL,
    RANGE,
    SPEED,
    Array,
    Hidden,
    N,
    Random,
    found,
    on_joint,
    sign,
    size,
)
from testing.hidden_plant import Dahl
from testing.hidden_readings import (
    READINGS,
    encoder_scale,
    joint_flexibility,
    torque_saturation,
)
from testing.world import World


def hide(world: World, effect: str, random: Random) -> tuple[World, Hidden]:
    """Return the world with one effect hidden in it, and what it is.

    Args:
        world: The world as the model knows it.
        effect: Name in the vocabulary, ``"nothing"`` or ``"outside"``.
        random: Where joint and magnitude come from.

    Raises:
        ConfigError: No such effect.
    """
    if effect not in HIDERS:
        raise ConfigError("effect", effect, f"one of {', '.join(sorted(HIDERS))}")
    return HIDERS[effect](world, random)


def _nothing(world: World, random: Random) -> tuple[World, Hidden]:
    del random
    return world, found(world.arm, "nothing", None)


def _payload(world: World, random: Random) -> tuple[World, Hidden]:
    link = int(random.choice([7, 7, 6, 3]))
    mass = 0.03 * size(random)
    com = random.uniform(-0.03, 0.03, 3)
    body = world.links[f"link{link}"]
    added = pin.Inertia(mass, com, np.zeros((3, 3)))
    # World.links are inertias about the centre of mass, so `+` combines the bodies.
    links = dict(world.links) | {f"link{link}": body + added}
    return replace(world, links=links), found(world.arm, "payload", link - 1, mass=mass)


def _base_tilt(world: World, random: Random) -> tuple[World, Hidden]:
    roll, pitch = np.radians(random.uniform(1.5, 5.0, 2)) * random.choice([-1.0, 1.0], 2)
    tilted = replace(world, gravity=gravity_in_base(float(roll), float(pitch)))
    return tilted, found(world.arm, "base_tilt", None, roll=float(roll), pitch=float(pitch))


def _link_com(world: World, random: Random) -> tuple[World, Hidden]:
    index, joint = ((0, 1), (2, 2), (5, 4), (6, 4), (8, 5), (9, 5))[int(random.integers(6))]
    delta = 2.0 * LEVEL[joint] * size(random) * sign(random)
    counterweight = world.counterweight.copy()
    counterweight[index] += delta
    return replace(world, counterweight=counterweight), found(
        world.arm, "link_com", joint, delta_beta=delta
    )


def _coulomb(world: World, random: Random) -> tuple[World, Hidden]:
    joint = int(random.integers(N))
    up = LEVEL[joint] * size(random)
    down = up * float(random.choice([1.0, random.uniform(0.6, 1.6)]))
    coulomb = world.coulomb.copy()
    coulomb[:2, joint] += (up, down)
    return replace(world, coulomb=coulomb), found(
        world.arm, "coulomb_friction", joint, positive=up, negative=down
    )


def _viscous(world: World, random: Random) -> tuple[World, Hidden]:
    joint = int(random.integers(N))
    damping = LEVEL[joint] / SPEED[joint] * size(random)
    viscous = world.viscous.copy()
    viscous[joint] += damping
    return replace(world, viscous=viscous), found(
        world.arm, "viscous_friction", joint, coefficient=float(damping)
    )


def _stribeck(world: World, random: Random) -> tuple[World, Hidden]:
    joint = int(random.integers(N))
    level = 2.0 * LEVEL[joint] * size(random)
    velocity = float(SPEED[joint] * random.uniform(0.2, 0.6))
    stribeck = world.stribeck.copy()
    stribeck[:, joint] = level, velocity  # a joint has one
    return replace(world, stribeck=stribeck), found(
        world.arm, "stribeck_friction", joint, level=level, velocity=velocity
    )


def _presliding(world: World, random: Random) -> tuple[World, Hidden]:
    joint = int(random.integers(N))
    level = 1.5 * LEVEL[joint] * size(random)
    length = float(RANGE[joint] * random.uniform(0.05, 0.25))
    added = Dahl(joint, level, length)
    return replace(world, extra=(*world.extra, added)), found(
        world.arm, "presliding_hysteresis", joint, level=level, length=length
    )


def _elastic(world: World, random: Random) -> tuple[World, Hidden]:
    joint = int(random.integers(N))
    stiffness = 1.5 * LEVEL[joint] / RANGE[joint] * size(random) * sign(random)
    cable = world.cable.copy()
    cable[1, joint] += stiffness
    if random.random() < 0.4:
        cable[3, joint] += random.uniform(-0.5, 0.5) * stiffness / RANGE[joint] ** 2
        return replace(world, cable=cable), found(world.arm, "elastic_cable", joint)
    return replace(world, cable=cable), found(
        world.arm, "elastic_cable", joint, stiffness=float(stiffness)
    )


def _rotor(world: World, random: Random) -> tuple[World, Hidden]:
    joint = int(random.integers(N))
    inertia = 2.0 * INERTIA[joint] * size(random)
    rotors = world.rotors.copy()
    rotors[joint] += inertia
    return replace(world, rotors=rotors), found(
        world.arm, "rotor_inertia", joint, inertia=float(inertia)
    )


def _link_inertia(world: World, random: Random) -> tuple[World, Hidden]:
    link = int(random.choice([3, 4, 5, 6, 7]))
    added = 2.0 * INERTIA[link - 1] * size(random)
    body = world.links[f"link{link}"]
    links = dict(world.links) | {
        f"link{link}": pin.Inertia(body.mass, body.lever, body.inertia + added * np.eye(3))
    }
    return replace(world, links=links), found(
        world.arm, "link_inertia", link - 1, inertia=float(added)
    )


def _drift(world: World, random: Random) -> tuple[World, Hidden]:
    joint = int(random.integers(N))
    level = 2.0 * LEVEL[joint] * size(random) * sign(random)
    constant = float(random.uniform(6.0, 40.0))
    extra = on_joint(joint, lambda time, q, v: level * (1.0 - np.exp(-time / constant)))
    # It begins with the ramp into the motion, before the recording does.
    recorded = level * float(np.exp(-Multisine.ramp / constant))
    return replace(world, extra=(*world.extra, extra)), found(
        world.arm, "thermal_drift", joint, torque=recorded, time_constant=constant
    )


def _cogging(world: World, random: Random) -> tuple[World, Hidden]:
    joint = int(random.integers(N))
    amplitude = 1.5 * LEVEL[joint] * size(random)
    cycles = float(random.uniform(10.0, 30.0) / RANGE[joint])
    phase = float(random.uniform(-np.pi, np.pi))
    to_motor = world.arm.joint_to_actuator

    def extra(time: float, q: Array, v: Array) -> Array:
        del time, v
        motor = np.zeros_like(q)
        motor[joint] = amplitude * np.cos(cycles * (to_motor[joint] @ q) + phase)
        return world.arm.joint_effort(motor)

    return replace(world, extra=(*world.extra, extra)), found(
        world.arm, "cogging", joint, amplitude=amplitude, cycles_per_revolution=cycles
    )


def _contact(world: World, random: Random) -> tuple[World, Hidden]:
    joint = int(random.integers(N))
    level = 3.0 * LEVEL[joint] * size(random) * sign(random)
    # It ends before a recording of 20 s does: a push that does not end is no window.
    start = float(random.uniform(3.0, 12.0))
    end = start + float(random.uniform(2.0, 6.0))
    # The plant's clock includes the second before the recording.
    extra = on_joint(joint, lambda time, q, v: level * (start + 1.0 <= time < end + 1.0))
    return replace(world, extra=(*world.extra, extra)), found(
        world.arm, "contact", joint, torque=level, start=start, end=end
    )


def _spring(world: World, random: Random) -> tuple[World, Hidden]:
    first = int(random.integers(N - 2))
    second = first + int(random.integers(1, 3))
    ratio, sign_ = float(random.uniform(0.6, 1.6)), sign(random)
    stretch = RANGE[first] + ratio * RANGE[second]
    least = max(LEVEL[first], LEVEL[second] / ratio)
    stiffness = 2.0 * least / stretch * size(random)
    slack = float(random.uniform(-0.5, 0.5) * stretch)

    def extra(time: float, q: Array, v: Array) -> Array:
        pull = stiffness * (q[first] + sign_ * ratio * q[second] - slack)
        result = np.zeros_like(q)
        result[first], result[second] = pull, sign_ * ratio * pull
        return result

    names = (world.arm.joint_names[first], world.arm.joint_names[second])
    hidden = Hidden("joint_spring", names, {"stiffness": float(stiffness), "ratio": ratio})
    return replace(world, extra=(*world.extra, extra)), hidden


def _outside(world: World, random: Random) -> tuple[World, Hidden]:
    joint = int(random.integers(N - 1))
    other = int(random.choice([k for k in range(N) if k != joint]))
    level = 3.0 * LEVEL[joint] * size(random)
    frequency = float(random.uniform(0.3, 2.0))
    middle = 0.5 * (world.arm.lower + world.arm.upper)

    def of_two_positions(time: float, q: Array, v: Array) -> float:
        # A force that no energy belongs to.
        relative = (q - middle) / RANGE
        return float(np.sin(2.0 * relative[other]) * np.sin(2.0 * relative[joint]))

    def oscillating(time: float, q: Array, v: Array) -> float:
        return float(np.sin(2.0 * np.pi * frequency * time))

    def dragged(time: float, q: Array, v: Array) -> float:
        return float(np.tanh(v[other] / SPEED[other]) ** 2)

    shape = (of_two_positions, oscillating, dragged)[int(random.integers(3))]

    def extra(time: float, q: Array, v: Array) -> Array:
        result = np.zeros_like(q)
        result[joint] = level * shape(time, q, v)
        return result

    return replace(world, extra=(*world.extra, extra)), found(world.arm, "outside", joint)


Hider = Callable[[World, Random], tuple[World, Hidden]]

_ADDED: Mapping[str, Hider] = {
    "joint_spring": _spring,
    "encoder_scale": encoder_scale,
    "torque_saturation": torque_saturation,
    "joint_flexibility": joint_flexibility,
}

HIDERS: Mapping[str, Hider] = {
    "nothing": _nothing,
    "payload": _payload,
    "base_tilt": _base_tilt,
    "link_com": _link_com,
    "coulomb_friction": _coulomb,
    "viscous_friction": _viscous,
    "stribeck_friction": _stribeck,
    "presliding_hysteresis": _presliding,
    "elastic_cable": _elastic,
    "rotor_inertia": _rotor,
    "link_inertia": _link_inertia,
    "thermal_drift": _drift,
    "cogging": _cogging,
    "contact": _contact,
    "outside": _outside,
    **READINGS,
    **_ADDED,
}
"""Effect -> how it is hidden."""

STREAMS: Mapping[str, int] = {
    effect: number
    for number, effect in enumerate((*sorted(HIDERS.keys() - _ADDED.keys()), *_ADDED))
}
"""Effect -> number of its random stream. New effects come last, and move no other's."""
