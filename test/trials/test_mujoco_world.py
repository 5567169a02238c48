"""The laboratory's arms: their physics against Pinocchio's, what is hidden in them, their seeds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from dvrk_gravity.arms import Arm, build_tree
from dvrk_gravity.effects import links_of_joints
from testing import lab_effects
from testing.hidden_parts import Hidden
from testing.lab_effects import Setting, hide
from testing.lab_motion import draw_calibration
from testing.mujoco_world import NAMES, MujocoWorld
from testing.score import Outcome, fits, report

SECONDS = 6.0
RATIO = (1.5, 6.0)


@pytest.fixture(scope="module")
def world() -> MujocoWorld:
    return MujocoWorld.draw("chain", 1)


@pytest.fixture(scope="module")
def setting(world) -> Setting:
    truth = world.truth(draw_calibration(world.arm, 2), SECONDS)
    residual = 0.02 * truth.effort.std(axis=0)
    return world.setting(truth, residual)


def test_what_is_fastened_to_any_link_of_any_arm_weighs_as_pinocchio_says():
    for name in NAMES:
        drawn = MujocoWorld.draw(name, 1)
        arm, com = drawn.arm, np.array([0.1, 0.0, 0.02])
        random = np.random.default_rng(2)
        motion = tuple(size * random.standard_normal((10, arm.n)) for size in (0.3, 2.0, 5.0))
        for joint, body in enumerate(links_of_joints(arm)):
            point = {arm.body_names[body]: pin.Inertia(0.4, com, np.zeros((3, 3)))}
            tree = build_tree(arm, point, arm.gravity)
            expected = [tree.inverse_dynamics(*sample) for sample in zip(*motion, strict=True)]
            added = drawn.engine.added(motion, joint, 0.4, com)
            np.testing.assert_allclose(added, expected, atol=1e-9)


EFFECTS = [effect for effect in lab_effects.HIDERS if effect != "nothing"]


@pytest.mark.parametrize("effect", EFFECTS)
def test_a_hidden_effect_is_in_the_recording_at_the_stated_size(world, setting, effect):
    if effect == "joint_flexibility":  # whose resonance is above the band: at most .5 of residual
        setting = replace(setting, residual=0.2 * setting.residual)
    hiding = hide(setting, effect, np.random.default_rng(3))
    assert 0.9 * RATIO[0] < hiding.ratio < 1.1 * RATIO[1], "or it was no use to hide it"
    before, after = (world.record(truth, 4) for truth in (setting.truth, hiding.truth))
    change = after.effort - before.effort
    if effect in ("joint_offset", "encoder_scale", "joint_flexibility"):
        joint, stated = world.arm.joint_names.index(*hiding.hidden.joints), hiding.hidden.parameters
        read = stated.get("factor", 1.0) * before.position[:, joint] + stated.get("offset", 0.0)
        if "stiffness" in stated:
            load = world.engine.torque(*setting.truth.motion)[:, joint] / stated["stiffness"]
            read += np.interp(before.time, setting.truth.time, load)
            assert np.abs(load).max() > 10.0 * 3e-4  # what is tolerated below
        np.testing.assert_allclose(after.position[:, joint], read, atol=3e-4)
        assert "stiffness" in stated or not change.any()
        torques = [world.engine.torque(*truth.motion) for truth in (setting.truth, hiding.truth)]
        assert setting.ratio(torques[1] - torques[0]) == pytest.approx(hiding.ratio, rel=0.1)
        return
    size = np.sqrt(np.mean(change**2, axis=0)) / setting.residual
    if effect == "contact" and "start" in hiding.hidden.parameters:
        span = hiding.hidden.parameters["end"] - hiding.hidden.parameters["start"]
        size = size * np.sqrt(SECONDS / span)
    if hiding.hidden.joints and effect not in ("payload", "link_com", "link_inertia"):
        joint = world.arm.joint_names.index(hiding.hidden.joints[0])
        assert np.argmax(size) == joint
    assert size.max() == pytest.approx(hiding.ratio, rel=0.2)


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
