"""The verdict on an identified model: good, usable, or not to be compensated with."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from known_mtm import ARM, truth
from known_poses import grid, record
from known_poses import truth as posed

from dvrk_gravity import command_line
from dvrk_gravity.arms import JOINT_NAMES, Arm
from dvrk_gravity.compensate import Settings
from dvrk_gravity.effects import CoulombFriction
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.identification import (
    Holding,
    JointError,
    Verdict,
    by_errors,
    dry_friction,
    identify,
    judge,
    level_of,
)
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Recording

KNOWN = Holding(1.0, 0.01, 1.0, 0.01, -1.0, 1.0)  # to 1 %, moved by 2 rad
POOR = "do_not_compensate"
GOOD_ERRORS = dict.fromkeys(JOINT_NAMES, JointError(0.5, 0.05, 0.99))


def of(
    joint: str = "outer_yaw",
    share: float = 0.05,
    rmse: float = 0.5,
    training: float = 0.05,
    **known: float,
) -> Verdict:
    """Return the verdict where one joint has this error or certainty, and all others are good."""
    fitted = GOOD_ERRORS | {joint: JointError(rmse, training, 0.0)}
    errors = GOOD_ERRORS | {joint: JointError(rmse, share, 0.0)}
    holding = dict.fromkeys(JOINT_NAMES, KNOWN) | {joint: replace(KNOWN, **known)}
    return judge(errors, fitted, holding, ARM, "joint")


@pytest.mark.parametrize("joint", ["outer_yaw", "wrist_roll"])
def test_a_joint_is_good_up_to_the_published_error_and_poor_from_the_consoles_limit(joint):
    good = ARM.joints[JOINT_NAMES.index(joint)].published_error
    poor = max(0.30, 2.0**0.5 * good)
    for share, level in (
        (good, "good"), (1.01 * good, "usable"), (0.99 * poor, "usable"), (1.01 * poor, POOR),
        (np.nan, POOR), (np.inf, POOR),
    ):  # fmt: skip
        verdict = of(joint, share)
        assert verdict.level == verdict.joints[joint].level == level
        others = {other.level for name, other in verdict.joints.items() if name != joint}
        assert others == {"good"}
        assert (level == "good") == (verdict.reason == "") == (verdict.record == "")
        assert level == "good" or verdict.reason.startswith(f"{joint}:")


def test_a_joint_of_another_arm_is_judged_as_its_own_and_not_as_its_namesake():
    """A PSM has a wrist_pitch, too; of the same joint of an arm of one's own nothing is known."""
    mtm, psm = ARM.joints[4], Arm.load("psm").joints[4]
    own = replace(mtm, published_error=None)
    assert mtm.name == psm.name == "wrist_pitch"
    assert [level_of(joint, 0.26) for joint in (mtm, psm, own)] == ["good", "usable", "usable"]
    assert [level_of(joint, 0.32) for joint in (mtm, psm, own)] == ["usable", "usable", POOR]


def test_an_error_that_moves_no_joint_counts_as_none():
    limit = ARM.effort_limit[6]
    assert of("wrist_roll", 1.0, 0.0099 * limit).level == "good"
    assert of("wrist_roll", 1.0, 0.0101 * limit).level == POOR
    # Unless a constant predicts all joints as well.
    noise = dict.fromkeys(JOINT_NAMES, JointError(1e-6, 1.0, 0.0, beats_constant=False))
    verdict = judge(noise, noise, dict.fromkeys(JOINT_NAMES, KNOWN), ARM, "joint")
    assert (verdict.level, len(verdict.findings)) == (POOR, 1)


def test_gravity_that_the_data_leave_open_is_not_compensated():
    poor = of("shoulder_pitch", error=0.4)
    assert poor.level == POOR
    assert "1.00 ± 0.40 N·m" in poor.reason
    assert of("shoulder_pitch", error=0.2).level == "usable"
    assert of("shoulder_pitch", torque=0.0, error=0.001).level == "good"
    assert of("shoulder_pitch", torque=0.0, error=0.1).level == POOR


def test_gravity_that_is_uncertain_by_less_than_dry_friction_costs_no_more_than_good():
    assert of("outer_yaw", torque=0.06, error=0.04, friction=0.05).level == "usable"
    assert of("outer_yaw", torque=0.06, error=0.06, friction=0.05).level == POOR
    assert of("shoulder_pitch", error=0.1, friction=0.5).level == "good"


