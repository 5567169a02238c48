"""A model of wrong efforts or times predicts them well: what is known otherwise contradicts it."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import fitted
import numpy as np
import pinocchio as pin
import pytest
from fitted import FEW, ur5_motion
from robots import PANDA, UR5

from dvrk_gravity.arms import Arm
from dvrk_gravity.identification import Fit, HeldWeight, identify, missing_weights
from dvrk_gravity.model import stated_weight
from dvrk_gravity.recording import Recording
from dvrk_gravity.simulate import PlantFile
from testing.posed_arms import ur5

HAND = f"{PANDA}#panda_hand"
LIFT, ELBOW = 1, 2  # of the UR5
BOTH = {"shoulder_lift_joint", "elbow_joint"}
POOR = "do_not_compensate"


def fitted_to(effort=None, recording: Recording | None = None, arm: Arm | str = UR5) -> Fit:
    recording = ur5_motion() if recording is None else recording
    recording = replace(recording, effort=recording.effort if effort is None else effort)
    return identify(recording, arm, effects=FEW, physical=False)


def poor(fit: Fit) -> set[str]:
    return {name for name, verdict in fit.verdict.joints.items() if verdict.level == POOR}


def factor_in(line: str) -> float:
    """Return the factor that a finding states."""
    return float(re.search(r"(-?[\d.]+) times", line)[1])


def test_the_weight_that_a_file_states_is_what_pinocchio_makes_of_it():
    arm, whole = Arm.load(HAND), pin.buildModelFromUrdf(str(PANDA))
    for q in np.random.default_rng(0).uniform(-1.5, 1.5, (5, arm.n)):
        at = np.append(q, np.zeros(whole.nq - arm.n))
        expected = pin.computeGeneralizedGravity(whole, whole.createData(), at)
        np.testing.assert_allclose(stated_weight(arm, q), expected[: arm.n], atol=1e-9)


@pytest.mark.parametrize(
    ("masses", "load", "file"), [((0.6, 1.4), 0.0, str(UR5)), ((1.0, 1.0), 3.0, HAND)]
)
def test_masses_that_are_rough_and_a_load_keep_a_good_model(masses, load, file):
    verdict = fitted_to(None, ur5_motion(masses, load, file), file).verdict
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
    assert not [line for line in fit.handling if "mounting" in line or "opposite" in line]


def test_efforts_that_are_exchanged_are_named():
    effort = ur5_motion().effort.copy()
    effort[:, [LIFT, ELBOW]] = effort[:, [ELBOW, LIFT]]
    fit = fitted_to(effort)
    assert poor(fit) >= BOTH
    (line,) = fit.verdict.findings
    assert "shoulder_lift_joint and elbow_joint look exchanged" in line


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


def placeholder(folder: Path, mass: float) -> str:
    text = re.sub(r'<mass value="[^"]*"', f'<mass value="{mass}"', Path(UR5).read_text())
    (folder / "robot.urdf").write_text(text)
    return str(folder / "robot.urdf")


def test_masses_that_stand_in_for_some_do_not_veto_what_is_stated_to_be_in_newton_metres(tmp_path):
    file = placeholder(tmp_path, 0.1)
    doubted = fitted_to(arm=file)
    assert doubted.verdict.level == POOR
    assert all("--effort-unit N·m" in line for line in doubted.verdict.findings)
    believed = fitted_to(arm=Arm.load(file).with_effort_unit("N·m"))
    assert (believed.verdict.level, believed.verdict.findings) == ("good", ())


def test_gravity_that_is_not_there_is_noticed_whatever_the_masses_are(tmp_path):
    arm = Arm.load(placeholder(tmp_path, 1.0)).with_effort_unit("N·m")
    weight = stated_weight(Arm.load(UR5), ur5_motion().position)
    fit = fitted_to(ur5_motion().effort - weight, arm=arm)
    assert fit.verdict.level != "good"
    assert "gravity is not in the efforts" in fit.verdict.findings[0]


def test_neither_no_masses_nor_a_stated_unit_contradict_a_model(tmp_path):
    massless = fitted_to(arm=placeholder(tmp_path, 0.0))
    currents = fitted_to(0.08 * ur5_motion().effort, arm=Arm.load(UR5).with_effort_unit("A"))
    for verdict in (massless.verdict, currents.verdict):
        assert (verdict.level, verdict.findings) == ("good", ())


def test_plausible_masses_of_a_shipped_arm_show_that_gravity_is_not_there():
    plant = PlantFile.load("ecm")
    recording = fitted.move(plant, 1, 12.0)
    assert fitted_to(recording=recording, arm=plant.model.arm).verdict.findings == ()
    effort = recording.effort - plant.model.torque(recording.position)
    fit = fitted_to(effort, recording, plant.model.arm)
    assert fit.verdict.level == POOR
    assert "gravity is not in the efforts" in fit.verdict.findings[0]


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


def test_poses_are_judged_by_the_masses_as_motions_are():
    posed = ur5()
    recording = posed.record(1, 120)
    effort = recording.effort.copy()
    assert identify(recording, posed.arm).verdict.findings == ()
    effort[:, recording.joints.index("elbow_joint")] *= 0.3
    (line,) = identify(replace(recording, effort=effort), posed.arm).verdict.findings
    assert line.startswith("efforts of elbow_joint ")
    assert factor_in(line) == pytest.approx(0.3, rel=0.1)
    noise = np.random.default_rng(0).normal(size=effort.shape)
    judged = identify(replace(recording, effort=noise), posed.arm)
    assert poor(judged) == set(recording.joints)
    assert "noise" in judged.verdict.findings[0]


def test_a_load_that_no_such_arm_lifts_explains_no_factor():
    """The same sizes as a load's, of a wrong scale: three times all efforts, and not of a load."""
    recording = ur5_motion(file=HAND)
    fit = fitted_to(3.0 * recording.effort, recording, HAND)
    assert fit.verdict.level == POOR
    (line,) = fit.verdict.findings
    assert factor_in(line) == 3.0
