"""The simulated arm against MuJoCo, closed forms and optimality; its friction and manners."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from made_up_arm import made_up_arm
from robots import PANDA, ROBOTS, UR5
from scipy.optimize import lsq_linear

from dvrk_gravity.arms import Arm
from dvrk_gravity.effects import CoulombFriction, Gravity, State, ViscousFriction
from dvrk_gravity.errors import ConfigError, ShapeError
from dvrk_gravity.files.resources import config_path
from dvrk_gravity.gravity import LinkMass, beta_from_links
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.simulate import (
    FrictionSolver,
    Mode,
    Plant,
    PlantFile,
    Sensors,
    SimulatedArm,
    simulate,
)
from testing.mujoco_arms import dh_table

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


def random_links(seed: int) -> dict[str, pin.Inertia]:
    rng = np.random.default_rng(seed)
    links = {}
    for name in (*(f"link{i}" for i in range(1, 8)), "bar", "crank"):
        points = rng.normal(scale=0.05, size=(6, 3))  # point masses make a body that can exist
        mass = rng.uniform(0.05, 0.4)
        tensor = sum(mass / 6 * (p @ p * np.eye(3) - np.outer(p, p)) for p in points)
        links[name] = pin.Inertia(mass, rng.normal(scale=0.08, size=3), tensor)
    return links


def weight_of(arm: Arm, links: dict[str, pin.Inertia]) -> Gravity:
    """The gravity term of these links, from the closed form."""
    masses = {name: LinkMass(body.mass, tuple(body.lever)) for name, body in links.items()}
    return Gravity(arm, beta_from_links(masses, columns=14), np.array([0.0, 0.0, -9.81]))


class Oracle:
    """The same arm in MuJoCo, from the DH table and the links alone.

    The parallelogram is put together another way round than in the package: the crank hangs
    on link 1 and turns by q2 + q3, the bar hangs on the crank's tip and turns back by q3.
    """

    # Joint angles -> hinge angles, in the order in which MuJoCo meets them in the file.
    SPREAD = np.zeros((9, 7))
    SPREAD[0, 0] = 1.0
    SPREAD[1, 1:3] = 1.0  # crank
    SPREAD[2, 2] = -1.0  # bar
    SPREAD[range(3, 9), range(1, 7)] = 1.0

    def __init__(self, arm: Arm, links: dict[str, pin.Inertia]) -> None:
        degrees = np.degrees
        text = ""
        for i, joint in reversed(list(enumerate(dh_table("mtmr"), start=1))):
            # Rz(offset) Tz(d) Tx(a) Rx(alpha): a frame within a frame for each half.
            distal = (
                f'<body euler="0 0 {degrees(joint.offset)}">'
                f'<body pos="{joint.a} 0 {joint.d}" euler="{degrees(joint.alpha)} 0 0">'
                f"{self._inertial(links[f'link{i}'])}"
                f"{self._parallelogram(arm, links) if i == 1 else ''}{text}</body></body>"
            )
            text = f'<body name="j{i}"><joint name="q{i}" axis="0 0 1"/>{distal}</body>'
        self.model = mujoco.MjModel.from_xml_string(
            '<mujoco><compiler angle="degree" inertiafromgeom="false" boundmass="1e-12" '
            'boundinertia="1e-15"/><option gravity="0 0 -9.81"><flag energy="enable" '
            f'contact="disable"/></option><worldbody>{text}</worldbody></mujoco>'
        )
        self.data = mujoco.MjData(self.model)
        names = [self.model.joint(i).name for i in range(9)]
        assert names == ["q1", "crank", "bar", *(f"q{i}" for i in range(2, 8))]

    def _parallelogram(self, arm: Arm, links: dict[str, pin.Inertia]) -> str:
        side, table = 0.1, dh_table("mtmr")
        start = np.degrees(table[1].offset + table[2].offset)
        back = 180.0 - np.degrees(table[2].offset)
        return (
            f'<body name="crank" euler="0 0 {start}"><joint name="crank" axis="0 0 1"/>'
            f'<body pos="{side} 0 0" euler="0 0 90">{self._inertial(links["crank"])}</body>'
            f'<body name="bar" pos="{side} 0 0" euler="0 0 {back}"><joint name="bar" axis="0 0 1"/>'
            f"{self._inertial(links['bar'])}</body></body>"
        )

    @staticmethod
    def _inertial(body: pin.Inertia) -> str:
        i = body.inertia
        full = (i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2])
        pos = " ".join(f"{x:.17g}" for x in body.lever)
        tensor = " ".join(f"{x:.17g}" for x in full)
        return f'<inertial mass="{body.mass:.17g}" pos="{pos}" fullinertia="{tensor}"/>'

    def _move_to(self, q: np.ndarray, v: np.ndarray) -> None:
        self.data.qpos[:] = self.SPREAD @ q
        self.data.qvel[:] = self.SPREAD @ v
        mujoco.mj_forward(self.model, self.data)

    def acceleration(self, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> np.ndarray:
        self._move_to(q, v)
        mass = np.zeros((9, 9))
        mujoco.mj_fullM(self.model, self.data, mass)
        mass = self.SPREAD.T @ mass @ self.SPREAD + MOTORS.T @ np.diag(ROTORS) @ MOTORS
        return np.linalg.solve(mass, tau - self.SPREAD.T @ self.data.qfrc_bias)

    def energy(self, q: np.ndarray, v: np.ndarray) -> float:
        self._move_to(q, v)
        mujoco.mj_energyPos(self.model, self.data)
        mujoco.mj_energyVel(self.model, self.data)
        return float(self.data.energy.sum() + 0.5 * ROTORS @ (MOTORS @ v) ** 2)


# --- rigid-body motion -------------------------------------------------------------------


def test_accelerations_are_mujocos(wide_arm: Arm) -> None:
    rng = np.random.default_rng(1)
    for seed in range(5):
        links = random_links(seed)
        plant = Plant(TorqueModel(wide_arm, (weight_of(wide_arm, links),)), links, ROTORS)
        oracle = Oracle(wide_arm, links)
        for _ in range(20):
            q, v, tau = rng.uniform(-3, 3, 7), rng.normal(size=7), rng.normal(scale=0.5, size=7)
            plant.reset(q, v)
            plant.step(tau, dt=DT)
            expected = oracle.acceleration(q, v, tau)
            np.testing.assert_allclose(
                (plant.v - v) / DT, expected, rtol=1e-7, atol=1e-8 * np.abs(expected).max()
            )


def test_energy_is_kept_without_friction(wide_arm: Arm) -> None:
    links = random_links(11)
    oracle = Oracle(wide_arm, links)
    plant = Plant(TorqueModel(wide_arm, (weight_of(wide_arm, links),)), links, ROTORS)
    q, v = np.array([0.2, 0.4, -0.3, 1.0, 1.5, 0.3, -0.5]), np.full(7, 0.5)
    drift = {}
    for dt in (4e-4, 2e-4):
        plant.reset(q, v)
        energy = [oracle.energy(q, v)]
        swing = []
        for step in range(round(0.8 / dt)):
            plant.step(np.zeros(7), dt=dt)
            if step % 50 == 0:
                energy.append(oracle.energy(plant.q, plant.v))
                swing.append(oracle.energy(plant.q, np.zeros(7)))
        drift[dt] = np.abs(np.array(energy) - energy[0]).max()
        assert drift[dt] < 0.01 * np.ptp(swing)  # of what goes to and fro
    assert 1.6 < drift[4e-4] / drift[2e-4] < 2.5  # first order, as the method is


# --- friction ----------------------------------------------------------------------------


def frictionless_weight(truth: PlantFile, *terms: object) -> Plant:
    """The arm without weight, with just these terms."""
    return Plant(TorqueModel(truth.model.arm, tuple(terms)), truth.links, truth.rotor_inertia)


def coulomb(arm: Arm, **levels: np.ndarray) -> CoulombFriction:
    names = ("joint_positive", "joint_negative", "motor_positive", "motor_negative")
    full = {name: levels.get(name, np.zeros(7)) for name in names}
    return CoulombFriction(arm, **full, transition_velocity=np.full(7, 0.02))


def joint_vector(joint: int, value: float) -> np.ndarray:
    return np.eye(7)[joint] * value


@pytest.mark.parametrize("joint", range(7))
def test_within_its_level_friction_sticks_and_beyond_it_slides(
    truth: PlantFile, joint: int
) -> None:
    up, down = np.full(7, 0.02), np.full(7, 0.03)
    term = coulomb(truth.model.arm, joint_positive=up, joint_negative=down)
    plant = frictionless_weight(truth, term)
    start = np.array([0.1, 0.2, -0.1, 0.3, 1.0, 0.1, 0.5])
    for effort in (0.0199, -0.0299):
        plant.reset(start)
        for _ in range(200):
            plant.step(joint_vector(joint, effort))
            assert not plant.v.any()
        assert (plant.q == start).all()
    for effort in (0.0201, -0.0301):
        plant.reset(start)
        for _ in range(20):
            plant.step(joint_vector(joint, effort))
        assert plant.v[joint] * effort > 0


def test_sliding_stops_after_the_time_and_way_of_constant_friction(truth: PlantFile) -> None:
    levels = np.array([5.0, 5.0, 5.0, 5.0, 5.0, 5.0, 2e-4])  # the others stand like rock
    term = coulomb(truth.model.arm, joint_positive=levels, joint_negative=levels)
    plant = frictionless_weight(truth, term)
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


def test_terminal_velocity_and_reversal(truth: PlantFile) -> None:
    term = coulomb(
        truth.model.arm,
        joint_positive=joint_vector(6, 0.005),
        joint_negative=joint_vector(6, 0.002),
    )
    viscous = ViscousFriction(truth.model.arm, np.full(7, 0.01), np.zeros(7))
    plant = frictionless_weight(truth, term, viscous)
    # The other joints are held in place by what it takes: friction of a rock.
    rock = coulomb(
        truth.model.arm,
        joint_positive=np.r_[np.full(6, 9.0), 0.0],
        joint_negative=np.r_[np.full(6, 9.0), 0.0],
    )
    plant = frictionless_weight(truth, term, viscous, rock)
    for effort, expected in ((0.02, 1.5), (-0.02, -1.8), (0.02, 1.5)):
        for _ in range(500):
            plant.step(joint_vector(6, effort))
        assert plant.v[6] == pytest.approx(expected, abs=1e-9)


def test_viscous_friction_at_a_motor_brakes_all_that_turns_it(truth: PlantFile) -> None:
    viscous = ViscousFriction(truth.model.arm, np.zeros(7), joint_vector(2, 0.5))
    braked, free = frictionless_weight(truth, viscous), frictionless_weight(truth)
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
    at_motor = frictionless_weight(
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
    at_joint = frictionless_weight(
        truth, coulomb(arm, joint_positive=levels, joint_negative=levels)
    )
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
    plant = frictionless_weight(truth, ViscousFriction(arm, damping, np.zeros(7)))
    plant.reset(stop - 0.01 * side, np.full(7, side))
    for _ in range(2000):
        plant.step(np.full(7, 0.02 * side))
        assert (side * plant.q <= side * stop).all()
    assert (plant.q == stop).all()
    assert not plant.v.any()
    plant.step(-side * truth.rotor_inertia)
    assert (side * plant.v < 0).any()  # a stop pushes, it does not hold back


# --- holding -----------------------------------------------------------------------------


def drift(truth: PlantFile, model: TorqueModel, poses: np.ndarray, duration: float) -> np.ndarray:
    """Return (poses,) largest motion of a joint from where the compensated arm was put, deg."""
    found = []
    for seed, pose in enumerate(poses):
        plant = truth.plant(friction_scale=0.1)
        plant.reset(pose)
        mtm = SimulatedArm(plant, truth.sensors, seed, builtin_compensation=False)

        worst = np.zeros(7)

        def compensate(
            mtm: SimulatedArm, measured: object, pose: np.ndarray = pose, worst: np.ndarray = worst
        ) -> None:
            if round(mtm.plant.time / DT) % 5 == 0:
                mtm.servo_jf(model.torque(measured.position))
                np.maximum(worst, np.abs(mtm.plant.q - pose), out=worst)

        mtm.servo_jf(model.torque(pose))
        simulate(mtm, compensate, duration, rate=200.0)
        assert plant.time == pytest.approx(duration)
        found.append(worst.max())
    return np.degrees(found)


def random_poses(truth: PlantFile, count: int) -> np.ndarray:
    arm = truth.model.arm
    share = np.random.default_rng(4).uniform(0.05, 0.95, (count, 7))
    return arm.lower + share * (arm.upper - arm.lower)


@pytest.mark.parametrize(
    ("count", "duration"),
    # For as long as it takes to fall without it, at many poses, and longer at some.
    [(6, 2.5), pytest.param(20, 10.0, marks=pytest.mark.slow)],
)
def test_the_true_torque_holds_with_a_tenth_of_the_friction(
    truth: PlantFile, count: int, duration: float
) -> None:
    moved = drift(truth, truth.model, random_poses(truth, count), duration)
    assert moved.max() < 0.5


@pytest.mark.parametrize("factor", [0.0, 0.95])
def test_without_the_true_torque_it_falls(truth: PlantFile, factor: float) -> None:
    terms = tuple(
        replace(term, beta=factor * term.beta) if isinstance(term, Gravity) else term
        for term in truth.model.terms
    )
    moved = drift(truth, TorqueModel(truth.model.arm, terms), random_poses(truth, 5), duration=2.5)
    assert (moved > 2.0).all()


# --- the console -------------------------------------------------------------------------

POSE = np.array([0.0, 0.2, 0.1, 0.0, 1.5, 0.0, 0.0])


def arm_at(truth: PlantFile, pose: np.ndarray = POSE, **options: object) -> SimulatedArm:
    plant = truth.plant()
    plant.reset(pose)
    return SimulatedArm(plant, **options)


def steps(mtm: SimulatedArm, count: int) -> SimulatedArm:
    for _ in range(count):
        mtm.step()
    return mtm


def test_starts_in_hold_and_holds(truth: PlantFile) -> None:
    mtm = steps(arm_at(truth), 500)
    assert mtm.mode is Mode.HOLD
    assert (mtm.plant.q == POSE).all()


def test_the_last_effort_stays_for_ever(truth: PlantFile) -> None:
    mtm = arm_at(truth, builtin_compensation=False)
    effort = mtm.plant.smooth_torque() + joint_vector(0, 0.001)
    mtm.servo_jf(effort)
    for _ in range(20):
        steps(mtm, 1000)
        np.testing.assert_allclose(mtm.effort, effort, atol=1e-15)


@pytest.mark.parametrize("bad", [np.zeros(6), np.zeros(8), np.zeros(0), np.full(7, np.nan)])
def test_a_command_that_cannot_be_is_refused_and_changes_nothing(
    truth: PlantFile, bad: np.ndarray
) -> None:
    mtm = arm_at(truth)
    for command in (mtm.servo_jf, mtm.servo_jp, mtm.move_jp):
        with pytest.raises((ShapeError, ConfigError)):
            command(bad)
    assert mtm.mode is Mode.HOLD
    assert (steps(mtm, 10).plant.q == POSE).all()


def test_the_builtin_compensation_adds_to_commands(truth: PlantFile) -> None:
    mtm = arm_at(truth)
    weight = mtm.plant.smooth_torque()
    mtm.servo_jf(weight)
    mtm.step()
    np.testing.assert_allclose(mtm.compensation, weight)
    np.testing.assert_allclose(mtm.commanded, 2 * weight)
    mtm.plant.reset(POSE)
    mtm.use_gravity_compensation(False)
    mtm.step()
    assert not mtm.compensation.any()
    np.testing.assert_allclose(mtm.commanded, weight)


def test_free_floats_with_compensation_and_falls_without(truth: PlantFile) -> None:
    for builtin, falls in ((True, False), (False, True)):
        mtm = arm_at(truth, builtin_compensation=builtin)
        mtm.free()
        steps(mtm, 1000)
        assert (np.abs(mtm.plant.q - POSE).max() > 0.2) == falls


def test_hold_catches_a_falling_arm(truth: PlantFile) -> None:
    mtm = arm_at(truth, builtin_compensation=False)
    mtm.free()
    caught = steps(mtm, 150).plant.q
    assert np.abs(mtm.plant.v).max() > 0.3
    mtm.hold()
    steps(mtm, 1000)
    assert np.abs(mtm.plant.v).max() < 1e-9
    assert np.abs(mtm.plant.q - caught).max() < 0.05


def test_hold_keeps_the_set_point_of_an_arm_that_does_not_follow(truth: PlantFile) -> None:
    """As a console's: what is in its way is pressed on until another position is commanded."""
    mtm = arm_at(truth)
    mtm.servo_jp(POSE + joint_vector(0, 0.2))
    mtm.push(joint_vector(0, -1.5), duration=60.0)
    steps(mtm, 1000)
    pressed = mtm.effort[0]
    assert pressed > 1.0
    mtm.hold()
    steps(mtm, 1000)
    assert mtm.effort[0] == pytest.approx(pressed, rel=1e-3)
    mtm.servo_jp(mtm.measure().position)
    mtm.hold()


