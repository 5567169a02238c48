"""The Pinocchio tree: parallelogram, inverse dynamics, regressor, and gravity from beta."""

from __future__ import annotations

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from dh_table import dh_table
from scipy.spatial.transform import Rotation

from dvrk_gravity import gravity
from dvrk_gravity.arms import Arm
from dvrk_gravity.arms.mtm import BODIES, beta_tree
from dvrk_gravity.arms.tree import build_tree, link_frames

ARM = Arm.load("mtmr")
TABLE = dh_table("mtmr")
SIDE = 0.1  # m, the parallelogram's short side
DOWN = np.array([0.0, 0.0, -9.81])
TILTED = np.array([1.3, -2.1, -9.4])
CRANK_FRAME = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])  # in frame 3


def turn(axis: str, angle: float) -> np.ndarray:
    """4 x 4 rotation."""
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_euler(axis, angle).as_matrix()
    return matrix


def shift(x: float, y: float, z: float) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def fixed_part(joint) -> np.ndarray:
    """Distal frame seen from the joint's own, at its zero: what DH puts after the rotation."""
    return turn("z", joint.offset) @ shift(joint.a, 0, joint.d) @ turn("x", joint.alpha)


def dh_frames(q: np.ndarray) -> list[np.ndarray]:
    """Frames 0 to 7 of the DH chain, in the base."""
    frames = [np.eye(4)]
    for joint, angle in zip(TABLE, q, strict=True):
        frames.append(frames[-1] @ turn("z", angle) @ fixed_part(joint))
    return frames


def random_inertia(rng) -> pin.Inertia:
    """That of a few point masses, which makes it physical."""
    masses, points = rng.uniform(0.02, 0.2, 6), rng.normal(0, 0.08, (6, 3))
    lever = masses @ points / masses.sum()
    at_lever = points - lever
    inertia = sum(
        m * (p @ p * np.eye(3) - np.outer(p, p)) for m, p in zip(masses, at_lever, strict=True)
    )
    return pin.Inertia(masses.sum(), lever, inertia)


@pytest.fixture(scope="module")
def inertias():
    rng = np.random.default_rng(5)
    return {body: random_inertia(rng) for body in BODIES}


@pytest.fixture(scope="module")
def tree(inertias):
    return build_tree(ARM, inertias, TILTED)


@pytest.fixture(scope="module")
def motions() -> np.ndarray:
    """(30, 3, 7) positions, velocities, accelerations."""
    rng = np.random.default_rng(6)
    return rng.uniform(-1, 1, (30, 3, 7)) * np.array([2.5, 4.0, 20.0])[:, None]


def test_links_of_the_tree_are_where_the_dh_table_puts_them(tree, motions):
    frames = link_frames(ARM)
    for q, _, _ in motions:
        pin.forwardKinematics(tree.model, tree.data, tree.expand @ q)
        for number, expected in enumerate(dh_frames(q)[1:], start=1):
            body = BODIES.index(f"link{number}") + 1
            found = (tree.data.oMi[body] * frames[f"link{number}"]).homogeneous
            np.testing.assert_allclose(found, expected, atol=1e-13)


def test_crank_and_bar_close_the_parallelogram(tree, motions):
    frames = link_frames(ARM)
    for q, _, _ in motions:
        base = dh_frames(q)
        shoulder, elbow = base[1][:3, 3], base[2][:3, 3]
        along_forearm = base[3][:3, 0]
        pin.forwardKinematics(tree.model, tree.data, tree.expand @ q)
        crank, bar = (
            tree.data.oMi[BODIES.index(body) + 1] * frames[body] for body in ("crank", "bar")
        )
        # The crank is parallel to the forearm and as long as the lever there ...
        tip = shoulder + SIDE * along_forearm
        np.testing.assert_allclose(crank.translation, tip, atol=1e-13)
        # ... and the bar, which hangs on the forearm's lever, ends at the crank's tip,
        np.testing.assert_allclose(bar.translation, tip, atol=1e-13)
        pivot = elbow + SIDE * along_forearm
        np.testing.assert_allclose(bar.act(np.array([-TABLE[1].a, 0, 0])), pivot, atol=1e-13)
        # so that both keep the orientation of what they are parallel to.
        np.testing.assert_allclose(bar.rotation[:, 0], -base[2][:3, 0], atol=1e-13)
        np.testing.assert_allclose(bar.rotation[:, 1], -base[2][:3, 1], atol=1e-13)
        np.testing.assert_allclose(crank.rotation, base[3][:3, :3] @ CRANK_FRAME, atol=1e-13)


def test_mass_matrix_is_symmetric_and_positive_definite(tree, motions):
    for q, _, _ in motions:
        mass = tree.mass_matrix(q)
        np.testing.assert_allclose(mass, mass.T, atol=1e-15)
        assert np.linalg.eigvalsh(mass).min() > 0


