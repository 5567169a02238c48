"""What a plant makes of effects: of the package's, and of any, from their torque alone."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import pinocchio as pin
import pytest
from outside_term import OutsideTerm
from scipy.optimize import brentq

from dvrk_gravity.arms import Arm, build_tree
from dvrk_gravity.effects import (
    SLOWEST,
    CoulombFriction,
    PlantPart,
    PreslidingHysteresis,
    State,
    StribeckFriction,
    Term,
    ViscousFriction,
    secant_damping,
)
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.simulate import Plant, PlantFile, SimulatedArm

ARM = Arm.load("mtmr")
TRUTH = PlantFile.load("mtmr_28002")
N = len(ARM.joints)
ZERO = np.zeros(N)
ROLL = N - 1
POSE = np.array([0.1, 0.2, -0.1, 0.3, 1.0, 0.1, 0.5])
OFFSET = np.radians([1.0, -2.0, 3.0, -4.0, 5.0, -6.0, 7.0])
PAYLOAD = {
    "payload.mass": 0.05,
    "payload.first_moment": [0.001, -0.0005, 0.002],
    "payload.link": "link6",
}
PRESLIDING = {
    "presliding_hysteresis.displacement": [0.02, 0.0005],
    "presliding_hysteresis.joint.wrist_roll": [0.002, 0.001],
    "presliding_hysteresis.motor.elbow_pitch": [0.03, 0.02],
}


class Outside(OutsideTerm):
    """An effect of somebody else's: a torque, and what every term has to have."""

    NAME = "outside"

    def __init__(self, torque: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> None:
        self._of = torque

    def torque(self, state: State) -> np.ndarray:
        return self._of(state.q, np.zeros_like(state.q) if state.qd is None else state.qd)


class OutsideFriction(Outside):
    FRICTION = True


class OutsideReading(Outside):
    def plant(self) -> PlantPart:
        return PlantPart(reading=self._of)


def moving(*terms: Term, friction_scale: float = 1.0) -> Plant:
    """A plant without weight."""
    return Plant(TorqueModel(ARM, terms), TRUTH.links, TRUTH.rotor_inertia, friction_scale)


def joint_vector(joint: int, value: float) -> np.ndarray:
    return np.eye(N)[joint] * value


def inertia(joint: int) -> float:
    return float(moving().mass_matrix()[joint, joint])


def drag(coefficient: float, joint: int, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
    return joint_vector(joint, coefficient) * np.abs(qd) * qd


def damper(coefficient: float, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
    """Between shoulder and elbow: what one loses the other gets."""
    return coefficient * (qd[1] - qd[2]) * np.array([0.0, 1.0, -1.0, 0.0, 0.0, 0.0, 0.0])


def energy(plant: Plant) -> float:
    return float(0.5 * plant.v @ plant.mass_matrix() @ plant.v)


def test_a_drag_that_is_known_by_its_torque_alone_gives_the_speed_that_balances_it():
    scale, coefficient, effort = 0.25, 1e-3, 4e-3
    plant = moving(OutsideFriction(partial(drag, coefficient, ROLL)), friction_scale=scale)
    for _ in range(2500):
        plant.step(joint_vector(ROLL, effort))
        plant.q = ZERO  # it may turn for ever
    assert plant.v[ROLL] == pytest.approx(np.sqrt(effort / (scale * coefficient)), rel=1e-6)


def test_a_friction_far_beyond_what_an_explicit_step_bears_takes_energy_from_every_step():
    """h df/dv is ten thousand times the inertia: explicit steps would grow ten-thousandfold."""
    strong = 1e4 * inertia(1) / 1e-3
    for friction in (partial(damper, strong), partial(drag, strong, 1)):
        plant = moving(OutsideFriction(friction))
        plant.reset(POSE, np.array([0.1, 1.0, -0.5, 0.3, 0.2, -0.1, 0.4]))
        # Gyroscopic torques are explicit: they may give back a little of what is lost.
        last = energy(plant)
        for _ in range(1000):
            plant.step(ZERO)
            now = energy(plant)
            assert now < 1.001 * last
            last = now


def test_a_friction_that_couples_joints_moves_them_as_a_damping_matrix_does():
    class Exact(OutsideFriction):
        def plant(self) -> PlantPart:
            coupled = 0.05 * np.array([[1.0, -1.0], [-1.0, 1.0]])
            damping = np.zeros((N, N))
            damping[1:3, 1:3] = coupled
            return PlantPart(damping=damping)

    friction = partial(damper, 0.05)
    ways = []
    for term in (OutsideFriction(friction), Exact(friction)):
        plant = moving(term)
        plant.reset(POSE, joint_vector(1, 1.0))
        way = []
        for step in range(400):
            plant.step(0.02 * np.sin(0.02 * step) * joint_vector(2, 1.0))
            way.append(plant.q.copy())
        ways.append(np.array(way))
    assert np.abs(ways[1] - POSE).max() > 0.05
    assert np.abs(ways[0] - ways[1]).max() < 2e-4


def test_a_ramp_of_friction_creeps_under_an_effort_below_its_level_and_gives_way_above():
    level, width = 0.002, 0.02

    class Ramp(CoulombFriction):
        plant = Term.plant  # as if it had no levels to give

    term = Ramp(
        ARM,
        joint_vector(ROLL, level),
        joint_vector(ROLL, level),
        ZERO,
        ZERO,
        np.full(N, width),
        ZERO,
        ZERO,
    )
    plant = moving(term)
    for _ in range(4000):
        plant.step(joint_vector(ROLL, 0.5 * level))
    assert plant.v[ROLL] == pytest.approx(0.5 * width, rel=1e-6)
    begin = plant.time
    for _ in range(200):
        plant.step(joint_vector(ROLL, 1.5 * level))
    accelerating = 0.5 * level * (plant.time - begin) / inertia(ROLL)
    assert plant.v[ROLL] == pytest.approx(accelerating, rel=0.1)


def test_a_friction_that_jumps_with_the_sign_sticks_as_a_creep_that_nobody_sees():
    plant = moving(OutsideFriction(lambda q, qd: joint_vector(ROLL, 0.002) * np.sign(qd)))
    plant.reset(ZERO, joint_vector(ROLL, 0.5))
    for _ in range(2000):
        plant.step(joint_vector(ROLL, 0.0015))
    assert abs(plant.v[ROLL]) < 2 * SLOWEST


def test_a_friction_that_gives_energy_is_taken_as_it_is():
    rest, damping = secant_damping(lambda q, v: -v)(ZERO, POSE)
    np.testing.assert_array_equal(rest, -POSE)
    assert not damping.any()


def test_what_is_in_the_effort_sensor_is_read_and_not_felt():
    plain, off = (
        SimulatedArm(moving(*terms))
        for terms in ((), (OutsideReading(lambda q, qd: 0.1 * q + 0.02 * qd),))
    )
    for arm in (plain, off):
        arm.plant.reset(POSE)
        arm.servo_jf(joint_vector(ROLL, 0.001))
        for _ in range(50):
            arm.step()
    np.testing.assert_array_equal(plain.plant.q, off.plant.q)
    read = off.measure()
    misread = 0.1 * read.position + 0.02 * read.velocity
    np.testing.assert_allclose(read.effort - plain.measure().effort, misread, atol=1e-15)


@pytest.mark.parametrize("site", ["joint", "motor"])
def test_the_plant_breaks_away_at_the_level_and_runs_where_the_sum_of_friction_is_the_effort(site):
    level, coulomb, viscous, velocity = 0.004, 0.003, 0.001, 0.8
    rock = np.r_[np.full(6, 9.0), 0.0]
    levels = {"joint": ZERO, "motor": ZERO} | {site: joint_vector(6, level)}
    plant = moving(
        CoulombFriction(
            ARM,
            rock + joint_vector(6, coulomb),
            rock + joint_vector(6, coulomb),
            ZERO,
            ZERO,
            ZERO,
            ZERO,
            ZERO,
        ),
        ViscousFriction(ARM, joint_vector(6, viscous), ZERO),
        StribeckFriction(
            ARM,
            *(levels[kind] for kind in ("joint", "motor")),
            joint_vector(6, velocity),
            joint_vector(6, velocity),
            ZERO,
            ZERO,
            ZERO,
        ),
    )
    for sign in (1.0, -1.0):
        plant.reset(ZERO)
        for _ in range(50):
            plant.step(joint_vector(6, 0.0069 * sign))
        assert not plant.v.any()
        for _ in range(4000):
            plant.step(joint_vector(6, 0.0071 * sign))
            plant.q[6] = 0.0  # it may turn for ever
        # Beyond the hump of level exp(-(v / velocity)^2), viscous friction balances the effort.
        speed = brentq(
            lambda v: coulomb + viscous * v + level * np.exp(-((v / velocity) ** 2)) - 0.0071, 2, 9
        )
        assert plant.v[6] * sign == pytest.approx(speed, rel=1e-4)


def test_a_simulated_arm_reads_its_offsets_and_is_not_pushed_by_them():
    bias = np.array([0.01, -0.02, 0.03, 0.004, 0.005, 0.006, 0.007])
    values = TRUTH.model.parameters()
    model = TorqueModel.from_parameters(
        values | {"joint_offset": OFFSET.tolist(), "torque_offset": bias.tolist()}
    )
    arms = [SimulatedArm(Plant(m, TRUTH.links, TRUTH.rotor_inertia)) for m in (TRUTH.model, model)]
    for arm in arms:
        arm.plant.reset(POSE)
        arm.hold()
    np.testing.assert_allclose(arms[1].target, POSE + OFFSET)
    for _ in range(300):
        for arm in arms:
            arm.step()
    plain, off = (arm.measure() for arm in arms)
    np.testing.assert_allclose(off.position - plain.position, OFFSET, atol=1e-9)
    np.testing.assert_allclose(off.effort - plain.effort, bias, atol=1e-9)
    arms[0].move_jp(POSE + 0.1)
    arms[1].move_jp(POSE + 0.1 + OFFSET)
    for _ in range(2000):
        for arm in arms:
            arm.step()
    np.testing.assert_allclose(arms[1].plant.q, arms[0].plant.q, atol=1e-9)


def test_the_plant_carries_a_payload_as_it_would_a_heavier_link():
    loaded = Plant(
        TorqueModel.from_parameters(TRUTH.model.parameters() | PAYLOAD),
        TRUTH.links,
        TRUTH.rotor_inertia,
    )
    body = pin.Inertia(0.05, np.array([0.02, -0.01, 0.04]), np.zeros((3, 3)))
    heavier = Plant(
        TRUTH.model, {**TRUTH.links, "link6": TRUTH.links["link6"] + body}, TRUTH.rotor_inertia
    )
    for plant in (loaded, heavier):
        plant.reset(POSE)
    np.testing.assert_allclose(loaded.mass_matrix(), heavier.mass_matrix(), atol=1e-15)
    weight = build_tree(ARM, {"link6": body}, ARM.gravity).gravity(POSE)
    np.testing.assert_allclose(loaded.smooth_torque() - heavier.smooth_torque(), weight, atol=1e-12)


def test_the_plant_holds_a_push_by_presliding_and_yields_as_the_spring_that_it_is():
    level, displacement, effort = 0.003, 0.02, 0.001
    term = PreslidingHysteresis(
        ARM, np.array([displacement]), joint_vector(6, level)[None], np.zeros((1, 7))
    )
    rock = np.r_[np.full(6, 9.0), 0.0]
    plant = moving(
        CoulombFriction(ARM, rock, rock, ZERO, ZERO, ZERO, ZERO, ZERO),
        ViscousFriction(ARM, joint_vector(6, 0.01), ZERO),  # the way goes one way
        term,
    )
    for _ in range(3000):
        plant.step(joint_vector(6, effort))
    # Dahl from rest: F = level (1 - exp(-x / displacement)).
    expected = -displacement * np.log(1.0 - effort / level)
    assert plant.q[6] == pytest.approx(expected, rel=2e-3)
    for _ in range(3000):
        plant.step(joint_vector(6, 1.5 * level))
    assert plant.v[6] == pytest.approx(0.5 * level / 0.01, rel=1e-3)


def test_the_plant_s_presliding_is_the_term_s_along_the_same_way():
    term = TorqueModel.from_parameters(PRESLIDING).term("presliding_hysteresis")
    assert isinstance(term, PreslidingHysteresis)
    time = np.arange(3000) * 1e-3
    q = 0.2 * np.sin(np.outer(time, np.linspace(5.0, 9.0, 7)))
    state = State(q, np.gradient(q, 1e-3, axis=0))
    expected = term.torque(state)
    plant_s = term.plant().memory
    assert plant_s is not None
    torque = [plant_s.torque(ZERO)[0]]
    for way in np.diff(q, axis=0):
        plant_s.go(way)
        torque.append(plant_s.torque(ZERO)[0])
    # One starts relaxed, the other sliding: forgotten after the first half second.
    np.testing.assert_allclose(np.array(torque)[500:], expected[500:], atol=1e-9)


def test_presliding_shorter_than_the_way_of_a_step_is_calm():
    values = {
        "presliding_hysteresis.displacement": [1e-4],
        "presliding_hysteresis.joint.wrist_roll": [0.05],
        "presliding_hysteresis.joint.shoulder_pitch": [2.0],
    }
    plant = moving(*TorqueModel.from_parameters(values).terms)
    plant.reset(POSE, np.full(N, 0.5))
    for _ in range(500):
        plant.step(ZERO)
    assert np.abs(plant.v[[1, ROLL]]).max() < 1e-2
    assert np.isfinite(plant.q).all()
