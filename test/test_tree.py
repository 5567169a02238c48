"""The master arm's tree: its parallelogram, its dynamics in MuJoCo, and gravity from beta."""

from __future__ import annotations

import itertools

import numpy as np
import pinocchio as pin
import pytest
from made_up_arm import random_inertias

from dvrk_gravity.arms import BODIES, Arm, beta_tree, build_tree, link_frames, torque
from testing.mujoco_arms import CRANK_FRAME, SIDE, dh_table, fixed_part, mtm, turn

ARM = Arm.load("mtmr")
TABLE = dh_table("mtmr")
DOWN = np.array([0.0, 0.0, -9.81])
TILTED = np.array([1.3, -2.1, -9.4])


def dh_frames(q: np.ndarray) -> list[np.ndarray]:
    """Frames 0 to 7 of the DH chain, in the base."""
    frames = [np.eye(4)]
    for joint, angle in zip(TABLE, q, strict=True):
        frames.append(frames[-1] @ turn("z", angle) @ fixed_part(joint))
    return frames


@pytest.fixture(scope="module")
def inertias():
    return random_inertias(ARM, 5)


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


def test_mujoco_finds_the_same_torques_for_the_same_motion(tree, inertias, motions):
    q, qd, qdd = np.moveaxis(motions, 1, 0)
    expected = [tree.inverse_dynamics(*sample) for sample in motions]
    found = mtm("mtmr", inertias, TILTED).torque(q, qd, qdd)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


def test_gravity_of_beta_s_tree_is_the_closed_form(motions):
    for length, vector in itertools.product((10, 12, 14), (DOWN, TILTED, (0.0, 3.0, 0.5))):
        beta = np.random.default_rng(length).normal(0, 0.5, length)
        tree = beta_tree(ARM, beta, np.array(vector))
        for q, _, _ in motions:
            np.testing.assert_allclose(tree.gravity(q), torque(q, beta, vector), atol=1e-13)
