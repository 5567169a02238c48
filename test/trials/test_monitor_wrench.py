"""The wrench at an arm's tip from its joint torques, against MuJoCo and drawn errors."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from made_up_arm import random_inertias, random_motion

from dvrk_gravity.errors import ConfigError
from dvrk_gravity.monitoring import Tip
from testing.mujoco_arms import arm_of, mtm, table


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


def test_a_wrench_s_joint_torques_are_mujoco_s_also_through_links_that_follow(rng):
    for name, engine in (("mtmr", mtm), ("psm", table), ("ecm", table), ("chain", table)):
        arm = arm_of(name)
        tip = Tip(arm)
        known = engine(name, random_inertias(arm, 9), np.zeros(3))
        data = mujoco.MjData(known.model)
        body = int(known.bodies[-1])
        for q in random_motion(arm, 5, 3)[0]:
            data.qpos = known.expand @ q
            mujoco.mj_forward(known.model, data)
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = data.xmat[body].reshape(3, 3), data.xpos[body]
            pose = pose @ known.frames[-1]
            wrench, effort = rng.normal(size=6), np.zeros(known.model.nv)
            force, moment = (pose[:3, :3] @ part for part in (wrench[:3], wrench[3:]))
            mujoco.mj_applyFT(known.model, data, force, moment, pose[:3, 3], body, effort)
            np.testing.assert_allclose(
                tip.jacobian(q).T @ wrench, effort @ known.expand, atol=1e-9, err_msg=name
            )


def test_the_covariance_is_that_of_drawn_errors_and_exact_torques_give_the_wrench(rng):
    arm = arm_of("ur5")
    tip, q = Tip(arm), np.array([0.3, -1.1, 1.4, -0.6, 1.2, 0.4])
    wrench, deviation = np.array([20.0, -5.0, 8.0, 1.0, 2.0, -1.0]), np.full(6, 1e-3)
    exact = tip.jacobian(q).T @ wrench
    found = tip.wrench(q, exact, deviation)
    np.testing.assert_allclose(found.value, wrench, atol=1e-3)
    assert found.unobservable_in_words() == ""
    drawn = np.array(
        [tip.wrench(q, exact + e, deviation).value for e in rng.normal(0.0, deviation, (4000, 6))]
    )
    np.testing.assert_allclose(drawn.std(axis=0), found.deviation, rtol=0.05)


def test_what_a_pose_does_not_show_is_named_and_its_deviation_is_that_of_no_measurement(rng):
    arm = arm_of("ecm")  # four joints
    tip, q = Tip(arm), np.array([0.2, 0.3, 0.1, 0.4])
    found = tip.wrench(q, rng.normal(size=4), np.full(4, 0.01))
    assert len(found.unobservable) == 2
    for direction in found.unobservable:
        assert np.abs(tip.jacobian(q).T @ (tip.scale * direction)).max() < 1e-6
        along = direction @ (found.covariance / np.outer(tip.scale, tip.scale)) @ direction
        assert along == pytest.approx(1.0)
        assert (found.value / tip.scale) @ direction == pytest.approx(0.0, abs=1e-9)
    assert "force" in found.unobservable_in_words() or "moment" in found.unobservable_in_words()
    # A joint that says nothing takes one more away.
    deviation = np.array([0.01, 0.01, np.inf, 0.01])
    assert len(tip.wrench(q, np.zeros(4), deviation).unobservable) == 3
    with pytest.raises(ConfigError, match="link"):
        Tip(arm, "no_such_link")
