"""Terms that identification solves for: linear in their coefficients, and right."""

from __future__ import annotations

import numpy as np
import pytest

from dvrk_gravity.arms import BODIES as TREE_LINKS
from dvrk_gravity.arms import Arm, build_tree, link_frames, rigid_body
from dvrk_gravity.compensate import Settings
from dvrk_gravity.effects import (
    CoulombFriction,
    ElasticCable,
    Gravity,
    LinkInertia,
    PreslidingHysteresis,
    Range,
    RotorInertia,
    State,
    StribeckFriction,
    TorqueOffset,
    ViscousFriction,
)
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.gravity import regressor as gravity_regressor
from dvrk_gravity.model import TorqueModel

ARM = Arm.load("mtmr")
ZERO = np.zeros(7)
ELEMENTS = np.zeros((2, 7))
TERMS = [
    Gravity(ARM, np.zeros(12), ARM.gravity),
    ElasticCable(ARM, np.zeros((4, 7)), Range(np.full(7, -0.5), np.full(7, 0.5))),
    CoulombFriction(ARM, ZERO, ZERO, ZERO, ZERO, np.full(7, 0.05)),
    StribeckFriction(ARM, ZERO, ZERO, np.full(7, 0.3), np.full(7, 0.5), np.full(7, 0.05)),
    ViscousFriction(ARM, ZERO, ZERO),
    TorqueOffset(ZERO),
    LinkInertia(ARM, np.zeros((9, 10))),
    RotorInertia(ARM, ZERO),
    PreslidingHysteresis(ARM, np.array([0.01, 0.1]), ELEMENTS, ELEMENTS),
]


def motion(seed: int, count: int = 60) -> State:
    random = np.random.default_rng(seed)
    q, qd, qdd = random.normal(size=(3, count, 7))
    return State(np.cumsum(0.05 * q, axis=0), qd, qdd)


@pytest.mark.parametrize("term", TERMS, ids=lambda term: term.NAME)
def test_torque_is_the_regressor_times_the_coefficients(term):
    theta = np.abs(np.random.default_rng(0).normal(size=len(term.theta)))
    full = term.with_theta(theta)
    np.testing.assert_array_equal(full.theta, theta)
    state = motion(1)
    np.testing.assert_allclose(full.torque(state), term.regressor(state) @ theta, atol=1e-11)


@pytest.mark.parametrize("term", TERMS, ids=lambda term: term.NAME)
def test_a_term_goes_through_a_model_file_unchanged(term, tmp_path):
    theta = np.abs(np.random.default_rng(2).normal(size=len(term.theta)))
    TorqueModel(ARM, (term.with_theta(theta),)).save(tmp_path / "model.yaml")
    loaded = TorqueModel.load(tmp_path / "model.yaml")
    state = motion(3)
    np.testing.assert_allclose(
        loaded.torque_at(state), term.with_theta(theta).torque(state), atol=1e-12
    )


@pytest.mark.parametrize("name", ["mtml", "mtmr"])
def test_batched_regressor_is_pinocchios(name):
    arm = Arm.load(name)
    gravity = np.array([0.7, -0.4, -9.7])
    tree = build_tree(arm, {}, gravity)
    q, qd, qdd = np.random.default_rng(4).normal(size=(3, 30, 7))
    expected = [tree.regressor(*sample) for sample in zip(q, qd, qdd, strict=True)]
    np.testing.assert_allclose(rigid_body.regressor(arm, q, qd, qdd, gravity), expected, atol=1e-12)


def test_blocks_join_without_a_seam(monkeypatch):
    q, qd, qdd = np.random.default_rng(5).normal(size=(3, 50, 7))
    links = np.random.default_rng(6).normal(size=rigid_body.PER_LINK * len(ARM.bodies))
    whole = rigid_body.regressor(ARM, q, qd, qdd, ARM.gravity)
    torque = rigid_body.torque(ARM, links, q, qd, qdd, ARM.gravity)
    monkeypatch.setattr(rigid_body, "_BLOCK", 7)
    np.testing.assert_array_equal(rigid_body.regressor(ARM, q, qd, qdd, ARM.gravity), whole)
    again = rigid_body.torque(ARM, links, q, qd, qdd, ARM.gravity)
    np.testing.assert_allclose(again, torque, rtol=0.0, atol=1e-12)


