"""What a plant makes of effects that it has never heard of, from their torque alone."""

from __future__ import annotations

import ast
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from support import REPOSITORY

from dvrk_gravity.arms import Arm
from dvrk_gravity.effects import SLOWEST, CoulombFriction, PlantPart, State, Term, secant_damping
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.simulate import Plant, PlantFile, SimulatedArm

ARM = Arm.load("mtmr")
TRUTH = PlantFile.load("mtmr_28002")
N = len(ARM.joints)
ZERO = np.zeros(N)
ROLL = N - 1
POSE = np.array([0.1, 0.2, -0.1, 0.3, 1.0, 0.1, 0.5])


class Outside(Term):
    """An effect of somebody else's: a torque, and what every term has to have."""

    NAME = "outside"

    def __init__(self, torque: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> None:
        self._of = torque

    @classmethod
    def schema(cls, arm):
        return ()

    @classmethod
    def from_parameters(cls, arm, values):
        return None

    def parameters(self):
        return {}

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


@pytest.mark.parametrize("scale", [1.0, 0.25])
def test_a_drag_that_is_known_by_its_torque_alone_gives_the_speed_that_balances_it(scale):
    coefficient, effort = 1e-3, 4e-3
    plant = moving(OutsideFriction(partial(drag, coefficient, ROLL)), friction_scale=scale)
    for _ in range(2500):
        plant.step(joint_vector(ROLL, effort))
        plant.q = ZERO  # it may turn for ever
    assert plant.v[ROLL] == pytest.approx(np.sqrt(effort / (scale * coefficient)), rel=1e-6)


def test_a_drag_slows_down_as_its_formula_says():
    coefficient, fast = 1e-3, 2.0
    plant = moving(OutsideFriction(partial(drag, coefficient, ROLL)))
    plant.reset(ZERO, joint_vector(ROLL, fast))
    for _ in range(500):
        plant.step(ZERO)
    mass = inertia(ROLL)
    expected = fast / (1.0 + coefficient * fast * plant.time / mass)
    assert plant.v[ROLL] == pytest.approx(expected, rel=2e-3)


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
        ARM, joint_vector(ROLL, level), joint_vector(ROLL, level), ZERO, ZERO, np.full(N, width)
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


def test_secant_damping_is_the_friction_and_has_no_negative_eigenvalue():
    random = np.random.default_rng(0)
    root = random.normal(size=(N, N))
    matrix = root @ root.T  # couples all joints, and dissipates
    for friction in (lambda q, v: matrix @ v, lambda q, v: np.abs(v) * v):
        for v in random.normal(size=(50, N)):
            rest, damping = secant_damping(friction)(ZERO, v)
            whole = rest + damping @ v
            np.testing.assert_allclose(whole, friction(ZERO, v), 1e-9, 2 * SLOWEST**2)
            np.testing.assert_array_equal(damping, damping.T)
            assert np.linalg.eigvalsh(damping).min() > -1e-12 * np.abs(damping).max()


def test_a_friction_that_gives_energy_is_taken_as_it_is():
    rest, damping = secant_damping(lambda q, v: -v)(ZERO, POSE)
    np.testing.assert_array_equal(rest, -POSE)
    assert not damping.any()


def test_a_belt_s_spring_is_a_torque_that_the_plant_has_to_bear():
    plant = moving(
        Outside(
            lambda q, qd: 0.3 * np.sin(q[0] - q[1]) * (joint_vector(0, 1.0) - joint_vector(1, 1.0))
        )
    )
    plant.reset(POSE)
    expected = 0.3 * np.sin(POSE[0] - POSE[1])
    np.testing.assert_allclose(
        plant.smooth_torque(), joint_vector(0, expected) - joint_vector(1, expected)
    )
    plant.step(plant.smooth_torque())
    assert not np.abs(plant.v).max() > 1e-12


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


def test_two_plants_of_one_model_do_not_share_friction_s_memory():
    model = TorqueModel.from_parameters(
        {
            "presliding_hysteresis.displacement": [0.02],
            "presliding_hysteresis.joint.wrist_roll": [0.002],
        }
    )
    first, second = (Plant(model, TRUTH.links, TRUTH.rotor_inertia) for _ in range(2))
    for _ in range(100):
        first.step(joint_vector(ROLL, 0.001))
    second.step(joint_vector(ROLL, 0.001))
    alone = Plant(model, TRUTH.links, TRUTH.rotor_inertia)
    alone.step(joint_vector(ROLL, 0.001))
    np.testing.assert_array_equal(second.v, alone.v)


def effects_imported_by(path: Path) -> set[str]:
    return {
        alias.name
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.ImportFrom)
        and (node.module or "").startswith("dvrk_gravity.effects")
        for alias in node.names
    }


def test_the_simulator_names_no_effect():
    """But for inertia: a model's prediction of it becomes the bodies that the plant moves."""
    paths = (REPOSITORY / "dvrk_gravity" / "simulate").glob("*.py")
    known = {path.name: effects_imported_by(path) for path in paths}
    bodies = known.pop("model_plant.py")
    assert bodies == {"LinkInertia", "RotorInertia", "State", "prior_scale", "assumed_rotors"}
    assert set().union(*known.values()) == {
        "PlantPart",
        "assumed_inertias",
        "assumed_rotors",
        "terms",
    }


def test_what_hides_effects_has_its_physics_from_none_of_them():
    """Only a world's model, which a diagnosis is given, consists of them."""
    paths = (REPOSITORY / "testing").glob("*.py")
    known = {path.name: effects_imported_by(path) for path in paths}
    assert {"CoulombFriction", "LinkInertia"} < known.pop("world.py")
    assert {"hide.py", "physics.py"} < set(known)
    assert set().union(*known.values()) == {"PlantPart"}