def test_motors_saturate(truth: PlantFile) -> None:
    mtm = arm_at(truth)
    mtm.servo_jf(np.full(7, 50.0))
    mtm.step()
    limit = truth.model.arm.actuator_effort_limit
    # Motor torques, written out: the transposed inverse of the motor angles' matrix.
    np.testing.assert_allclose(np.linalg.inv(MOTORS).T @ mtm.effort, limit)


def test_moves_smoothly_to_a_goal(truth: PlantFile) -> None:
    mtm = arm_at(truth)
    goal = np.array([0.2, 0.3, -0.2, 1.0, 0.5, 0.3, -1.0])
    mtm.move_jp(goal)
    speed = []
    for _ in range(3000):
        mtm.step()
        speed.append(np.abs(mtm.plant.v))
    assert (np.max(speed, axis=0) < [0.9, 0.9, 0.9, 1.7, 2.3, 2.3, 4.5]).all()
    np.testing.assert_allclose(mtm.plant.q, goal, atol=0.03)
    assert np.abs(mtm.plant.v).max() < 1e-6
    mtm.servo_jp(goal + 100.0)
    np.testing.assert_array_equal(mtm.target, truth.model.arm.upper)


def test_a_push_moves_the_arm_for_its_time_and_no_sensor_sees_it(truth: PlantFile) -> None:
    mtm = arm_at(truth)
    mtm.free()
    mtm.push(joint_vector(0, 0.5), duration=0.1)
    steps(mtm, 100)
    speed = mtm.plant.v[0]
    assert speed > 0.5
    assert abs(mtm.measure().effort[0] - mtm.compensation[0]) < 1e-12
    steps(mtm, 20)
    assert mtm.plant.v[0] < speed


