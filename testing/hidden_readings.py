"""Wrong readings, hidden in what the sensors say."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from scipy.signal import butter, sosfiltfilt

from dvrk_gravity.effects import State
from dvrk_gravity.recording import Recording
from testing.hidden_parts import (
    LEVEL,
    LOADED,
    Array,
    Hidden,
    N,
    Random,
    found,
    saturated,
    sign,
    size,
)
from testing.world import World

_BAND = 5.0  # Hz, of the motions
_BEHIND_SPRINGS = ("gravity", "link_inertia", "elastic_cable")


def _joint_offset(world: World, random: Random) -> tuple[World, Hidden]:
    joint = int(random.choice([1, 2, 3, 4, 5]))
    offset = np.radians(size(random, 0.8, 3.0)) * sign(random)
    shift = np.zeros(N)
    shift[joint] = offset

    def reading(recording: Recording) -> Recording:
        return replace(recording, position=recording.position + shift)

    return _read(world, reading), found(world.arm, "joint_offset", joint, offset=float(offset))


def encoder_scale(world: World, random: Random) -> tuple[World, Hidden]:
    """Let an encoder read too far or too short, so that position and velocity are a factor off."""
    joint = int(random.choice([1, 2, 4]))
    factor = 1.0 + float(random.uniform(0.06, 0.15)) * sign(random)
    scale = np.ones(N)
    scale[joint] = factor

    def reading(recording: Recording) -> Recording:
        assert recording.velocity is not None
        return replace(
            recording, position=recording.position * scale, velocity=recording.velocity * scale
        )

    return _read(world, reading), found(world.arm, "encoder_scale", joint, factor=factor)


def joint_flexibility(world: World, random: Random) -> tuple[World, Hidden]:
    """Let a joint give way under its load: its encoder is at the motor, the link behind it."""
    joint, load = ((1, 0.8), (2, 0.6), (4, 0.03))[int(random.integers(3))]
    # The motions load the joint by about so much, N·m.
    stiffness = load / np.radians(size(random, 0.8, 3.0))
    links = [term for term in world.model().terms if term.NAME in _BEHIND_SPRINGS]

    def reading(recording: Recording) -> Recording:
        assert recording.velocity is not None
        assert recording.rate is not None
        step = 1.0 / recording.rate
        low = butter(2, _BAND, fs=recording.rate, output="sos")
        q, qd = (
            sosfiltfilt(low, each, axis=0) for each in (recording.position, recording.velocity)
        )
        state = State(q, qd, np.gradient(qd, step, axis=0))
        give = sum(term.torque(state)[:, joint] for term in links) / stiffness
        position, velocity = recording.position.copy(), recording.velocity.copy()
        position[:, joint] += give
        velocity[:, joint] += np.gradient(give, step)
        return replace(recording, position=position, velocity=velocity)

    hidden = found(world.arm, "joint_flexibility", joint, stiffness=float(stiffness))
    return _read(world, reading), hidden


def torque_saturation(world: World, random: Random) -> tuple[World, Hidden]:
    """Let a motor's torque constant fall with its current, which is read as its effort."""
    joint = int(random.choice(LOADED))
    part = float(random.uniform(0.07, 0.13))

    def reading(recording: Recording) -> Recording:
        assert recording.effort is not None
        effort = recording.effort.copy()
        effort[:, joint] = saturated(effort[:, joint], part)
        return replace(recording, effort=effort)

    return _read(world, reading), found(world.arm, "torque_saturation", joint)


def _torque_scale(world: World, random: Random) -> tuple[World, Hidden]:
    joint = int(random.choice(LOADED))
    factor = float(random.choice([random.uniform(0.5, 0.85), random.uniform(1.15, 1.7)]))
    scale = np.ones(N)
    scale[joint] = factor
    return _read(world, _effort(lambda effort: effort * scale)), found(
        world.arm, "torque_scale", joint, factor=factor
    )


def _torque_offset(world: World, random: Random) -> tuple[World, Hidden]:
    joint = int(random.integers(N))
    offset = LEVEL[joint] * size(random) * sign(random)
    shift = np.zeros(N)
    shift[joint] = offset
    return _read(world, _effort(lambda effort: effort + shift)), found(
        world.arm, "torque_offset", joint, offset=offset
    )


def _coupling(world: World, random: Random) -> tuple[World, Hidden]:
    source, target = (int(j) for j in random.choice([(1, 2), (2, 3), (1, 3), (2, 4), (4, 5)]))
    factor = random.uniform(0.08, 0.3) * sign(random)
    leak = np.eye(N)
    leak[source, target] = factor
    hidden = Hidden(
        "joint_coupling",
        (world.arm.joint_names[target], world.arm.joint_names[source]),
        {"factor": factor},
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

        return _read(world, reading), found(world.arm, "wrong_coordinates", None)
    order, sign = np.arange(N), np.ones(N)
    joint = int(random.choice(LOADED))
    hidden = found(world.arm, "wrong_coordinates", joint)
    if which == "sign":
        sign[joint] = -1.0
    else:
        order[[4, 5]] = (5, 4)
        hidden = Hidden(
            "wrong_coordinates", (world.arm.joint_names[4], world.arm.joint_names[5]), {}
        )

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
    return replace(world, sensors=sensors), found(world.arm, "time_delay", None, delay=delay)


def _saturation(world: World, random: Random) -> tuple[World, Hidden]:
    joint = int(random.choice(LOADED))
    part = random.uniform(0.5, 0.75)
    hidden = found(world.arm, "effort_saturation", joint)

    def reading(recording: Recording) -> Recording:
        assert recording.effort is not None
        effort = recording.effort.copy()
        limit = part * np.percentile(np.abs(effort[:, joint]), 99.5)
        effort[:, joint] = np.clip(effort[:, joint], -limit, limit)
        return replace(recording, effort=effort)

    return _read(world, reading), hidden


def _read(world: World, reading: Callable[[Recording], Recording]) -> World:
    return replace(world, readings=(*world.readings, reading))


def _effort(change: Callable[[Array], Array]) -> Callable[[Recording], Recording]:
    def reading(recording: Recording) -> Recording:
        assert recording.effort is not None
        return replace(recording, effort=change(recording.effort))

    return reading


READINGS: Mapping[str, Callable[[World, Random], tuple[World, Hidden]]] = {
    "joint_offset": _joint_offset,
    "torque_scale": _torque_scale,
    "torque_offset": _torque_offset,
    "joint_coupling": _coupling,
    "wrong_coordinates": _coordinates,
    "time_delay": _delay,
    "effort_saturation": _saturation,
}
"""Effect -> how it is hidden."""
