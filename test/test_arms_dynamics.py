"""Dynamics of any arm: gravity, inverse dynamics, regressor, links that follow, against oracles."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
import yaml
from made_up_arm import FILE, made_up_arm, random_inertias, random_motion
from robots import PANDA, UR5

from dvrk_gravity.arms import Arm, build_tree, nominal_inertias, rigid_body
from testing.mujoco_arms import mtm, table

TILTED = np.array([1.3, -2.1, -9.4])


@pytest.fixture(scope="module")
def arms(tmp_path_factory) -> dict[str, Arm]:
    made_up = made_up_arm(tmp_path_factory.mktemp("arm"))
    panda, ur5 = Arm.from_urdf(PANDA), Arm.from_urdf(UR5)
    shipped = {name: Arm.load(name) for name in ("mtmr", "psm", "ecm")}
    return shipped | {"made_up": made_up, "ur5": ur5, "panda": panda}


def inertias_of(arm: Arm) -> dict[str, pin.Inertia]:
    return nominal_inertias(arm) or random_inertias(arm, 3)


def potential(tree, q: np.ndarray) -> float:
    return pin.computePotentialEnergy(tree.model, tree.data, tree.expand @ q)


def test_gravity_is_the_slope_of_potential_energy(arms):
    step = 1e-6
    for name, arm in arms.items():
        tree = build_tree(arm, inertias_of(arm), TILTED)
        for q in random_motion(arm, 5, 1)[0]:
            slopes = [
                (potential(tree, q + step * unit) - potential(tree, q - step * unit)) / (2 * step)
                for unit in np.eye(arm.n)
            ]
            np.testing.assert_allclose(tree.gravity(q), slopes, atol=2e-7, err_msg=name)


def test_inverse_dynamics_is_mass_times_acceleration_and_bias(arms):
    for name, arm in arms.items():
        tree = build_tree(arm, inertias_of(arm), TILTED)
        for q, qd, qdd in zip(*random_motion(arm, 10, 2), strict=True):
            mass = tree.mass_matrix(q)
            np.testing.assert_allclose(mass, mass.T, atol=1e-12, err_msg=name)
            assert np.linalg.eigvalsh(mass).min() > 0
            np.testing.assert_allclose(
                tree.inverse_dynamics(q, qd, qdd), mass @ qdd + tree.bias(q, qd), atol=1e-9,
                err_msg=name,
            )  # fmt: skip


def test_regressor_times_parameters_and_torque_are_inverse_dynamics(arms):
    for name, arm in arms.items():
        inertias = inertias_of(arm)
        tree, motion = build_tree(arm, inertias, TILTED), random_motion(arm, 10, 4)
        parameters = np.zeros((len(arm.bodies), rigid_body.PER_LINK))
        for row, body in zip(parameters, arm.bodies, strict=True):
            if body.name in inertias:
                row[:] = body.frame.act(inertias[body.name]).toDynamicParameters()
        expected = [tree.inverse_dynamics(*sample) for sample in zip(*motion, strict=True)]
        tolerance = 1e-10 * np.abs(expected).max()
        found = rigid_body.torque(arm, parameters.ravel(), *motion, TILTED)
        np.testing.assert_allclose(found, expected, atol=tolerance, err_msg=name)
        linear = rigid_body.regressor(arm, *motion, TILTED)
        np.testing.assert_allclose(linear @ parameters.ravel(), expected, atol=tolerance)
        pinocchio_s = [tree.regressor(*sample) for sample in zip(*motion, strict=True)]
        rounding = 1e-11 * np.abs(pinocchio_s).max()
        np.testing.assert_allclose(linear, pinocchio_s, atol=rounding, err_msg=name)
        found = rigid_body.torque(arm, parameters.ravel(), motion[0], None, None, TILTED)
        at_rest = [tree.gravity(q) for q in motion[0]]
        np.testing.assert_allclose(found, at_rest, atol=tolerance, err_msg=name)


def test_regressor_of_an_arm_at_rest_and_without_acceleration_leaves_them_out(arms):
    arm = arms["made_up"]
    q, qd, _ = random_motion(arm, 5, 5)
    still = np.zeros_like(q)
    for given, full in (((None, None), (still, still)), ((qd, None), (qd, still))):
        np.testing.assert_array_equal(
            rigid_body.regressor(arm, q, *given, TILTED),
            rigid_body.regressor(arm, q, *full, TILTED),
        )


@pytest.mark.parametrize("path", [UR5, PANDA])
def test_a_urdf_s_dynamics_are_those_that_pinocchio_reads_itself(path):
    """With its own joint frames and axes; the arm has all axes along z."""
    arm = Arm.from_urdf(path)
    own = pin.buildModelFromUrdf(str(path))
    data = own.createData()
    tree = build_tree(arm, nominal_inertias(arm), own.gravity.linear)
    # Only one finger of the Panda is a joint of the arm, the other mimics it.
    gather = np.zeros((own.nv, arm.n))
    for i, name in enumerate(own.names[1:]):
        gather[i, arm.joint_names.index(name.replace("finger_joint2", "finger_joint1"))] = 1.0
    for q, qd, qdd in zip(*random_motion(arm, 10, 6), strict=True):
        expected = pin.rnea(own, data, gather @ q, gather @ qd, gather @ qdd) @ gather
        np.testing.assert_allclose(tree.inverse_dynamics(q, qd, qdd), expected, atol=1e-10)
        pin.forwardKinematics(own, data, gather @ q)
        pin.forwardKinematics(tree.model, tree.data, tree.expand @ q)
        for i, body in enumerate(arm.bodies, start=1):
            link = tree.data.oMi[i] * body.frame
            np.testing.assert_allclose(link.homogeneous, data.oMi[i].homogeneous, atol=1e-12)


def test_a_chain_to_a_tip_holds_the_other_joints_where_zero_is_nearest():
    chain, whole = Arm.load(f"{PANDA}#panda_hand"), Arm.from_urdf(PANDA)
    assert chain.joint_names == whole.joint_names[:7]
    short = build_tree(chain, nominal_inertias(chain), TILTED)
    full = build_tree(whole, nominal_inertias(whole), TILTED)
    for sample in zip(*random_motion(chain, 5, 7), strict=True):
        expected = full.inverse_dynamics(*(np.append(part, 0.0) for part in sample))[:7]
        np.testing.assert_allclose(short.inverse_dynamics(*sample), expected, atol=1e-10)


def test_a_chain_in_the_modified_convention_is_where_its_table_puts_it(tmp_path):
    path = tmp_path / "modified.yaml"
    path.write_text(yaml.safe_dump({**FILE, "convention": "modified", "followers": []}))
    arm = Arm.load(path)
    tree = build_tree(arm, {}, TILTED)
    q = random_motion(arm, 1, 11)[0][0]
    pin.forwardKinematics(tree.model, tree.data, tree.expand @ q)
    pose = np.eye(4)
    for i, (row, value) in enumerate(zip(FILE["joints"], q, strict=True), start=1):
        slides = row.get("type") == "prismatic"
        alpha, offset = np.radians([row["alpha"], row["offset"]])
        angle, way = offset + (0 if slides else value), row["d"] + (value if slides else 0)
        ca, sa, ct, st = np.cos(alpha), np.sin(alpha), np.cos(angle), np.sin(angle)
        # Craig, Introduction to Robotics, equation 3.6.
        pose = pose @ np.array(
            [
                [ct, -st, 0, row["a"]],
                [st * ca, ct * ca, -sa, -sa * way],
                [st * sa, ct * sa, ca, ca * way],
                [0, 0, 0, 1],
            ]
        )
        link = tree.data.oMi[i] * arm.body(f"link{i}").frame
        np.testing.assert_allclose(link.homogeneous, pose, atol=1e-12)


def test_links_that_follow_carry_what_mujoco_finds_for_joints_of_their_own(arms):
    """By virtual work: what each of MuJoCo's joints needs, weighted by how much it is moved."""
    for name, engine in (("mtmr", mtm), ("psm", table), ("ecm", table)):
        arm, inertias = arms[name], random_inertias(arms[name], 9)
        motion = random_motion(arm, 20, 10)
        tree = build_tree(arm, inertias, TILTED)
        found = [tree.inverse_dynamics(*sample) for sample in zip(*motion, strict=True)]
        expected = engine(name, inertias, TILTED).torque(*motion)
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)