def test_an_arm_that_is_pushed_beyond_all_that_can_be_computed_holds_where_it_was(
    truth: PlantFile,
) -> None:
    mtm = arm_at(truth)
    mtm.free()
    mtm.push(joint_vector(0, 1e300), duration=1.0)
    went = [mtm.step() for _ in range(100)]
    assert not all(went)
    assert mtm.mode is Mode.HOLD
    assert np.isfinite(np.stack([mtm.plant.q, mtm.plant.v, mtm.measure().effort])).all()
    rested = steps(mtm, 10).plant.q.copy()
    np.testing.assert_array_equal(steps(mtm, 10).plant.q, rested)


def test_an_arm_with_drive_gains_takes_efforts_in_amperes(tmp_path: Path) -> None:
    gains = np.array([2.0, 4.0, 5.0, 10.0])
    arm = made_up_arm(tmp_path).with_drive_gains(gains)
    simulated = SimulatedArm(PlantFile.of(arm).plant(), builtin_compensation=False)
    weight = simulated.plant.smooth_torque()
    for command, as_read in ((weight, False), (weight / gains, True)):
        simulated.servo_jf(command, as_read=as_read)
        simulated.step()
        np.testing.assert_allclose(simulated.effort, weight, rtol=1e-6)


# --- sensors and recordings --------------------------------------------------------------


