"""Terms of bodies, readings and surroundings as formulas: by Pinocchio, or written out here."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from made_up_arm import made_up_arm, random_inertias, random_motion
from support import MODEL_FILE

from dvrk_gravity.arms import BODIES, Arm, build_tree, link_frames, rigid_body
from dvrk_gravity.compensate import Settings
from dvrk_gravity.console import export
from dvrk_gravity.effects import Gravity, LinkInertia
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.gravity import regressor as gravity_regressor
from dvrk_gravity.model import TorqueModel

ARM = Arm.load("mtmr")
OFFSET = np.radians([1.0, -2.0, 3.0, -4.0, 5.0, -6.0, 7.0])
POSE = np.array([0.1, 0.2, -0.1, 0.3, 1.0, 0.1, 0.5])
PAYLOAD = {
    "payload.mass": 0.05,
    "payload.first_moment": [0.001, -0.0005, 0.002],
    "payload.link": "link6",
}
BODY = pin.Inertia(0.05, np.array([0.02, -0.01, 0.04]), np.zeros((3, 3)))  # the same


def only(joint: int, value: float) -> np.ndarray:
    return np.eye(7)[joint] * value


def alone(**values) -> TorqueModel:
    """Return a model of an MTM with these parameters and nothing else."""
    named = {name.replace("__", "."): value for name, value in values.items()}
    return TorqueModel.from_parameters({"arm": "mtmr"} | named)


def shipped(**changes) -> TorqueModel:
    return TorqueModel.from_parameters(TorqueModel.load(MODEL_FILE).parameters() | changes)


# --- weight and inertia ----------------------------------------------------------------------


def test_weight_inertia_and_rotors_of_any_chain_are_its_inverse_dynamics(tmp_path):
    """Joints that turn and slide, links that follow, a transmission, a base that leans."""
    arm = made_up_arm(tmp_path)
    bodies, gravity = random_inertias(arm, 3), np.array([0.7, -0.4, -9.7])
    rows = {
        name: arm.bodies[arm.body_names.index(name)].frame.act(body).toDynamicParameters()
        for name, body in bodies.items()
    }
    values = {f"link_weight.{name}": row[:4].tolist() for name, row in rows.items()}
    values |= {f"link_inertia.{name}": row.tolist() for name, row in rows.items()}
    values |= {"gravity_vector": gravity.tolist(), "arm": arm.source}
    rotors = np.array([0.1, 0.2, 0.3, 0.4])
    model = TorqueModel.from_parameters(values | {"rotor_inertia.motor": rotors.tolist()})
    flags = ({}, {"gravity_enabled": False})
    carries = [TorqueModel.from_parameters(values | flag).term("link_weight") for flag in flags]
    assert [each.carries_arm for each in carries] == [True, False]
    tree = build_tree(arm, bodies, gravity)
    to_motor = np.linalg.inv(np.array(arm.actuator_to_joint))
    for q, qd, qdd in zip(*random_motion(arm, 10, 4), strict=True):
        expected = tree.inverse_dynamics(q, qd, qdd) + to_motor.T @ (rotors * (to_motor @ qdd))
        np.testing.assert_allclose(model.torque(q, qd, qdd), expected, atol=1e-9)
        np.testing.assert_allclose(model.torque(q), tree.gravity(q), atol=1e-9)


def test_link_inertia_and_gravity_of_an_mtm_are_the_inverse_dynamics():
    """The same bodies by Pinocchio, weight included, against our two terms."""
    bodies, frames = random_inertias(ARM, 5), link_frames(ARM)
    links = np.array([frames[b].act(bodies[b]).toDynamicParameters() for b in BODIES])
    q, qd, qdd = np.random.default_rng(6).normal(size=(3, 300, 7))
    weight = rigid_body.regressor(ARM, q, None, None, ARM.gravity)
    y = gravity_regressor(q, columns=12).reshape(-1, 12)
    beta = np.linalg.lstsq(y, (weight @ links.ravel()).ravel(), rcond=None)[0]
    model = TorqueModel(ARM, (Gravity(ARM, beta, ARM.gravity), LinkInertia(ARM, links)))
    tree = build_tree(ARM, bodies, ARM.gravity)
    for sample in zip(q[:20], qd[:20], qdd[:20], strict=True):
        np.testing.assert_allclose(model.torque(*sample), tree.inverse_dynamics(*sample), atol=1e-9)


def test_a_payload_has_the_weight_and_the_inertia_of_a_point_mass_on_its_link():
    loaded, plain = shipped(**PAYLOAD), shipped()
    tree = build_tree(ARM, {"link6": BODY}, ARM.gravity)  # Pinocchio's own algorithms
    qd, qdd = 0.5 * POSE[::-1], 3.0 * np.cos(5.0 * POSE)
    added = loaded.torque(POSE, qd, qdd) - plain.torque(POSE, qd, qdd)
    np.testing.assert_allclose(added, tree.inverse_dynamics(POSE, qd, qdd), atol=1e-12)
    np.testing.assert_allclose(
        loaded.torque(POSE) - plain.torque(POSE), tree.gravity(POSE), atol=1e-12
    )
    settings, without = (Settings.from_parameters(model.parameters()) for model in (loaded, plain))
    compensated = settings.torque(POSE, qd) - without.torque(POSE, qd)
    np.testing.assert_allclose(compensated, tree.gravity(POSE), atol=1e-12)


def test_a_payload_leans_with_the_base():
    leaning = [1.0, 0.5, -9.7]
    model, without = (shipped(**of, gravity_vector=leaning) for of in (PAYLOAD, {}))
    expected = build_tree(ARM, {"link6": BODY}, np.array(leaning)).gravity(POSE)
    np.testing.assert_allclose(model.torque(POSE) - without.torque(POSE), expected, atol=1e-12)


def test_the_gravity_flag_takes_the_payload_s_weight_and_leaves_its_inertia():
    loaded, plain = (shipped(**extra, gravity_enabled=False) for extra in (PAYLOAD, {}))
    np.testing.assert_array_equal(loaded.torque(POSE), plain.torque(POSE))
    still, qdd = np.zeros(7), np.ones(7)
    assert np.abs(loaded.torque(POSE, still, qdd) - plain.torque(POSE, still, qdd)).max() > 1e-3


def test_a_first_moment_wants_a_mass():
    with pytest.raises(ConfigError, match=r"payload.mass.*beside a first moment"):
        shipped(**PAYLOAD | {"payload.mass": 0.0})


# --- readings --------------------------------------------------------------------------------


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


def test_the_console_takes_no_zeros_from_a_model():
    with pytest.raises(ConfigError, match=r"joint_offset.*encoder offsets"):
        export(shipped(joint_offset=OFFSET.tolist()), "28002")


# --- walls, ripples, and what poses show -----------------------------------------------------


def test_a_wall_pushes_back_from_where_it_stands_and_not_before():
    wall = alone(
        contact__above=only(2, 3.0), contact__above_position=only(2, 0.2),
        contact__below=only(2, 2.0), contact__below_position=only(2, -0.1),
    )  # fmt: skip
    for q, expected in ((0.5, 0.9), (0.2, 0.0), (0.1, 0.0), (-0.1, 0.0), (-0.6, -1.0)):
        np.testing.assert_allclose(wall.torque(only(2, q)), only(2, expected), atol=1e-15)
    with pytest.raises(ConfigError, match=r"contact.above_position of elbow_pitch"):
        alone(contact__above=only(2, 3.0).tolist())
    walled, free = (Settings.from_parameters(values).static_torque(only(2, 0.5)) for values in (
        shipped(**wall.parameters()).parameters(), shipped().parameters()
    ))  # fmt: skip
    np.testing.assert_array_equal(walled, free)


def test_ripples_of_a_motor_load_every_joint_that_it_moves():
    ripples = {
        "cogging.amplitude.elbow_pitch": [0.02, 0.01],
        "cogging.cycles_per_revolution.elbow_pitch": [6.0, 9.0],
        "cogging.phase.elbow_pitch": [0.3, -1.0],
    }
    turned = POSE[1] + POSE[2]  # the elbow's motor
    torque = 0.02 * np.cos(6.0 * turned + 0.3) + 0.01 * np.cos(9.0 * turned - 1.0)
    np.testing.assert_allclose(alone(**ripples).torque(POSE), only(1, torque) + only(2, torque))
    with pytest.raises(ConfigError, match=r"cogging.phase.elbow_pitch.*'1 numbers', expected 2"):
        alone(**ripples | {"cogging.phase.elbow_pitch": [0.3]})


def test_a_spring_between_joints_that_pulls_at_one_of_them_is_refused():
    row = (only(2, 0.3) + only(4, -0.2)).tolist()
    refused = r"joint_spring.elbow_pitch\[4\].*-0.2.*expected 0, as joint_spring.wrist_pitch\[2\]"
    with pytest.raises(ConfigError, match=refused):
        alone(joint_spring__elbow_pitch=row, joint_spring__wrist_pitch=[0.0] * 7)


def test_a_held_load_is_a_product_of_polynomials_and_of_poses_alone():
    model = alone(
        held_load__orders=[0, 0, 0, 1, 2, 0, 0], held_load__mean__elbow_pitch=[0.1],
        held_load__difference__elbow_pitch=[0.02],
        held_load__valid_lower=[-1.0] * 7, held_load__valid_upper=[3.0] * 7,
    )  # fmt: skip
    q = np.full(7, 0.5)
    q[3] = 2.0
    function = ((2.0 - 1.0) / 2.0) * (2.0 * ((0.5 - 1.0) / 2.0) ** 2 - 1.0)  # T1 T2
    np.testing.assert_allclose(model.torque(q), only(2, 0.1 * function))
    for way in (1.0, -1.0):
        approached = model.torque(q, direction=np.full(7, way))
        np.testing.assert_allclose(approached, only(2, (0.1 + 0.02 * way) * function))
    assert not model.torque(q, np.ones(7)).any()
    for wrong, expected in (({"orders": [0.5] * 7}, "whole"), ({"valid_lower": []}, "edges")):
        name, value = next(iter(wrong.items()))
        with pytest.raises(ConfigError, match=f"held_load.*{expected}"):
            alone(**model.parameters() | {f"held_load.{name}": value})


def test_no_prediction_goes_beyond_what_poses_showed():
    cable = {"elastic_cable.elbow_pitch": [0.0, 1.0], "torque_offset": [0.01] * 7}
    edges = {"shown_torque.lower": [-0.2] * 7, "shown_torque.upper": [0.3] * 7}
    model = alone(**cable, **edges)
    for q, expected in ((0.1, 0.1), (0.5, 0.3), (-0.15, -0.15), (-2.0, -0.2)):
        assert model.torque(only(2, q))[2] == pytest.approx(expected + 0.01)
    with pytest.raises(ConfigError, match=r"shown_torque.lower of elbow_pitch.*0\.4"):
        alone(**cable, **edges | {"shown_torque.lower": only(2, 0.4).tolist()})
