"""Hypotheses of friction, drives and everything else that one joint or motor does by itself."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arm import N_JOINTS, Arm
from dvrk_gravity.diagnosis.hypothesis import Hypothesis
from dvrk_gravity.diagnosis.motion import Motion
from dvrk_gravity.effects import CoulombFriction

Array = NDArray[np.float64]
Setting = Mapping[str, float]

RESOLVED = 3.0  # encoder steps that a length of presliding must have to be seen
_REPLACED = 1.5  # times the model's Coulomb friction: more than that, it cannot take away
LENGTHS = (0.02, 0.06, 0.15, 0.35)  # of half the way of the joint
SPEEDS = (0.12, 0.3, 0.7)  # of the RMS speed
DRIFT_TIMES = (4.0, 10.0, 25.0, 60.0)  # s
DEGREES = (1, 2, 3, 4, 6)


def places(motion: Motion) -> Iterator[tuple[int, str, Array]]:
    """Yield (index, ``joint`` or ``motor``, (7,) row joint velocities -> its velocity)."""
    to_motor = motion.arm.joint_to_actuator
    for joint in range(N_JOINTS):
        if motion.moves[joint] or _both_ways(motion, joint):
            yield joint, "joint", np.eye(N_JOINTS)[joint]
    for motor in mixed_motors(motion.arm):
        if motion.moves[to_motor[motor] != 0.0].any() and motion.present.all():
            yield motor, "motor", to_motor[motor]


def _both_ways(motion: Motion, joint: int) -> bool:
    """Tell whether poses at which a joint is always the same were approached from both sides."""
    return motion.direction is not None and bool(np.ptp(motion.direction[:, joint]) > 0.0)


def mixed_motors(arm: Arm) -> list[int]:
    """Return the motors that move more than their own joint, or other joints with theirs."""
    off = np.abs(arm.joint_to_actuator - np.eye(N_JOINTS)).max(axis=1)
    return [int(motor) for motor in np.flatnonzero(off > 1e-9)]


def spread(row: Array, *values: Array) -> Array:
    """Return (N, 7, k) torques that (N,) values at a row of the joints mean at the joints."""
    return np.stack([value[:, None] * row for value in values], axis=2)


def friction(motion: Motion) -> Iterator[Hypothesis]:
    """Yield Coulomb, viscous, Stribeck and presliding friction, everywhere."""
    for joint, place, row in places(motion):
        if motion.static and motion.direction is None:
            return
        slow = motion.slowest(row)
        for one_level in (True, False):
            yield _coulomb(joint, place, row, None if motion.static else slow, one_level)
        if motion.static:
            continue
        yield _viscous(joint, place, row)
        speed = float(np.sqrt(np.mean((motion.qd @ row) ** 2)))
        for part in SPEEDS:
            yield _stribeck(joint, place, row, {"velocity": part * speed})
        half = float(np.ptp(np.percentile(motion.q @ row, [1, 99]))) / 2
        # What happens within few steps of an encoder looks like what happens at low speed.
        known = _known_coulomb(motion, joint, place)
        shortest = RESOLVED * float(motion.step @ np.abs(row))
        for length in sorted({max(part * half, shortest) for part in LENGTHS}):
            yield _presliding(joint, place, row, length, shortest)
            yield _presliding(joint, place, row, length, shortest, known)


def _coulomb(joint: int, place: str, row: Array, slow: float | None, one_level: bool) -> Hypothesis:
    """Return Coulomb friction that is whole from a speed on; of poses, whole (``slow`` is None)."""

    def build(motion: Motion, setting: Setting) -> Array:
        sign = motion.sign(row, setting.get("transition"))
        if one_level:
            return spread(row, sign)
        return spread(row, np.maximum(sign, 0.0), np.minimum(sign, 0.0))

    def describe(theta: Array, setting: Setting) -> dict[str, float]:
        del setting
        return {"positive": float(theta[0]), "negative": float(theta[-1])}

    return Hypothesis(
        "coulomb_friction", (joint,), place, build, describe,
        {} if slow is None else {"transition": slow}, () if slow is None else ("transition",),
        variable="velocity",
    )  # fmt: skip


def _viscous(joint: int, place: str, row: Array) -> Hypothesis:
    return Hypothesis(
        "viscous_friction", (joint,), place,
        lambda motion, _: spread(row, motion.qd @ row),
        lambda theta, _: {"coefficient": float(theta[0])},
        variable="velocity",
    )  # fmt: skip


def _stribeck(joint: int, place: str, row: Array, setting: Setting) -> Hypothesis:
    def build(motion: Motion, setting: Setting) -> Array:
        ratio = (motion.qd @ row) / setting["velocity"]
        return spread(row, motion.sign(row) * np.exp(-(ratio**2)))

    def describe(theta: Array, setting: Setting) -> dict[str, float]:
        return {"level": float(theta[0]), "velocity": setting["velocity"]}

    return Hypothesis(
        "stribeck_friction", (joint,), place, build, describe, setting, ("velocity",),
        variable="velocity", prior_count=3,
    )  # fmt: skip


def _presliding(
    joint: int, place: str, row: Array, length: float, shortest: float, known: float | None = None
) -> Hypothesis:
    """Return presliding; with the model's Coulomb friction, part of it may stand in its place."""

    def build(motion: Motion, setting: Setting) -> Array:
        bent = dahl(motion, row, max(setting["length"], shortest))
        return spread(row, bent, motion.sign(row)) if known is not None else spread(row, bent)

    def describe(theta: Array, setting: Setting) -> dict[str, float]:
        values = {"level": float(theta[0]), "length": max(setting["length"], shortest)}
        return values | ({"coulomb": float(theta[1])} if known is not None else {})

    return Hypothesis(
        "presliding_hysteresis", (joint,), place, build, describe, {"length": length}, ("length",),
        variable="position", prior_count=4,
        least={} if known is None else {"coulomb": -_REPLACED * known},
    )  # fmt: skip