def noisy_run(truth: PlantFile, seed: int) -> object:
    mtm = arm_at(truth, sensors=truth.sensors, seed=seed)
    mtm.move_jp(np.array([0.2, 0.3, 0.2, 0.5, 1.0, 0.1, 1.0]))
    return simulate(mtm, None, duration=0.5, rate=200.0)


def test_a_seed_gives_one_run_and_another_seed_another(truth: PlantFile) -> None:
    first, again, other = (noisy_run(truth, seed) for seed in (5, 5, 6))
    for name in ("position", "velocity", "effort"):
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))
    assert (first.velocity != other.velocity).any()
    assert (first.effort != other.effort).any()


def test_sensors_count_in_steps_at_the_motors(truth: PlantFile) -> None:
    recording = noisy_run(truth, 5)
    assert len(recording) == 100
    assert recording.rate == pytest.approx(200.0)
    for values, step in (
        (recording.position @ MOTORS.T, truth.sensors.position_step),
        (recording.effort @ np.linalg.inv(MOTORS), truth.sensors.effort_step),
    ):
        counts = values / step
        assert np.abs(counts - np.rint(counts)).max() < 1e-6
        assert np.ptp(counts, axis=0).min() > 3


def test_noise_has_its_size_and_perfect_sensors_tell_the_truth(truth: PlantFile) -> None:
    noise = np.linspace(0.01, 0.07, 7)
    mtm = arm_at(truth, sensors=Sensors(velocity_noise=noise), seed=1)
    velocity = simulate(mtm, None, 2.0).velocity @ MOTORS.T
    np.testing.assert_allclose(velocity.std(axis=0), noise, rtol=0.1)
    mtm = arm_at(truth)
    mtm.move_jp(np.zeros(7))
    steps(mtm, 100)
    before = mtm.plant.q, mtm.plant.v
    steps(mtm, 1)
    measured = mtm.measure()
    np.testing.assert_allclose(measured.position, before[0], atol=1e-15)
    np.testing.assert_allclose(measured.velocity, 0.5 * (before[1] + mtm.plant.v), atol=1e-15)
    np.testing.assert_allclose(measured.effort, mtm.effort, atol=1e-15)