def test_inverse_dynamics_is_mass_times_acceleration_and_bias(tree, motions):
    zero = np.zeros(7)
    for q, qd, qdd in motions:
        torque = tree.inverse_dynamics(q, qd, qdd)
        np.testing.assert_allclose(torque, tree.mass_matrix(q) @ qdd + tree.bias(q, qd), atol=1e-11)
        np.testing.assert_allclose(
            tree.gravity(q), tree.inverse_dynamics(q, zero, zero), atol=1e-12
        )


def test_regressor_times_inertial_parameters_is_the_torque(tree, motions):
    parameters = np.concatenate(
        [inertia.toDynamicParameters() for inertia in tree.model.inertias[1:]]
    )
    for q, qd, qdd in motions:
        np.testing.assert_allclose(
            tree.regressor(q, qd, qdd) @ parameters,
            tree.inverse_dynamics(q, qd, qdd),
            atol=1e-10,
        )


def body_xml(name: str, place: np.ndarray, frame: np.ndarray, inertia: pin.Inertia, inner: str):
    """A MuJoCo body that turns about its z, with an inertia given in ``frame``."""
    rotation = frame[:3, :3]
    lever = frame @ np.append(inertia.lever, 1.0)
    i = rotation @ inertia.inertia @ rotation.T

    def text(values) -> str:
        return " ".join(repr(float(value)) for value in values)

    w_last = Rotation.from_matrix(place[:3, :3]).as_quat()
    return (
        f'<body name="{name}" pos="{text(place[:3, 3])}" quat="{text(np.roll(w_last, 1))}">'
        f'<joint name="{name}" axis="0 0 1"/>'
        f'<inertial mass="{inertia.mass!r}" pos="{text(lever[:3])}" fullinertia="'
        f'{text([i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2]])}"/>{inner}</body>'
    )


def mujoco_arm(inertias) -> tuple[mujoco.MjModel, np.ndarray]:
    """The same arm built otherwise: the crank on link 1 by q2 + q3, the bar on the crank's tip."""
    fixed = [fixed_part(joint) for joint in TABLE]
    chain = ""
    for number in range(7, 1, -1):
        body = f"link{number}"
        chain = body_xml(body, fixed[number - 2], fixed[number - 1], inertias[body], chain)
    offset2, offset3 = TABLE[1].offset, TABLE[2].offset
    # At q2 = q3 = 0 the crank's x axis lies along the forearm's.
    upright = fixed[0] @ turn("z", offset2 + offset3)
    tip = shift(SIDE, 0, 0)
    crank_frame = np.eye(4)
    crank_frame[:3, :3] = turn("x", TABLE[2].alpha)[:3, :3] @ CRANK_FRAME
    bar_place = tip @ turn("z", -offset3)  # along the arm again
    bar = body_xml("bar", bar_place, turn("z", np.pi), inertias["bar"], "")
    crank = body_xml("crank", upright, tip @ crank_frame, inertias["crank"], bar)
    whole = body_xml("link1", np.eye(4), fixed[0], inertias["link1"], chain + crank)
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><compiler angle="radian"/><option gravity="{TILTED[0]} {TILTED[1]} {TILTED[2]}"/>'
        f"<worldbody>{whole}</worldbody></mujoco>"
    )
    expand = np.zeros((model.nv, 7))
    for number in range(1, 8):
        expand[model.joint(f"link{number}").dofadr[0], number - 1] = 1.0
    expand[model.joint("crank").dofadr[0], [1, 2]] = 1.0
    expand[model.joint("bar").dofadr[0], 2] = -1.0
    return model, expand


def test_mujoco_finds_the_same_torques_for_the_same_motion(tree, inertias, motions):
    model, expand = mujoco_arm(inertias)
    data = mujoco.MjData(model)
    for q, qd, qdd in motions:
        data.qpos[:], data.qvel[:], data.qacc[:] = expand @ q, expand @ qd, expand @ qdd
        mujoco.mj_inverse(model, data)
        np.testing.assert_allclose(
            tree.inverse_dynamics(q, qd, qdd), data.qfrc_inverse @ expand, rtol=1e-9, atol=1e-9
        )


@pytest.mark.parametrize("length", [10, 12, 14])
@pytest.mark.parametrize("vector", [DOWN, TILTED, np.array([0.0, 3.0, 0.5])])
def test_gravity_of_beta_s_tree_is_the_closed_form(length, vector, motions):
    beta = np.random.default_rng(length).normal(0, 0.5, length)
    tree = beta_tree(ARM, beta, vector)
    for q, _, _ in motions:
        np.testing.assert_allclose(tree.gravity(q), gravity.torque(q, beta, vector), atol=1e-13)


def test_a_link_without_inertia_weighs_nothing(motions):
    bare = build_tree(ARM, {}, DOWN)
    for q, qd, qdd in motions:
        np.testing.assert_array_equal(bare.inverse_dynamics(q, qd, qdd), np.zeros(7))