def test_the_dry_friction_of_a_joint_is_that_of_all_that_moves_with_it():
    at_joint, at_motor = np.zeros((2, 7))
    at_joint[[0, 2]], at_motor[2] = 0.02, 0.03
    nothing = np.zeros(7)
    uneven = CoulombFriction(
        ARM, at_joint, 2.0 * at_joint, at_motor, at_motor, np.full(7, 0.05), nothing, nothing
    )
    expected = 1.5 * at_joint + 0.03 * np.abs(ARM.joint_to_actuator[2])
    assert np.count_nonzero(expected) > 2  # the elbow's motor moves another joint, too
    np.testing.assert_allclose(dry_friction(TorqueModel(ARM, (uneven,))), expected, atol=1e-12)
    np.testing.assert_array_equal(dry_friction(TorqueModel(ARM, ())), 0.0)


def test_friction_that_poses_do_not_separate_costs_no_more_than_good():
    joint, limit = "wrist_platform", ARM.effort_limit[3]

    def level(share: float, training: float, rmse: float = 0.09, directed: bool = False) -> str:
        fitted = GOOD_ERRORS | {joint: JointError(rmse * limit, training, 0.0)}
        held_out = GOOD_ERRORS | {joint: JointError(rmse * limit, share, 0.0)}
        rubs, known = () if directed else (joint,), dict.fromkeys(JOINT_NAMES, KNOWN)
        verdict = judge(held_out, fitted, known, ARM, "joint", static=True, with_friction=rubs)
        assert by_errors(ARM, held_out, "joint", rubs)[joint].level in (verdict.level, "usable")
        return verdict.level

    assert level(0.9, 0.88) == "usable"
    assert level(0.9, 0.88, directed=True) == POOR
    # More than friction is, or more than it is on what was fitted: it is something else.
    assert level(0.9, 0.88, rmse=0.11) == POOR
    assert level(0.9, 0.5) == POOR
    assert level(0.2, 0.2) == "good"


def test_a_range_that_was_not_recorded_costs_no_more_than_good():
    assert of("elbow_pitch", error_anywhere=10.0).level == "usable"
    unmoved = of("elbow_pitch", lower=0.0, upper=0.1)
    assert unmoved.level == "usable"
    assert "5.7 deg" in unmoved.reason


def test_what_to_record_instead_follows_from_where_the_error_is():
    overfitted, unexplained = of(share=0.5, training=0.05), of(share=0.5, training=0.45)
    assert "longer" in overfitted.record
    assert "free" in unexplained.record


def test_errors_held_out_of_a_few_seconds_make_no_model_usable():
    """With 2 s of a motion: good errors, and one of 112 % of the torque in another motion."""
    holding = dict.fromkeys(JOINT_NAMES, KNOWN)
    for duration, level in ((8.0, "good"), (7.9, POOR)):
        judged = judge(GOOD_ERRORS, GOOD_ERRORS, holding, ARM, "joint", duration=duration)
        assert judged.level == level
        assert {joint.level for joint in judged.joints.values()} == {level}


def wandering(recording: Recording) -> Recording:
    """Return a recording in which something else acts on outer_yaw."""
    effort = recording.effort.copy()
    effort[:, 0] += 0.05 * np.random.default_rng(0).normal(size=len(effort)).cumsum()
    return replace(recording, effort=effort)


@pytest.fixture(scope="module")
def poor(tmp_path_factory):
    """Status, the folder of the files, of a model that must not be compensated with."""
    folder = tmp_path_factory.mktemp("poor")
    wandering(truth(1, 12.0)).save(folder / "run.csv")
    words = [folder / "run.csv", "--arm", "mtmr", "--out", folder / "poor.yaml", "--terms",
             "coulomb_friction", "--json", folder / "fit.json", "--no-physical"]  # fmt: skip
    return command_line.run("dvrk_gravity.cli.identify", [str(word) for word in words]), folder


def test_a_poor_model_is_written_with_status_1_and_its_verdict_in_every_file(poor):
    status, folder = poor
    assert status == 1
    found = json.loads((folder / "fit.json").read_text())["verdict"]
    assert found["overall"] == found["joints"]["outer_yaw"]["verdict"] == POOR
    assert found["joints"]["outer_yaw"]["reason"] in found["reason"]
    assert found["record"]
    model = TorqueModel.load(folder / "poor.yaml")
    assert (model.verdict, model.reason) == (POOR, found["reason"])
    assert "do not compensate" in (folder / "poor.html").read_text().split("</h1>")[0]


def test_the_compensator_refuses_a_poor_model_unless_it_is_allowed(poor):
    values = TorqueModel.load(poor[1] / "poor.yaml").parameters()
    with pytest.raises(ConfigError, match=r"allow_poor_model: true .*outer_yaw") as caught:
        Settings.from_parameters(values)
    assert "\n" not in str(caught.value)
    allowed = Settings.from_parameters(values | {"allow_poor_model": True})
    assert allowed.model.verdict == POOR


def test_poses_that_never_moved_the_shoulder_leave_its_gravity_open():
    q = grid(3)
    q[:, 1] = 0.3
    stood = identify(record(posed(), q), ARM).verdict.joints["shoulder_pitch"]
    assert stood.level == POOR