def test_efforts_can_come_late(truth: PlantFile) -> None:
    runs = []
    for delay in (0.0, 0.02):
        mtm = arm_at(truth, sensors=Sensors(effort_delay=delay))
        mtm.move_jp(np.zeros(7))
        runs.append(simulate(mtm, None, 0.3))
    np.testing.assert_array_equal(runs[0].position, runs[1].position)
    np.testing.assert_array_equal(runs[0].effort[:-20], runs[1].effort[20:])
    assert (runs[0].effort[20:] != runs[1].effort[20:]).any()


def test_perfect_sensors_tell_no_delay_between_motion_and_effort(truth: PlantFile) -> None:
    """MuJoCo's accelerations at what is read: an arm without friction shows no viscosity."""
    plant = Plant(
        TorqueModel(truth.model.arm, (weight_of(truth.model.arm, dict(truth.links)),)),
        truth.links,
        ROTORS,
    )
    plant.reset(POSE)
    mtm = SimulatedArm(plant)

    def swing(mtm: SimulatedArm, measured: object) -> None:
        t = measured.time
        mtm.follow(POSE + 0.2 * np.sin(5 * t), np.full(7, np.cos(5 * t)))

    recording = simulate(mtm, swing, 2.0)
    oracle = Oracle(truth.model.arm, dict(truth.links))
    acceleration = np.gradient(recording.velocity, DT, axis=0)
    off = []
    for row in range(500, 1990, 10):
        q, v, tau = (getattr(recording, name)[row] for name in ("position", "velocity", "effort"))
        off.append(oracle.acceleration(q, v, tau) - acceleration[row])
    # Read half a step later they are off by 0.02, with Coriolis torques of the step before 0.005.
    assert np.abs(off).max() < 1e-4 * np.abs(acceleration[500:]).max()


