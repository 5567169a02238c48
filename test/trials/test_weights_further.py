"""Further examples of what the weight of links shows, beside those of test/test_weights.py."""

from __future__ import annotations

from dataclasses import replace

import fitted
import numpy as np
import pytest
from fitted import ur5_motion
from quick_fits import BOTH, ELBOW, LIFT, POOR, factor_in, fitted_to, placeholder, poor
from robots import PANDA, UR5

from dvrk_gravity.arms import Arm
from dvrk_gravity.effects import stated_weight
from dvrk_gravity.identification import identify
from dvrk_gravity.observation import in_their_unit
from dvrk_gravity.simulate import PlantFile
from testing.posed_arms import ur5

HAND = f"{PANDA}#panda_hand"


def test_a_load_keeps_a_good_model():
    verdict = fitted_to(None, ur5_motion((1.0, 1.0), 3.0, HAND), HAND).verdict
    assert (verdict.level, verdict.findings) == ("good", ())


def test_masses_that_stand_in_for_some_do_not_veto_what_is_stated_to_be_in_newton_metres(tmp_path):
    file = placeholder(tmp_path, 0.1)
    doubted = fitted_to(arm=file)
    assert doubted.verdict.level == POOR
    assert all("--effort-unit N·m" in line for line in doubted.verdict.findings)
    believed = fitted_to(arm=Arm.load(file).with_effort_unit("N·m"))
    assert (believed.verdict.level, believed.verdict.findings) == ("good", ())


def test_plausible_masses_of_a_shipped_arm_show_that_gravity_is_not_there():
    plant = PlantFile.load("ecm")
    recording = fitted.move(plant, 1, 12.0)
    assert fitted_to(recording=recording, arm=plant.model.arm).verdict.findings == ()
    effort = recording.effort - plant.model.torque(recording.position)
    fit = fitted_to(effort, recording, plant.model.arm)
    assert fit.verdict.level == POOR
    assert "gravity is not in the efforts" in fit.verdict.findings[0]


def test_a_load_that_no_such_arm_lifts_explains_no_factor():
    """The same sizes as a load's, of a wrong scale: three times all efforts, and not of a load."""
    recording = ur5_motion(file=HAND)
    fit = fitted_to(3.0 * recording.effort, recording, HAND)
    assert fit.verdict.level == POOR
    (line,) = fit.verdict.findings
    assert factor_in(line) == 3.0


def test_efforts_that_are_exchanged_are_named():
    effort = ur5_motion().effort.copy()
    effort[:, [LIFT, ELBOW]] = effort[:, [ELBOW, LIFT]]
    fit = fitted_to(effort)
    assert poor(fit) >= BOTH
    (line,) = fit.verdict.findings
    assert "shoulder_lift_joint and elbow_joint look exchanged" in line


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


def test_the_right_unit_is_believed_with_rough_masses_and_a_load():
    for masses, load in (((0.6, 1.4), 0.0), ((1.0, 1.0), 3.0)):
        assert in_their_unit(Arm.load(HAND), [ur5_motion(masses, load, HAND)])[1] == ()


def test_a_large_rotor_is_no_unit():
    """Wrists weigh next to nothing: of efforts that follow accelerations, no unit is known."""
    file = str(UR5).replace("ur5", "ur10")
    recording = ur5_motion(file=file)
    dt = float(np.median(np.diff(recording.time)))
    rotor = np.gradient(recording.velocity, dt, axis=0)
    large = replace(recording, effort=recording.effort + rotor)
    assert in_their_unit(Arm.load(file), [large])[1] == ()
