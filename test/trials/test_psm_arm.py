"""The PSM and the ECM as arms: the remote centre, the jaws, and the links that torque sees."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from made_up_arm import random_motion

from dvrk_gravity.arms import Arm, build_tree
from dvrk_gravity.effects import identifiable_links, joint_of_link


@pytest.fixture(scope="module")
def psm() -> Arm:
    return Arm.load("psm")


def test_the_shaft_goes_through_the_remote_centre_whatever_the_joints():
    for arm in (Arm.load("psm"), Arm.load("ecm")):
        tree, carriage = build_tree(arm, {}, arm.gravity), arm.body_names.index("link3")
        for q in random_motion(arm, 20, 2)[0]:
            pin.forwardKinematics(tree.model, tree.data, tree.expand @ q)
            shaft = tree.data.oMi[carriage + 1] * arm.bodies[carriage].frame
            assert np.linalg.norm(np.cross(shaft.translation, shaft.rotation[:, 2])) < 1e-12


def test_motors_of_the_wrist_move_a_jaw_each_as_published(psm):
    """w5 = 1.0186 m5, w6 = -0.8306 m5 + 1.2178 m6, w7 = -0.8306 m5 + 1.2178 m7."""
    motors = np.array([0.0, 0.0, 0.0, 0.0, 0.2, -0.1, 0.3])
    joints = psm.joint_position(motors)
    w6, w7 = -0.8306 * 0.2 + 1.2178 * -0.1, -0.8306 * 0.2 + 1.2178 * 0.3
    np.testing.assert_allclose(joints[4:], [1.0186 * 0.2, (w6 + w7) / 2, w7 - w6], atol=1e-4)


def test_of_links_that_turn_equally_only_one_is_estimated(psm):
    """Back, middle and link 2 turn by the same angle about parallel axes: torque sees one."""
    names = [psm.body_names[body] for body in identifiable_links(psm)]
    assert set(names) == set(psm.body_names) - {"back", "middle"}
    assert [psm.joint_names[joint_of_link(psm, body)] for body in identifiable_links(psm)][-3:] == [
        "insertion", "pitch", "pitch",
    ]  # fmt: skip
