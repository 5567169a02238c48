"""A model of wrong efforts or times predicts them well: what is known otherwise contradicts it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from fitted import ur5_motion
from quick_fits import BOTH, ELBOW, LIFT, POOR, factor_in, fitted_to, poor
from robots import PANDA, UR5

from dvrk_gravity.arms import Arm
from dvrk_gravity.effects import stated_weight
from dvrk_gravity.identification import HeldWeight, missing_weights

HAND = f"{PANDA}#panda_hand"


def test_the_weight_that_a_file_states_is_what_pinocchio_makes_of_it():
    arm, whole = Arm.load(HAND), pin.buildModelFromUrdf(str(PANDA))
    for q in np.random.default_rng(0).uniform(-1.5, 1.5, (5, arm.n)):
        at = np.append(q, np.zeros(whole.nq - arm.n))
        expected = pin.computeGeneralizedGravity(whole, whole.createData(), at)
        np.testing.assert_allclose(stated_weight(arm, q), expected[: arm.n], atol=1e-9)


def test_masses_that_are_rough_keep_a_good_model():
    verdict = fitted_to(None, ur5_motion((0.6, 1.4))).verdict
    assert (verdict.level, verdict.findings) == ("good", ())


def test_efforts_of_another_scale_are_named_by_their_factor():
    fit = fitted_to(0.3 * ur5_motion().effort)
    assert fit.model.verdict == POOR
    (line,) = fit.verdict.findings
    assert factor_in(line) == 0.3
    assert all(name in line for name in BOTH)
    assert fit.to_json()["verdict"]["findings"] == [line]


@pytest.mark.parametrize(("joint", "factor"), [(ELBOW, 0.3), (LIFT, -1.0)])
def test_a_joint_of_another_scale_or_sign_is_named_alone(joint, factor):
    effort = ur5_motion().effort.copy()
    effort[:, joint] *= factor
    fit = fitted_to(effort)
    name = fit.model.arm.joint_names[joint]
    assert poor(fit) == {name}
    (line,) = fit.verdict.findings
    assert line.startswith(f"efforts of {name} ")
    assert factor_in(line) == pytest.approx(factor, rel=0.1)
    assert ("sign" in line) == (factor < 0.0)


def test_a_reversed_axis_takes_the_blame_of_all_joints():
    sign = np.where(np.arange(6) == ELBOW, -1.0, 1.0)
    read = ur5_motion()
    arrays = {name: sign * getattr(read, name) for name in ("position", "velocity", "effort")}
    fit = fitted_to(recording=replace(read, **arrays))
    assert poor(fit) == {"elbow_joint"}
    assert (fit.model.verdict, fit.model.reason) == (POOR, fit.verdict.findings[0])
    assert "all signs of elbow_joint are reversed" in fit.verdict.findings[0]
    assert not [note for note in fit.warnings if note.kind in ("misread", "effort_sign")]


def test_efforts_without_gravity_are_named_joint_by_joint():
    recording = ur5_motion()
    weight = stated_weight(Arm.load(UR5), recording.position)
    fit = fitted_to(recording.effort - weight)
    assert poor(fit) == BOTH
    (line,) = fit.verdict.findings
    assert "gravity is not in the efforts" in line
    assert all(f"{name} (" in line for name in BOTH)
    assert "effort_has_gravity: {read: false}" in line


def test_efforts_that_are_noise_make_no_joint_usable():
    """An error below 1 % of the effort limit counted as none, whatever was predicted."""
    noise = np.random.default_rng(0).normal(size=ur5_motion().effort.shape)
    fit = fitted_to(0.01 * noise * Arm.load(UR5).effort_limit)
    assert poor(fit) == set(ur5_motion().joints)
    assert all(error.r2 < 0.1 for error in fit.held_out.values())
    assert "noise" in fit.verdict.findings[0]


def test_a_wrong_clock_is_named_before_all_else_and_no_such_model_is_used():
    """It is as wrong on data held out: velocities that were measured contradict it."""
    recording = ur5_motion()
    fit = fitted_to(recording=replace(recording, time=2.0 * recording.time))
    assert poor(fit) == set(recording.joints)
    assert factor_in(fit.verdict.findings[0]) == 2.0
    assert "clock" in fit.verdict.findings[0]
    assert "clock" in fit.verdict.record


@pytest.mark.parametrize(
    ("gone", "sure"),
    [(("shoulder_pitch",), True), (("wrist_pitch",), False), (("wrist_pitch", "wrist_yaw"), False)],
)
def test_plausible_masses_forbid_a_model_where_most_of_the_weight_is_missing(gone, sure):
    """One joint of several is no majority, but may carry three quarters of the weight."""
    arm = Arm.load("mtmr")
    weight = {"shoulder_pitch": 0.61, "elbow_pitch": 0.2, "wrist_pitch": 0.09, "wrist_yaw": 0.01}
    weights = [
        HeldWeight(joint, 0.0 if joint in gone else 1.0, 0.01, size, stated=False, believed=True)
        for joint, size in weight.items()
    ]
    (found,) = missing_weights(weights, arm)
    assert found.joints == gone
    assert (found.level == POOR) == sure
