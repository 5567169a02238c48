"""The plant against MuJoCo, closed forms and optimality: motion, friction, stops, holding."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from made_up_arm import random_inertias
from scipy.optimize import lsq_linear

from dvrk_gravity.arms import Arm, LinkMass, beta_from_links
from dvrk_gravity.effects import CoulombFriction, Gravity, ViscousFriction
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.simulate import FrictionSolver, Plant, PlantFile
from testing.mujoco_arms import mtm

ROTORS = np.array([0.0043, 0.0026, 0.0038, 0.00012, 0.000062, 0.000062, 0.000015])
# Motor angles from joint angles, written out: a3 = q2 + q3, a4 = q4 + 0.6697 q3.
MOTORS = np.eye(7)
MOTORS[2, 1], MOTORS[3, 2] = 1.0, 0.6697
DT = 1e-3


@pytest.fixture(scope="module")
def truth() -> PlantFile:
    return PlantFile.load("mtmr_28002")


@pytest.fixture(scope="module")
def wide_arm() -> Arm:
    """An arm that never meets a stop."""
    arm = Arm.load("mtmr")
    joints = tuple(replace(joint, lower=-100.0, upper=100.0) for joint in arm.joints)
    return replace(arm, name="wide", joints=joints)


def weight_of(arm: Arm, links: Mapping[str, pin.Inertia]) -> Gravity:
    """The gravity term of these links, from the closed form."""
    masses = {name: LinkMass(body.mass, tuple(body.lever)) for name, body in links.items()}
    return Gravity(arm, beta_from_links(masses, columns=14), np.array([0.0, 0.0, -9.81]))


class MtmInMujoco:
    """Accelerations of an MTMR made of these links."""

    def __init__(self, links: Mapping[str, pin.Inertia]) -> None:
        self.engine = mtm("mtmr", links, (0.0, 0.0, -9.81))

    def acceleration(self, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> np.ndarray:
        unit, rest = np.eye(7), np.zeros((7, 7))
        held = self.engine.torque(rest + q, rest, rest)
        mass = (self.engine.torque(rest + q, rest, unit) - held).T
        bias = self.engine.torque(q[None], v[None], rest[:1])[0]
        return np.linalg.solve(mass + MOTORS.T @ np.diag(ROTORS) @ MOTORS, tau - bias)


# --- rigid-body motion -------------------------------------------------------------------


def test_accelerations_are_mujocos(wide_arm: Arm) -> None:
    rng = np.random.default_rng(1)
    for seed in range(3):
        links = random_inertias(wide_arm, seed)
        plant = Plant(TorqueModel(wide_arm, (weight_of(wide_arm, links),)), links, ROTORS)
        oracle = MtmInMujoco(links)
        for _ in range(20):
            q, v, tau = rng.uniform(-3, 3, 7), rng.normal(size=7), rng.normal(scale=0.5, size=7)
            plant.reset(q, v)
            plant.step(tau, dt=DT)
            expected = oracle.acceleration(q, v, tau)
            np.testing.assert_allclose(
                (plant.v - v) / DT, expected, rtol=1e-7, atol=1e-8 * np.abs(expected).max()
            )


# --- friction ----------------------------------------------------------------------------


def weightless(truth: PlantFile, *terms: object) -> Plant:
    """The arm without weight, with just these terms."""
    return Plant(TorqueModel(truth.model.arm, tuple(terms)), truth.links, truth.rotor_inertia)


def coulomb(arm: Arm, **levels: np.ndarray) -> CoulombFriction:
    names = ("joint_positive", "joint_negative", "motor_positive", "motor_negative")
    full = {name: levels.get(name, np.zeros(7)) for name in names}
    return CoulombFriction(
        arm,
        **full,
        transition_velocity=np.full(7, 0.02),
        joint_displacement=np.zeros(7),
        motor_displacement=np.zeros(7),
    )


def joint_vector(joint: int, value: float) -> np.ndarray:
    return np.eye(7)[joint] * value


def test_within_its_level_friction_sticks_and_beyond_it_slides(truth: PlantFile) -> None:
    up, down = np.full(7, 0.02), np.full(7, 0.03)
    term = coulomb(truth.model.arm, joint_positive=up, joint_negative=down)
    plant = weightless(truth, term)
    start = np.array([0.1, 0.2, -0.1, 0.3, 1.0, 0.1, 0.5])
    for joint, effort in itertools.product((0, 2, 6), (0.0199, -0.0299)):
        plant.reset(start)
        for _ in range(100):
            plant.step(joint_vector(joint, effort))
            assert not plant.v.any()
        assert (plant.q == start).all()
    for joint, effort in itertools.product((0, 2, 6), (0.0201, -0.0301)):
        plant.reset(start)
        for _ in range(20):
            plant.step(joint_vector(joint, effort))
        assert plant.v[joint] * effort > 0


def test_sliding_stops_after_the_time_and_way_of_constant_friction(truth: PlantFile) -> None:
    levels = np.array([5.0, 5.0, 5.0, 5.0, 5.0, 5.0, 2e-4])  # the others stand like rock
    term = coulomb(truth.model.arm, joint_positive=levels, joint_negative=levels)
    plant = weightless(truth, term)
    speed = 2.0
    plant.reset(np.zeros(7), joint_vector(6, speed))
    inertia = plant.mass_matrix()[6, 6]
    steps, energy = 0, np.inf
    while plant.v.any():
        plant.step(np.zeros(7))
        steps += 1
        now = 0.5 * plant.v @ plant.mass_matrix() @ plant.v
        assert now < energy  # friction only takes
        energy = now
        assert not plant.v[:6].any()
    time = inertia * speed / 2e-4
    assert steps * DT == pytest.approx(time, abs=1.01 * DT)
    assert plant.q[6] == pytest.approx(0.5 * speed * time, abs=1.01 * DT * speed)


def test_viscous_friction_at_a_motor_brakes_all_that_turns_it(truth: PlantFile) -> None:
    viscous = ViscousFriction(truth.model.arm, np.zeros(7), joint_vector(2, 0.5))
    braked, free = weightless(truth, viscous), weightless(truth)
    for joint_velocity, brake in (
        (joint_vector(1, 1.0), joint_vector(1, -0.5) + joint_vector(2, -0.5)),
        (joint_vector(2, 1.0), joint_vector(1, -0.5) + joint_vector(2, -0.5)),
        (joint_vector(1, 1.0) - joint_vector(2, 1.0), np.zeros(7)),
    ):
        for plant in (braked, free):
            plant.reset(np.zeros(7), joint_velocity)
        mass = free.mass_matrix()
        for plant in (braked, free):
            plant.step(np.zeros(7), dt=1e-7)
        np.testing.assert_allclose(mass @ (braked.v - free.v) / 1e-7, brake, atol=1e-4)


def test_friction_of_the_elbows_motor_sticks_at_q2_plus_q3(truth: PlantFile) -> None:
    arm = truth.model.arm
    level = joint_vector(2, 0.05)
    rock = np.array([9.0, 0.0, 0.0, 9.0, 9.0, 9.0, 9.0])  # only shoulder and elbow move
    at_motor = weightless(
        truth,
        coulomb(
            arm, joint_positive=rock, joint_negative=rock, motor_positive=level,
            motor_negative=level,
        ),
    )  # fmt: skip
    for _ in range(300):
        at_motor.step(joint_vector(1, 0.04) - joint_vector(2, 0.04))  # no torque at motor 3
        assert abs(at_motor.q[1] + at_motor.q[2]) < 1e-15
    assert at_motor.q[1] > 0.02
    # The same friction at the joint holds the elbow itself, and the motor turns.
    levels = rock + 4 * level  # the shoulder's acceleration pulls at the elbow, too
    at_joint = weightless(truth, coulomb(arm, joint_positive=levels, joint_negative=levels))
    for _ in range(300):
        at_joint.step(joint_vector(1, 0.04) - joint_vector(2, 0.04))
    assert at_joint.q[1] > 0.02
    assert abs(at_joint.q[2]) < 1e-15
    # The motor stands within its level and turns beyond it.
    for effort, turns in ((0.049, False), (-0.049, False), (0.051, True), (-0.051, True)):
        at_motor.reset(np.zeros(7))
        for _ in range(100):
            at_motor.step(MOTORS[2] * effort)
        assert (abs(at_motor.v[1] + at_motor.v[2]) > 1e-6) == turns


def test_half_the_difference_of_directional_cables_is_friction(truth: PlantFile) -> None:
    plant = truth.plant()
    q = np.array([-0.2, 0.1, 0.1, 0.4, 1.2, 0.1, 0.0])
    plant.reset(q)
    weight = plant.smooth_torque()
    (cable,) = (term for term in truth.model.terms if term.NAME == "directional_cable")
    # Joint 4's two sets, evaluated here power by power.
    powers = q[3] ** np.arange(5)
    level = 0.5 * abs(powers @ cable.positive[:, 3] - powers @ cable.negative[:, 3])
    assert level > 0.02
    for factor, moves in ((0.98, False), (-0.98, False), (1.02, True), (-1.02, True)):
        plant.reset(q)
        for _ in range(100):
            plant.step(weight + joint_vector(3, factor * level))
        assert (plant.v[3] != 0.0) == moves
        assert plant.v[3] * factor >= 0


def test_friction_impulses_are_optimal() -> None:
    """Against bounded least squares: M v - p must lie in the set that friction can give."""
    rng = np.random.default_rng(0)
    rows = np.vstack([np.eye(7), MOTORS[2:4]])
    solver = FrictionSolver(rows)
    states = set()
    for _ in range(400):
        scale = 10 ** rng.uniform(-1.5, 0, 7)
        root = rng.normal(size=(7, 7))
        mass = (root @ root.T * 10 ** rng.uniform(-3, 0) + 0.01 * np.eye(7)) * np.outer(
            scale, scale
        )
        momentum = rng.normal(size=7) * scale * 0.01
        size = 0.01 * 10 ** rng.uniform(-2, 1)
        lower = -rng.uniform(0, size, 9) * (rng.random(9) < 0.8)
        upper = rng.uniform(0, size, 9) * (rng.random(9) < 0.8)
        velocity = solver.solve(mass, momentum, np.stack([lower, upper]))
        states.update(solver.states.tolist())
        speed = rows @ velocity
        least = np.where(speed < -1e-10, upper, lower) - 1e-15
        most = np.where(speed > 1e-10, lower, upper) + 1e-15
        norm = 1 / np.sqrt(np.diag(mass))
        fit = lsq_linear(
            norm[:, None] * rows.T, norm * (mass @ velocity - momentum), (least, most), "bvls"
        )
        assert np.sqrt(2 * fit.cost) < 1e-11
    assert states == {-1, 0, 1}


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_stops_hold_without_rebound(truth: PlantFile, side: float) -> None:
    arm = truth.model.arm
    stop = arm.upper if side > 0 else arm.lower
    damping = np.array([0.05, 0.05, 0.05, 0.005, 0.002, 0.002, 0.001])
    plant = weightless(truth, ViscousFriction(arm, damping, np.zeros(7)))
    plant.reset(stop - 0.01 * side, np.full(7, side))
    for _ in range(2000):
        plant.step(np.full(7, 0.02 * side))
        assert (side * plant.q <= side * stop).all()
    assert (plant.q == stop).all()
    assert not plant.v.any()
    plant.step(-side * truth.rotor_inertia)
    assert (side * plant.v < 0).any()  # a stop pushes, it does not hold back