@pytest.mark.parametrize(("rate", "duration"), [(300.0, 1.0), (0.0, 1.0), (2000.0, 1.0), (100, 0)])
def test_a_run_that_cannot_be_is_refused(truth: PlantFile, rate: float, duration: float) -> None:
    with pytest.raises(ConfigError):
        simulate(arm_at(truth), None, duration, rate)


# --- plant files -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("rotor_inertia: [0.0043", "rotor_inertia: [-0.0043", "rotor_inertia[0]"),
        ("mass: 0.65,", "mass: heavy,", "links.link2.mass"),
        ("link3:", "link8:", "links.link8"),
        ("inertia: [0.0008, 0.012,", "inertia: [0.1, 0.012,", "links.link2.inertia"),
        ("effort_delay: 0.0", "effort_lag: 0.0", "sensors.effort_lag"),
        ("links:", "bodies:", "bodies"),
        ("  arm: mtmr", "  arm: mtmx", "mtmx"),
        ("coulomb_friction:", "colomb_friction:", "coulomb_friction"),
    ],
)
def test_a_wrong_plant_file_is_told_in_one_line(
    tmp_path: object, old: str, new: str, says: str
) -> None:
    text = config_path("plants/mtmr_28002.yaml").read_text()
    assert old in text
    path = tmp_path / "plant.yaml"
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(ConfigError) as error:
        PlantFile.load(path)
    assert says in str(error.value)
    assert "plant.yaml" in str(error.value)
    assert "\n" not in str(error.value)


