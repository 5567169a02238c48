"""What trials of the diagnosis rest on: MuJoCo's arms, and the rules by which a name is right."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from dvrk_gravity.arms import Arm, build_tree, nominal_inertias
from dvrk_gravity.effects import links_of_joints
from testing import mujoco_arms
from testing.hidden_parts import Hidden
from testing.score import Outcome, fits, report


@pytest.mark.parametrize("name", ["ur5", "panda_gripper"])
def test_mujoco_and_pinocchio_agree_about_a_urdf_and_about_what_is_fastened_to_its_link(name):
    arm = mujoco_arms.arm_of(name)
    links = nominal_inertias(arm)
    engine = mujoco_arms.urdf(arm, ())
    random = np.random.default_rng(1)
    motion = tuple(size * random.standard_normal((20, arm.n)) for size in (1.0, 2.0, 5.0))
    com = np.array([0.02, 0.03, 0.05])
    last = arm.body_names[links_of_joints(arm)[-1]]
    loaded = {**links, last: links[last] + pin.Inertia(0.5, com, 1e-3 * np.eye(3))}
    bare, with_it = (
        np.array([tree.inverse_dynamics(*sample) for sample in zip(*motion, strict=True)])
        for tree in (build_tree(arm, bodies, arm.gravity) for bodies in (links, loaded))
    )
    np.testing.assert_allclose(engine.torque(*motion), bare, atol=1e-9)
    added = engine.added(motion, arm.n - 1, 0.5, com, 1e-3)
    np.testing.assert_allclose(added, with_it - bare, atol=1e-9)
    np.testing.assert_allclose(engine.torque(*motion), bare, atol=1e-9)  # and it is off again


def test_another_name_is_right_only_for_the_same_physics_at_the_same_joint():
    arm = Arm.load("mtmr")
    names = arm.joint_names
    payload = Hidden("payload", (names[6],), {})
    assert fits(payload, "payload", (names[6],), arm)
    assert fits(payload, "link_com", (names[6],), arm)
    assert not fits(payload, "link_com", (names[5],), arm)
    assert not fits(payload, "link_com", (), arm)
    rotor = Hidden("rotor_inertia", (names[3],), {})
    assert not fits(rotor, "link_inertia", (names[3],), arm)
    assert fits(replace(rotor, joints=(names[0],)), "link_inertia", (names[0],), arm)
    leak = Hidden("joint_coupling", (names[1], names[2]), {})
    assert fits(leak, "joint_coupling", (names[2], names[1]), arm)
    assert not fits(leak, "joint_coupling", (names[2], names[3]), arm)


def test_only_a_name_that_is_wrong_and_certain_counts_as_surely_wrong():
    def outcome(place: str, *found: tuple[str, bool]) -> Outcome:
        names, certain = zip(*found, strict=True)
        return Outcome("mujoco", "ur5", 0, "creep", found=list(names), certain=list(certain),
                       place=place)  # fmt: skip

    drag, perhaps, nameless = (
        ("viscous_friction a", True),
        ("payload a", False),
        ("unknown a", True),
    )
    shown = report("t", [outcome("wrong", drag, perhaps), outcome("wrong", perhaps, nameless),
                         outcome("first", drag)], {})  # fmt: skip
    assert "certain of a wrong cause: 1 of 3" in shown