def _known_coulomb(motion: Motion, joint: int, place: str) -> float:
    """Return the model's Coulomb friction at a place, N·m."""
    term = motion.model.term(CoulombFriction.NAME)
    if not isinstance(term, CoulombFriction):
        return 0.0
    if place == "motor":
        return float(max(term.motor_positive[joint], term.motor_negative[joint]))
    at_motor = max(term.motor_positive[joint], term.motor_negative[joint])
    return float(max(term.joint_positive[joint], term.joint_negative[joint]) + at_motor)


def dahl(motion: Motion, row: Array, length: float) -> Array:
    """Return (N,) state of a Dahl element in [-1, 1]: exact along every step of the way.

    It starts relaxed in every part; after the first reversal it no longer matters.
    """
    state = np.zeros(len(motion.q))
    way = np.diff(motion.q @ row, prepend=0.0)
    for part in motion.parts:
        step = way[part].copy()
        step[0] = 0.0
        goal, keep = np.sign(step), np.exp(-np.abs(step) / length)
        value = 0.0
        values = []
        for g, k in zip(goal.tolist(), keep.tolist(), strict=True):
            value = g + (value - g) * k
            values.append(value)
        state[part] = values
    return state


def position_and_time(motion: Motion) -> Iterator[Hypothesis]:
    """Yield offsets, cables, drifts and rotor inertia, everywhere."""
    to_motor = motion.arm.joint_to_actuator
    for joint in np.flatnonzero(motion.present).tolist():
        yield _offset(joint)
        if motion.moves[joint]:
            middle, half = motion.travel[0][joint], motion.travel[1][joint]
            for degree in DEGREES:
                yield cable(joint, degree, float(middle), float(half))
        if not motion.static:
            for constant in DRIFT_TIMES:
                yield _drift(joint, constant)
    if not motion.static:
        for motor in range(N_JOINTS):
            if motion.moves[to_motor[motor] != 0].any():
                yield _rotor(motor, to_motor[motor])


def _offset(joint: int) -> Hypothesis:
    row = np.eye(N_JOINTS)[joint]
    return Hypothesis(
        "torque_offset", (joint,), "joint",
        lambda motion, _: spread(row, np.ones(len(motion.q))),
        lambda theta, _: {"offset": float(theta[0])},
        variable="position",
    )  # fmt: skip


def cable(joint: int, degree: int, middle: float, half: float) -> Hypothesis:
    """Return the hypothesis of an elastic torque: a polynomial of the joint's position.

    Args:
        joint: Index of the joint.
        degree: Of the polynomial; its constant is where the spring is relaxed.
        middle: Middle of the joint's way, rad.
        half: Half of it, rad.
    """
    row = np.eye(N_JOINTS)[joint]

    def build(motion: Motion, setting: Setting) -> Array:
        del setting
        # Chebyshev polynomials are the same space as powers, and well conditioned.
        x = np.clip((motion.q[:, joint] - middle) / half, -1.1, 1.1)
        values = np.polynomial.chebyshev.chebvander(x, degree)
        return spread(row, *values.T)

    def describe(theta: Array, setting: Setting) -> dict[str, float]:
        del setting
        scaled = np.polynomial.chebyshev.Chebyshev(theta, [middle - half, middle + half])
        powers = scaled.convert(kind=np.polynomial.Polynomial).coef
        powers = np.pad(powers, (0, degree + 1 - len(powers)))
        values = {f"k{i}": float(value) for i, value in enumerate(powers)}
        values = {"stiffness": float(scaled.deriv()(middle))} | values
        if degree == 1:
            return values
        # One slope says little of a curve: between what it pulls, over the way.
        way = scaled(np.linspace(middle - half, middle + half, 101))
        return {"lowest": float(way.min()), "highest": float(way.max())} | values

    return Hypothesis("elastic_cable", (joint,), f"degree {degree}", build, describe)


def _drift(joint: int, constant: float) -> Hypothesis:
    row = np.eye(N_JOINTS)[joint]

    def build(motion: Motion, setting: Setting) -> Array:
        rise = 1.0 - np.exp(-motion.time / setting["time_constant"])
        return spread(row, rise, np.ones(len(rise)))

    def describe(theta: Array, setting: Setting) -> dict[str, float]:
        return {"torque": float(theta[0]), "time_constant": setting["time_constant"]}

    return Hypothesis(
        "thermal_drift", (joint,), "joint", build, describe, {"time_constant": constant},
        ("time_constant",), variable="time", prior_count=4,
    )  # fmt: skip


def _rotor(motor: int, row: Array) -> Hypothesis:
    return Hypothesis(
        "rotor_inertia", (motor,), "motor",
        lambda motion, _: spread(row, motion.qdd @ row),
        lambda theta, _: {"inertia": float(theta[0])},
        variable="acceleration",
    )  # fmt: skip