def test_the_plants_weight_and_cables_are_those_of_the_identified_model(truth: PlantFile) -> None:
    model = TorqueModel.load(config_path("mtmr_28002.yaml"))
    poses = random_poses(truth, 50)
    np.testing.assert_allclose(truth.model.torque(poses), model.torque(poses), atol=1e-12)
    plant = truth.plant()
    for pose in poses:
        plant.reset(pose)
        np.testing.assert_allclose(plant.smooth_torque(), model.torque(pose), atol=1e-12)


def test_an_unknown_plant_and_an_impossible_start_are_refused(truth: PlantFile) -> None:
    with pytest.raises(ConfigError, match="mtmr_28002"):
        PlantFile.load("nothing")
    with pytest.raises(ConfigError, match="shoulder_pitch"):
        truth.plant().reset(np.array([0, 3.0, 0, 0, 0, 0, 0]))


@pytest.mark.parametrize("robot", ["xarm7", "ur5", "panda"])
def test_an_arm_rubs_alike_by_its_urdf_and_by_the_model_that_it_is_converted_to(robot, tmp_path):
    """As its file states where it does (xArm: both, Panda: damping), or as is usual (UR5)."""
    files = {
        "xarm7": ROBOTS / "xarm_description/urdf/xarm7.urdf",
        "ur5": UR5,
        "panda": f"{PANDA}#panda_link8",
    }
    TorqueModel.load(files[robot]).save(tmp_path / "model.yaml")
    plants = [PlantFile.load(files[robot]), PlantFile.load(tmp_path / "model.yaml")]
    arm = plants[0].model.arm

    by_urdf, by_model = (
        sum(
            term.torque(State(np.zeros(arm.n), np.full(arm.n, 0.5)))
            for term in plant.model.terms
            if term.FRICTION
        )
        for plant in plants
    )

    np.testing.assert_allclose(by_urdf, by_model)
    assert (by_urdf > 0.0).all()
    if robot == "xarm7":
        stated = [0.5 * joint.damping + joint.friction for joint in arm.joints]
        np.testing.assert_allclose(by_urdf, stated)