def test_link_inertia_and_gravity_together_are_the_inverse_dynamics():
    """The same bodies by Pinocchio, weight included, against our two terms."""
    import pinocchio as pin

    bodies = {body: pin.Inertia.Random() for body in TREE_LINKS}
    frames = link_frames(ARM)
    links = np.array([frames[b].act(bodies[b]).toDynamicParameters() for b in TREE_LINKS])
    weight = rigid_body.regressor(ARM, motion(6, 300).q, None, None, ARM.gravity)
    y = gravity_regressor(motion(6, 300).q, columns=12).reshape(-1, 12)
    beta = np.linalg.lstsq(y, (weight @ links.ravel()).ravel(), rcond=None)[0]
    model = TorqueModel(ARM, (Gravity(ARM, beta, ARM.gravity), LinkInertia(ARM, links)))
    tree = build_tree(ARM, bodies, ARM.gravity)
    state = motion(7, 20)
    expected = [
        tree.inverse_dynamics(*sample) for sample in zip(state.q, state.qd, state.qdd, strict=True)
    ]
    np.testing.assert_allclose(model.torque(state.q, state.qd, state.qdd), expected, atol=1e-9)


def test_presliding_builds_up_over_its_displacement():
    level, displacement = 0.02, 0.03
    joint = np.zeros((1, 7))
    joint[0, 3] = level
    term = PreslidingHysteresis(ARM, np.array([displacement]), joint, np.zeros((1, 7)))
    way = np.linspace(0.0, 0.3, 400)
    there_and_back = np.concatenate([way, way[-2::-1]])
    q = np.zeros((len(there_and_back), 7))
    q[:, 3] = there_and_back
    friction = term.torque(State(q, np.gradient(q, 0.005, axis=0)))[:, 3]
    assert friction[399] == pytest.approx(level)
    back = 0.3 - there_and_back[399:]
    # Dahl 1968, solved: from +level towards -level.
    np.testing.assert_allclose(
        friction[399:], level * (2.0 * np.exp(-back / displacement) - 1.0), atol=1e-9
    )


def test_presliding_of_a_pose_is_full_in_its_direction():
    joint = np.full((1, 7), 0.01)
    term = PreslidingHysteresis(ARM, np.array([0.1]), joint, np.zeros((1, 7)))
    q = np.zeros((3, 7))
    direction = np.array([[1.0] * 7, [-1.0] * 7, [1.0] * 7])
    np.testing.assert_allclose(term.torque(State(q, direction=direction)), 0.01 * direction)
    np.testing.assert_array_equal(term.torque(State(q)), np.zeros((3, 7)))


def test_presliding_wants_a_level_for_every_element():
    with pytest.raises(ConfigError, match="as many as"):
        TorqueModel.from_parameters(
            {
                "presliding_hysteresis.displacement": [0.01, 0.1],
                "presliding_hysteresis.joint.wrist_platform": [0.02],
            }
        )


def test_the_compensator_applies_neither_inertia_nor_what_needs_a_past():
    values = {
        "arm": "mtmr",
        "beta": [0.1] * 10,
        "link_inertia.link2": [1.0] * 10,
        "rotor_inertia.motor": [0.1] * 7,
        "presliding_hysteresis.displacement": [0.1],
        "presliding_hysteresis.joint.wrist_platform": [0.02],
    }
    plain = Settings.from_parameters({"arm": "mtmr", "beta": [0.1] * 10})
    q, qd = np.random.default_rng(8).normal(size=(2, 7))
    np.testing.assert_array_equal(
        Settings.from_parameters(values).torque(q, qd), plain.torque(q, qd)
    )
