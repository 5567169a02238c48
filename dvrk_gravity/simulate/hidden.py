"""Hide an effect of the vocabulary in a simulated arm or in what its sensors say.

Causes of torque go into the plant and bend its motion; wrong readings go into the sensors.
Neither uses the columns that the diagnosis fits.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from dvrk_gravity.arm import JOINT_NAMES, N_JOINTS, gravity_in_base
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.recording import Recording
from dvrk_gravity.simulate.hidden_plant import Dahl, Stribeck, Torque
from dvrk_gravity.simulate.world import World

Array = NDArray[np.float64]
Random = np.random.Generator

# Effort noise of the joints sets the scale of what is hidden, N·m.
_LEVEL = np.array([0.02, 0.04, 0.03, 0.01, 0.005, 0.004, 0.002])
_SPEED = np.array([0.25, 0.25, 0.25, 1.2, 0.7, 0.35, 1.3])  # typical of the motions, rad/s
_RANGE = np.array([0.5, 0.4, 0.4, 1.5, 1.2, 0.4, 1.5])  # half the way of the motions, rad
_LOADED = (1, 2, 4, 5)  # joints that feel gravity
_INERTIA = np.array([0.006, 0.006, 0.006, 0.0004, 0.0003, 0.0003, 0.0002])


@dataclass(frozen=True)
class Hidden:
    """What was hidden.

    Attributes:
        effect: Name in the vocabulary, ``"nothing"``, or ``"outside"`` for what has no name there.
        joints: Joints that it is said of.
        parameters: True values by the names that findings use.
    """

    effect: str
    joints: tuple[str, ...]
    parameters: Mapping[str, float]


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


def _found(effect: str, joint: int | None, **parameters: float) -> Hidden:
    joints = () if joint is None else (JOINT_NAMES[joint],)
    return Hidden(effect, joints, parameters)


def _size(random: Random, low: float = 1.0, high: float = 4.0) -> float:
    return float(np.exp(random.uniform(np.log(low), np.log(high))))


def _sign(random: Random) -> float:
    return float(random.choice([-1.0, 1.0]))


def _on_joint(joint: int, function: Callable[[float, float, float], float]) -> Torque:
    """Return a torque on one joint from (time, its position, its velocity)."""

    def torque(time: float, q: Array, v: Array) -> Array:
        result = np.zeros(N_JOINTS)
        result[joint] = function(time, q[joint], v[joint])
        return result

    return torque


def _nothing(world: World, random: Random) -> tuple[World, Hidden]:
    del random
    return world, _found("nothing", None)


def _payload(world: World, random: Random) -> tuple[World, Hidden]:
    link = int(random.choice([7, 7, 6, 3]))
    mass = 0.03 * _size(random)
    place = random.uniform(-0.03, 0.03, 3)
    body = world.links[f"link{link}"]
    added = pin.Inertia(mass, place, np.zeros((3, 3)))
    # World.links are inertias about the centre of mass, so `+` combines the bodies.
    links = dict(world.links) | {f"link{link}": body + added}
    return replace(world, links=links), _found("payload", link - 1, mass=mass)


def _base_tilt(world: World, random: Random) -> tuple[World, Hidden]:
    roll, pitch = np.radians(random.uniform(1.5, 5.0, 2)) * random.choice([-1.0, 1.0], 2)
    tilted = replace(world, gravity=gravity_in_base(float(roll), float(pitch)))
    return tilted, _found("base_tilt", None, roll=float(roll), pitch=float(pitch))


def _link_com(world: World, random: Random) -> tuple[World, Hidden]:
    index, joint = ((0, 1), (2, 2), (5, 4), (6, 4), (8, 5), (9, 5))[int(random.integers(6))]
    delta = 2.0 * _LEVEL[joint] * _size(random) * _sign(random)
    counterweight = world.counterweight.copy()
    counterweight[index] += delta
    return replace(world, counterweight=counterweight), _found("link_com", joint, delta_beta=delta)


def _joint_offset(world: World, random: Random) -> tuple[World, Hidden]:
    joint = int(random.choice([1, 2, 3, 4, 5]))
    offset = np.radians(random.uniform(3.0, 8.0)) * _sign(random)
    shift = np.zeros(N_JOINTS)
    shift[joint] = offset

    def reading(recording: Recording) -> Recording:
        return replace(recording, position=recording.position + shift)

    return _read(world, reading), _found("joint_offset", joint, offset=float(offset))


def _torque_scale(world: World, random: Random) -> tuple[World, Hidden]:
    joint = int(random.choice(_LOADED))
    factor = float(random.choice([random.uniform(0.5, 0.85), random.uniform(1.15, 1.7)]))
    scale = np.ones(N_JOINTS)
    scale[joint] = factor
    return _read(world, _effort(lambda effort: effort * scale)), _found(
        "torque_scale", joint, factor=factor
    )


def _torque_offset(world: World, random: Random) -> tuple[World, Hidden]:
    joint = int(random.integers(N_JOINTS))
    offset = _LEVEL[joint] * _size(random) * _sign(random)
    shift = np.zeros(N_JOINTS)
    shift[joint] = offset
    return _read(world, _effort(lambda effort: effort + shift)), _found(
        "torque_offset", joint, offset=offset
    )


def _coulomb(world: World, random: Random) -> tuple[World, Hidden]:
    joint = int(random.integers(N_JOINTS))
    up = _LEVEL[joint] * _size(random)
    down = up * float(random.choice([1.0, random.uniform(0.6, 1.6)]))
    coulomb = world.coulomb.copy()
    coulomb[:2, joint] += (up, down)
    return replace(world, coulomb=coulomb), _found(
        "coulomb_friction", joint, positive=up, negative=down
    )


def _viscous(world: World, random: Random) -> tuple[World, Hidden]:
    joint = int(random.integers(N_JOINTS))
    damping = _LEVEL[joint] / _SPEED[joint] * _size(random)
    viscous = world.viscous.copy()
    viscous[joint] += damping
    return replace(world, viscous=viscous), _found(
        "viscous_friction", joint, coefficient=float(damping)
    )


def _stribeck(world: World, random: Random) -> tuple[World, Hidden]:
    joint = int(random.integers(N_JOINTS))
    level = 2.0 * _LEVEL[joint] * _size(random)
    velocity = float(_SPEED[joint] * random.uniform(0.2, 0.6))
    added = Stribeck(joint, level, velocity)
    return replace(world, stribeck=(*world.stribeck, added)), _found(
        "stribeck_friction", joint, level=level, velocity=velocity
    )


def _presliding(world: World, random: Random) -> tuple[World, Hidden]:
    joint = int(random.integers(N_JOINTS))
    level = 1.5 * _LEVEL[joint] * _size(random)
    length = float(_RANGE[joint] * random.uniform(0.05, 0.25))
    added = Dahl(joint, level, length)
    return replace(world, extra=(*world.extra, added)), _found(
        "presliding_hysteresis", joint, level=level, length=length
    )


def _elastic(world: World, random: Random) -> tuple[World, Hidden]:
    joint = int(random.integers(N_JOINTS))
    stiffness = 1.5 * _LEVEL[joint] / _RANGE[joint] * _size(random) * _sign(random)
    cable = world.cable.copy()
    cable[1, joint] += stiffness
    if random.random() < 0.4:
        cable[3, joint] += random.uniform(-0.5, 0.5) * stiffness / _RANGE[joint] ** 2
        return replace(world, cable=cable), _found("elastic_cable", joint)
    return replace(world, cable=cable), _found("elastic_cable", joint, stiffness=float(stiffness))


def _rotor(world: World, random: Random) -> tuple[World, Hidden]:
    joint = int(random.integers(N_JOINTS))
    inertia = 2.0 * _INERTIA[joint] * _size(random)
    rotors = world.rotors.copy()
    rotors[joint] += inertia
    return replace(world, rotors=rotors), _found("rotor_inertia", joint, inertia=float(inertia))


def _link_inertia(world: World, random: Random) -> tuple[World, Hidden]:
    link = int(random.choice([3, 4, 5, 6, 7]))
    added = 2.0 * _INERTIA[link - 1] * _size(random)
    body = world.links[f"link{link}"]
    links = dict(world.links) | {
        f"link{link}": pin.Inertia(body.mass, body.lever, body.inertia + added * np.eye(3))
    }
    return replace(world, links=links), _found("link_inertia", link - 1, inertia=float(added))


def _coupling(world: World, random: Random) -> tuple[World, Hidden]:
    source, target = (int(j) for j in random.choice([(1, 2), (2, 3), (1, 3), (2, 4), (4, 5)]))
    factor = random.uniform(0.08, 0.3) * _sign(random)
    leak = np.eye(N_JOINTS)
    leak[source, target] = factor
    hidden = Hidden(
        "joint_coupling", (JOINT_NAMES[target], JOINT_NAMES[source]), {"factor": factor}
    )
    return _read(world, _effort(lambda effort: effort @ leak)), hidden


def _coordinates(world: World, random: Random) -> tuple[World, Hidden]:
    which = random.choice(["actuator", "sign", "swap"])
    arm = world.arm
    if which == "actuator":

        def reading(recording: Recording) -> Recording:
            assert recording.velocity is not None
            assert recording.effort is not None
            return replace(
                recording,
                position=arm.actuator_position(recording.position),
                velocity=arm.actuator_position(recording.velocity),
                effort=arm.actuator_effort(recording.effort),
            )

        return _read(world, reading), _found("wrong_coordinates", None)
    order, sign = np.arange(N_JOINTS), np.ones(N_JOINTS)
    joint = int(random.choice(_LOADED))
    hidden = _found("wrong_coordinates", joint)
    if which == "sign":
        sign[joint] = -1.0
    else:
        order[[4, 5]] = (5, 4)
        hidden = Hidden("wrong_coordinates", (JOINT_NAMES[4], JOINT_NAMES[5]), {})

    def mixed(recording: Recording) -> Recording:
        def turn(values: Array) -> Array:
            return values[:, order] * sign

        assert recording.velocity is not None
        assert recording.effort is not None
        return replace(
            recording,
            position=turn(recording.position),
            velocity=turn(recording.velocity),
            effort=turn(recording.effort),
        )

    return _read(world, mixed), hidden


def _delay(world: World, random: Random) -> tuple[World, Hidden]:
    delay = round(float(random.uniform(0.008, 0.04)), 3)
    sensors = replace(world.sensors, effort_delay=delay)
    return replace(world, sensors=sensors), _found("time_delay", None, delay=delay)


def _drift(world: World, random: Random) -> tuple[World, Hidden]:
    joint = int(random.integers(N_JOINTS))
    level = 2.0 * _LEVEL[joint] * _size(random) * _sign(random)
    constant = float(random.uniform(6.0, 40.0))
    extra = _on_joint(joint, lambda time, q, v: level * (1.0 - np.exp(-time / constant)))
    return replace(world, extra=(*world.extra, extra)), _found(
        "thermal_drift", joint, torque=level, time_constant=constant
    )


def _saturation(world: World, random: Random) -> tuple[World, Hidden]:
    joint = int(random.choice(_LOADED))
    part = random.uniform(0.5, 0.75)
    hidden = _found("effort_saturation", joint)

    def reading(recording: Recording) -> Recording:
        assert recording.effort is not None
        effort = recording.effort.copy()
        limit = part * np.percentile(np.abs(effort[:, joint]), 99.5)
        effort[:, joint] = np.clip(effort[:, joint], -limit, limit)
        return replace(recording, effort=effort)

    return _read(world, reading), hidden


def _cogging(world: World, random: Random) -> tuple[World, Hidden]:
    joint = int(random.integers(N_JOINTS))
    amplitude = 1.5 * _LEVEL[joint] * _size(random)
    cycles = float(random.uniform(10.0, 30.0) / _RANGE[joint])
    phase = float(random.uniform(-np.pi, np.pi))
    to_motor = world.arm.joint_to_actuator

    def extra(time: float, q: Array, v: Array) -> Array:
        del time, v
        motor = np.zeros(N_JOINTS)
        motor[joint] = amplitude * np.cos(cycles * (to_motor[joint] @ q) + phase)
        return world.arm.joint_effort(motor)

    return replace(world, extra=(*world.extra, extra)), _found(
        "cogging", joint, amplitude=amplitude, cycles_per_revolution=cycles
    )


def _contact(world: World, random: Random) -> tuple[World, Hidden]:
    joint = int(random.integers(N_JOINTS))
    level = 3.0 * _LEVEL[joint] * _size(random) * _sign(random)
    start = float(random.uniform(4.0, 20.0))
    end = start + float(random.uniform(2.0, 6.0))
    # The plant's clock includes the second before the recording.
    extra = _on_joint(joint, lambda time, q, v: level * (start + 1.0 <= time < end + 1.0))
    return replace(world, extra=(*world.extra, extra)), _found(
        "contact", joint, torque=level, start=start, end=end
    )


def _outside(world: World, random: Random) -> tuple[World, Hidden]:
    joint = int(random.integers(N_JOINTS - 1))
    other = int(random.choice([k for k in range(N_JOINTS) if k != joint]))
    level = 3.0 * _LEVEL[joint] * _size(random)
    frequency = float(random.uniform(0.3, 2.0))
    middle = 0.5 * (world.arm.lower + world.arm.upper)

    def of_two_positions(time: float, q: Array, v: Array) -> float:
        # A force that no energy belongs to.
        relative = (q - middle) / _RANGE
        return float(np.sin(2.0 * relative[other]) * np.sin(2.0 * relative[joint]))

    def oscillating(time: float, q: Array, v: Array) -> float:
        return float(np.sin(2.0 * np.pi * frequency * time))

    def dragged(time: float, q: Array, v: Array) -> float:
        return float(np.tanh(v[other] / _SPEED[other]) ** 2)

    shape = (of_two_positions, oscillating, dragged)[int(random.integers(3))]

    def extra(time: float, q: Array, v: Array) -> Array:
        result = np.zeros(N_JOINTS)
        result[joint] = level * shape(time, q, v)
        return result

    return replace(world, extra=(*world.extra, extra)), _found("outside", joint)


def _read(world: World, reading: Callable[[Recording], Recording]) -> World:
    return replace(world, readings=(*world.readings, reading))


def _effort(change: Callable[[Array], Array]) -> Callable[[Recording], Recording]:
    def reading(recording: Recording) -> Recording:
        assert recording.effort is not None
        return replace(recording, effort=change(recording.effort))

    return reading


HIDERS: Mapping[str, Callable[[World, Random], tuple[World, Hidden]]] = {
    "nothing": _nothing,
    "payload": _payload,
    "base_tilt": _base_tilt,
    "link_com": _link_com,
    "joint_offset": _joint_offset,
    "torque_scale": _torque_scale,
    "torque_offset": _torque_offset,
    "coulomb_friction": _coulomb,
    "viscous_friction": _viscous,
    "stribeck_friction": _stribeck,
    "presliding_hysteresis": _presliding,
    "elastic_cable": _elastic,
    "rotor_inertia": _rotor,
    "link_inertia": _link_inertia,
    "joint_coupling": _coupling,
    "wrong_coordinates": _coordinates,
    "time_delay": _delay,
    "thermal_drift": _drift,
    "effort_saturation": _saturation,
    "cogging": _cogging,
    "contact": _contact,
    "outside": _outside,
}
"""Effect -> how it is hidden."""
