"""Stribeck friction, payload, zeros and biases, cogging, walls: as formulas, in files, moved."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import brentq
from support import MODEL_FILE

from dvrk_gravity.arms import Arm, build_tree
from dvrk_gravity.compensate import Settings
from dvrk_gravity.console import export
from dvrk_gravity.effects import (
    CoulombFriction,
    PreslidingHysteresis,
    State,
    StribeckFriction,
    Term,
    ViscousFriction,
)
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.simulate import Plant, PlantFile, SimulatedArm

ARM = Arm.load("mtmr")
ZERO = np.zeros(7)


def joint_vector(joint: int, value: float) -> np.ndarray:
    return np.eye(7)[joint] * value


def moving(*terms: Term) -> Plant:
    """A plant without weight."""
    truth = PlantFile.load("mtmr_28002")
    return Plant(TorqueModel(ARM, terms), truth.links, truth.rotor_inertia)


def stribeck(site: str, joint: int, level: float, velocity: float) -> StribeckFriction:
    values = {f"stribeck_friction.{site}": joint_vector(joint, level)}
    values[f"stribeck_friction.{site}_velocity"] = joint_vector(joint, velocity)
    term = StribeckFriction.from_parameters(ARM, {k: tuple(v) for k, v in values.items()})
    assert term is not None
    return term


@pytest.mark.parametrize("velocity", [0.02, -0.1, 0.25, 1.0])
def test_stribeck_friction_falls_with_the_square_of_the_speed(velocity):
    term = stribeck("joint", 3, 0.04, 0.2)
    expected = 0.04 * np.exp(-((velocity / 0.2) ** 2)) * np.sign(velocity)
    np.testing.assert_allclose(
        TorqueModel(ARM, (term,)).torque(ZERO, joint_vector(3, velocity)),
        joint_vector(3, expected),
        atol=1e-15,
    )


def test_stribeck_friction_of_the_elbow_s_motor_follows_q2_plus_q3():
    term = stribeck("motor", 2, 0.04, 0.2)
    model = TorqueModel(ARM, (term,))
    turning = model.torque(ZERO, joint_vector(1, 0.05) + joint_vector(2, 0.05))
    np.testing.assert_allclose(turning[[1, 2]], 0.04 * np.exp(-0.25))
    np.testing.assert_allclose(
        model.torque(ZERO, joint_vector(1, 0.5) - joint_vector(2, 0.5)), ZERO, atol=1e-15
    )


def test_a_stribeck_level_wants_a_velocity():
    with pytest.raises(ConfigError, match=r"joint_velocity of wrist_pitch.*beside a level of 0.01"):
        TorqueModel.from_parameters({"stribeck_friction.joint": list(joint_vector(4, 0.01))})


@pytest.mark.parametrize("site", ["joint", "motor"])
def test_the_plant_breaks_away_at_the_level_and_runs_where_the_sum_of_friction_is_the_effort(site):
    level, coulomb, viscous, velocity = 0.004, 0.003, 0.001, 0.8
    rock = np.r_[np.full(6, 9.0), 0.0]
    plant = moving(
        CoulombFriction(
            ARM, rock + joint_vector(6, coulomb), rock + joint_vector(6, coulomb), ZERO, ZERO, ZERO
        ),
        ViscousFriction(ARM, joint_vector(6, viscous), ZERO),
        stribeck(site, 6, level, velocity),
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


def test_the_compensator_applies_its_part_of_stribeck_friction():
    values = {
        "beta": [0.0] * 10,
        "stribeck_friction.joint": joint_vector(3, 0.04).tolist(),
        "stribeck_friction.joint_velocity": [0.2] * 7,
        "friction_compensation.ratio": [0.5] * 7,
        "friction_compensation.dead_band": [0.05] * 7,
    }
    settings = Settings.from_parameters(values)
    assert settings.torque(ZERO, joint_vector(3, 0.1))[3] == pytest.approx(0.02 * np.exp(-0.25))
    assert settings.torque(ZERO, joint_vector(3, 0.04))[3] == 0.0


OFFSET = np.radians([1.0, -2.0, 3.0, -4.0, 5.0, -6.0, 7.0])
POSE = np.array([0.1, 0.2, -0.1, 0.3, 1.0, 0.1, 0.5])


def shipped(**changes) -> TorqueModel:
    values = TorqueModel.load(MODEL_FILE).parameters()
    return TorqueModel.from_parameters(values | changes)


def test_what_an_encoder_reads_too_much_is_taken_off_before_anything_else(tmp_path):
    shipped(joint_offset=OFFSET.tolist()).save(tmp_path / "model.yaml")
    model, moving = TorqueModel.load(tmp_path / "model.yaml"), np.full(7, 0.3)
    np.testing.assert_array_equal(model.joint_offset, OFFSET)
    np.testing.assert_allclose(
        model.torque(POSE + OFFSET, moving), shipped().torque(POSE, moving), atol=1e-14
    )
    settings = Settings.from_parameters(model.parameters())
    without = Settings.from_parameters(shipped().parameters())
    np.testing.assert_allclose(
        settings.torque(POSE + OFFSET, moving), without.torque(POSE, moving), atol=1e-12
    )


def test_a_bias_of_the_efforts_is_predicted_and_not_compensated():
    offset = [0.01, -0.02, 0.03, 0.04, 0.05, 0.06, 0.07]
    biased = shipped(torque_offset=offset)
    np.testing.assert_allclose(biased.torque(POSE) - shipped().torque(POSE), offset, atol=1e-15)
    settings = Settings.from_parameters(biased.parameters())
    without = Settings.from_parameters(shipped().parameters())
    np.testing.assert_array_equal(settings.torque(POSE, None), without.torque(POSE, None))


def test_a_simulated_arm_reads_its_offsets_and_is_not_pushed_by_them():
    truth = PlantFile.load("mtmr_28002")
    bias = np.array([0.01, -0.02, 0.03, 0.004, 0.005, 0.006, 0.007])
    values = truth.model.parameters()
    model = TorqueModel.from_parameters(
        values | {"joint_offset": OFFSET.tolist(), "torque_offset": bias.tolist()}
    )
    arms = [SimulatedArm(Plant(m, truth.links, truth.rotor_inertia)) for m in (truth.model, model)]
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


def test_the_console_takes_no_zeros_from_a_model():
    with pytest.raises(ConfigError, match=r"joint_offset.*encoder offsets"):
        export(shipped(joint_offset=OFFSET.tolist()), "28002")


PAYLOAD = {
    "payload.mass": 0.05,
    "payload.first_moment": [0.001, -0.0005, 0.002],
    "payload.link": "link6",
}


def test_a_payload_has_the_weight_and_the_inertia_of_a_point_mass_on_its_link():
    loaded, plain = shipped(**PAYLOAD), shipped()
    body = pin.Inertia(0.05, np.array([0.02, -0.01, 0.04]), np.zeros((3, 3)))
    tree = build_tree(ARM, {"link6": body}, ARM.gravity)  # Pinocchio's own algorithms
    qd, qdd = 0.5 * POSE[::-1], 3.0 * np.cos(5.0 * POSE)
    added = loaded.torque(POSE, qd, qdd) - plain.torque(POSE, qd, qdd)
    np.testing.assert_allclose(added, tree.inverse_dynamics(POSE, qd, qdd), atol=1e-12)
    np.testing.assert_allclose(
        loaded.torque(POSE) - plain.torque(POSE), tree.gravity(POSE), atol=1e-12
    )
    settings, without = (Settings.from_parameters(model.parameters()) for model in (loaded, plain))
    compensated = settings.torque(POSE, qd) - without.torque(POSE, qd)
    np.testing.assert_allclose(compensated, tree.gravity(POSE), atol=1e-12)


def test_a_payload_goes_through_a_file_and_leans_with_the_base(tmp_path):
    model = shipped(**PAYLOAD, gravity_vector=[1.0, 0.5, -9.7])
    model.save(tmp_path / "model.yaml")
    loaded = TorqueModel.load(tmp_path / "model.yaml")
    assert loaded.parameters() == model.parameters()
    without = shipped(gravity_vector=[1.0, 0.5, -9.7])
    body = pin.Inertia(0.05, np.array([0.02, -0.01, 0.04]), np.zeros((3, 3)))
    expected = build_tree(ARM, {"link6": body}, np.array([1.0, 0.5, -9.7])).gravity(POSE)
    np.testing.assert_allclose(loaded.torque(POSE) - without.torque(POSE), expected, atol=1e-12)


def test_the_gravity_flag_takes_the_payload_s_weight_and_leaves_its_inertia():
    loaded, plain = (shipped(**extra, gravity_enabled=False) for extra in (PAYLOAD, {}))
    np.testing.assert_array_equal(loaded.torque(POSE), plain.torque(POSE))
    still, qdd = np.zeros(7), np.ones(7)
    assert np.abs(loaded.torque(POSE, still, qdd) - plain.torque(POSE, still, qdd)).max() > 1e-3


def test_a_first_moment_wants_a_mass():
    with pytest.raises(ConfigError, match=r"payload.mass.*beside a first moment"):
        shipped(**PAYLOAD | {"payload.mass": 0.0})


def test_the_plant_carries_a_payload_as_it_would_a_heavier_link():
    truth = PlantFile.load("mtmr_28002")
    loaded = Plant(
        TorqueModel.from_parameters(truth.model.parameters() | PAYLOAD),
        truth.links,
        truth.rotor_inertia,
    )
    body = pin.Inertia(0.05, np.array([0.02, -0.01, 0.04]), np.zeros((3, 3)))
    heavier = Plant(
        truth.model, {**truth.links, "link6": truth.links["link6"] + body}, truth.rotor_inertia
    )
    for plant in (loaded, heavier):
        plant.reset(POSE)
    np.testing.assert_allclose(loaded.mass_matrix(), heavier.mass_matrix(), atol=1e-15)
    weight = build_tree(ARM, {"link6": body}, ARM.gravity).gravity(POSE)
    np.testing.assert_allclose(loaded.smooth_torque() - heavier.smooth_torque(), weight, atol=1e-12)


PRESLIDING = {
    "presliding_hysteresis.displacement": [0.02, 0.0005],
    "presliding_hysteresis.joint.wrist_roll": [0.002, 0.001],
    "presliding_hysteresis.motor.elbow_pitch": [0.03, 0.02],
}


def test_the_plant_holds_a_push_by_presliding_and_yields_as_the_spring_that_it_is():
    level, displacement, effort = 0.003, 0.02, 0.001
    term = PreslidingHysteresis(
        ARM, np.array([displacement]), joint_vector(6, level)[None], np.zeros((1, 7))
    )
    rock = np.r_[np.full(6, 9.0), 0.0]
    plant = moving(
        CoulombFriction(ARM, rock, rock, ZERO, ZERO, ZERO),
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


@pytest.mark.parametrize("rounding", [0.0, 1e-16, -1e-16])
def test_presliding_is_relaxed_where_a_recording_begins_at_rest(rounding):
    term = TorqueModel.from_parameters(PRESLIDING).term("presliding_hysteresis")
    assert isinstance(term, PreslidingHysteresis)
    q = POSE + np.linspace(0.0, 0.001, 50)[:, None] * np.ones(7)
    qd = np.full_like(q, 0.1)
    np.testing.assert_array_equal(term.elements(State(q, qd))[0], np.ones((2, 2, 7)))
    qd[0] = rounding
    np.testing.assert_array_equal(term.elements(State(q, qd))[0], np.zeros((2, 2, 7)))


def test_presliding_shorter_than_a_step_s_way_is_calm():
    values = {
        "presliding_hysteresis.displacement": [1e-4],
        "presliding_hysteresis.joint.wrist_roll": [0.05],
        "presliding_hysteresis.joint.shoulder_pitch": [2.0],
    }
    plant = moving(*TorqueModel.from_parameters(values).terms)
    plant.reset(POSE, np.full(7, 0.5))
    for _ in range(2000):
        plant.step(ZERO)
    assert np.abs(plant.v[[1, 6]]).max() < 1e-2
    assert np.isfinite(plant.q).all()
