"""The verdict on an identified model: good, usable, or not to be compensated with."""

from __future__ import annotations

import json
import re
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
    dry_friction,
    identify,
    judge,
    level_of,
)
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Recording
from dvrk_gravity.report import compared, error_table

pytestmark = pytest.mark.usefixtures("four_folds", "blank_pictures")

KNOWN = Holding(1.0, 0.01, 1.0, 0.01, -1.0, 1.0)  # to 1 %, moved by 2 rad
FEW = ["coulomb_friction"]


def of(
    joint: str = "outer_yaw",
    share: float = 0.05,
    rmse: float = 0.5,
    training: float = 0.05,
    **known: float,
) -> Verdict:
    """Return the verdict where one joint has this error or certainty, and all others are good."""
    errors = {name: JointError(0.5, 0.05, 0.99) for name in JOINT_NAMES}
    fitted = dict(errors) | {joint: JointError(rmse, training, 0.0)}
    holding = dict.fromkeys(JOINT_NAMES, KNOWN) | {joint: replace(KNOWN, **known)}
    errors[joint] = JointError(rmse, share, 0.0)
    return judge(errors, fitted, holding, ARM, "joint")


@pytest.mark.parametrize("joint", JOINT_NAMES)
def test_a_joint_is_good_up_to_the_published_error_and_poor_from_the_consoles_limit(joint):
    good = ARM.joints[JOINT_NAMES.index(joint)].published_error
    poor = max(0.30, 2.0**0.5 * good)
    for share, level in (
        (good, "good"),
        (1.01 * good, "usable"),
        (0.99 * poor, "usable"),
        (1.01 * poor, "do_not_compensate"),
        (1.5, "do_not_compensate"),
        (np.nan, "do_not_compensate"),
        (np.inf, "do_not_compensate"),
    ):
        verdict = of(joint, share)
        assert verdict.level == verdict.joints[joint].level == level
        others = {other.level for name, other in verdict.joints.items() if name != joint}
        assert others == {"good"}
        assert (level == "good") == (verdict.reason == "") == (verdict.record == "")
        assert level == "good" or verdict.reason.startswith(f"{joint}: held-out error")


def test_a_joint_of_another_arm_is_judged_as_its_own_and_not_as_its_namesake():
    """A PSM has a wrist_pitch, too; of the same joint of an arm of one's own nothing is known."""
    mtm, psm = ARM.joints[4], Arm.load("psm").joints[4]
    own = replace(mtm, published_error=None)
    assert mtm.name == psm.name == "wrist_pitch"
    judged = [level_of(joint, 0.26) for joint in (mtm, psm, own)]
    assert judged == ["good", "usable", "usable"]
    judged = [level_of(joint, 0.32) for joint in (mtm, psm, own)]
    assert judged == ["usable", "usable", "do_not_compensate"]


def test_an_error_that_moves_no_joint_counts_as_none():
    limit = ARM.effort_limit[6]
    assert of("wrist_roll", 1.0, 0.0099 * limit).level == "good"
    assert of("wrist_roll", 1.0, 0.0101 * limit).level == "do_not_compensate"


def test_gravity_that_the_data_leave_open_is_not_compensated():
    poor = of("shoulder_pitch", error=0.4)
    assert poor.level == "do_not_compensate"
    assert "gravity torque uncertain: 1000 mN·m ± 400 mN·m" in poor.reason
    assert "all joints" in poor.record
    assert of("shoulder_pitch", error=0.2).level == "usable"
    assert of("shoulder_pitch", torque=0.0, error=0.001).level == "good"
    assert of("shoulder_pitch", torque=0.0, error=0.1).level == "do_not_compensate"


def test_gravity_that_is_uncertain_by_less_than_dry_friction_costs_no_more_than_good():
    held = of("outer_yaw", torque=0.06, error=0.04, friction=0.05)
    assert held.level == "usable"
    assert "60 mN·m ± 40 mN·m, less than its dry friction (50 mN·m)" in held.reason
    assert of("outer_yaw", torque=0.06, error=0.06, friction=0.05).level == "do_not_compensate"
    assert of("shoulder_pitch", error=0.1, friction=0.5).level == "good"


def test_the_dry_friction_of_a_joint_is_that_of_all_that_moves_with_it():
    at_joint, at_motor = np.zeros((2, 7))
    at_joint[[0, 2]], at_motor[2] = 0.02, 0.03
    uneven = CoulombFriction(ARM, at_joint, 2.0 * at_joint, at_motor, at_motor, np.full(7, 0.05))
    expected = 1.5 * at_joint + 0.03 * np.abs(ARM.joint_to_actuator[2])
    assert np.count_nonzero(expected) > 2  # the elbow's motor moves another joint, too
    np.testing.assert_allclose(dry_friction(TorqueModel(ARM, (uneven,))), expected, atol=1e-12)
    np.testing.assert_array_equal(dry_friction(TorqueModel(ARM, ())), 0.0)


def test_friction_that_poses_do_not_tell_apart_costs_no_more_than_good():
    joint, limit = "wrist_platform", ARM.effort_limit[3]
    friction = 0.09 * limit  # as a real one has

    def verdict(share: float, training: float, rmse: float = friction, told: bool = False):
        errors = dict.fromkeys(JOINT_NAMES, JointError(0.5, 0.05, 0.99))
        fitted = errors | {joint: JointError(rmse, training, 0.0)}
        held_out = errors | {joint: JointError(rmse, share, 0.0)}
        rubs = () if told else (joint,)
        known = dict.fromkeys(JOINT_NAMES, KNOWN)
        return judge(held_out, fitted, known, ARM, "joint", static=True, with_friction=rubs)

    rubbing = verdict(0.9, 0.88)
    assert rubbing.level == "usable"
    assert "friction" in rubbing.reason
    assert "approached from both directions" in rubbing.record
    assert verdict(0.9, 0.88, told=True).level == "do_not_compensate"
    # More than friction is, or more than it is on what was fitted: it is something else.
    assert verdict(0.9, 0.88, rmse=0.11 * limit).level == "do_not_compensate"
    few = verdict(0.9, 0.5)
    assert few.level == "do_not_compensate"
    assert "more poses" in few.record
    assert verdict(0.2, 0.2).level == "good"


def test_a_range_that_was_not_recorded_costs_no_more_than_good():
    beyond = of("elbow_pitch", error_anywhere=10.0)
    assert beyond.level == "usable"
    assert "outside the recorded poses" in beyond.reason
    assert "other parts of the joints' ranges" in beyond.record
    unmoved = of("elbow_pitch", lower=0.0, upper=0.1)
    assert unmoved.level == "usable"
    assert "elbow_pitch: hardly moved (by 5.7 deg)" in unmoved.reason


def test_what_to_record_instead_follows_from_where_the_error_is():
    assert "a longer motion" in of(share=0.5, training=0.05).record
    unexplained = of(share=0.5, training=0.45)
    assert unexplained.record.startswith("a free motion, without contact")
    assert "an unmodelled effect" in unexplained.reason


@pytest.mark.parametrize(
    ("claimed", "share", "line"),
    [
        (
            "usable", 0.05,
            "verdict in the model file: usable; from these errors alone it would be: "
            "good",
        ),
        (
            "good", 0.9,
            "verdict in the model file: good; from these errors alone it would be: "
            "do not compensate with this (wrist_yaw 90 % of the torque); `diagnose` finds out why",
        ),
        (
            "unknown", 0.05,
            "the model carries no verdict of identify; from these errors alone it would be: good",
        ),
    ],
)  # fmt: skip
def test_an_evaluation_is_compared_with_what_the_model_claims(claimed, share, line):
    errors = {name: JointError(0.5, 0.05, 0.99) for name in JOINT_NAMES}
    errors["wrist_yaw"] = JointError(0.5, share, 0.0)
    assert compared(TorqueModel(ARM, (), verdict=claimed), errors, "joint") == line


def test_an_evaluation_says_where_friction_is_in_the_errors():
    errors = dict.fromkeys(JOINT_NAMES, JointError(0.5, 0.05, 0.99))
    errors["wrist_platform"] = JointError(0.09 * ARM.effort_limit[3], 0.9, 0.0)
    line = compared(TorqueModel(ARM, ()), errors, "joint", ["wrist_platform", "elbow_pitch"])
    assert line.endswith(
        "it would be: usable (wrist_platform 90 % of the torque, friction included, which these "
        "poses do not separate)"
    )


def wandering(recording: Recording) -> Recording:
    """Return a recording in which something else acts on outer_yaw."""
    effort = recording.effort.copy()
    effort[:, 0] += 0.05 * np.random.default_rng(0).normal(size=len(effort)).cumsum()
    return replace(recording, effort=effort)


@pytest.fixture(scope="module")
def poor():
    return identify([wandering(truth(1, 12.0))], ARM, "joint", FEW)


def test_a_simulated_arm_gives_a_good_model():
    fit = identify(
        [truth(1, 12.0)], ARM, "joint", ["coulomb_friction", "elastic_cable"], bias_is="torque"
    )
    assert fit.verdict.level == "good"
    assert fit.model.verdict == "good"
    Settings.from_parameters(fit.model.parameters())


def test_recordings_kept_out_of_the_fit_judge_it(poor):
    assert poor.verdict.joints["outer_yaw"].level == "do_not_compensate"
    fit = identify([truth(1, 12.0)], ARM, "joint", FEW, validate=[wandering(truth(2, 12.0))])
    assert fit.model.verdict == "do_not_compensate"
    assert list(fit.verdict.joints) == list(JOINT_NAMES)


def test_the_compensator_refuses_a_poor_model_unless_told_otherwise(poor, tmp_path):
    poor.model.save(tmp_path / "poor.yaml")
    loaded = TorqueModel.load(tmp_path / "poor.yaml")
    assert loaded.parameters() == poor.model.parameters()
    assert loaded.verdict == "do_not_compensate"
    assert loaded.reason == poor.verdict.reason
    with pytest.raises(ConfigError) as caught:
        Settings.from_parameters(loaded.parameters())
    assert "\n" not in str(caught.value)
    assert "allow_poor_model: true (outer_yaw: held-out error" in str(caught.value)
    settings = Settings.from_parameters(loaded.parameters() | {"allow_poor_model": True})
    assert settings.model.verdict == "do_not_compensate"


def test_a_poor_model_is_written_and_told_everywhere_with_status_1(tmp_path, capsys):
    wandering(truth(1, 12.0)).save(tmp_path / "run.csv")
    out = tmp_path / "model.yaml"
    arguments = [str(tmp_path / "run.csv"), "--arm", "mtmr", "--out", str(out), "--terms", FEW[0],
                 "--json", str(tmp_path / "fit.json")]  # fmt: skip
    assert command_line.run("dvrk_gravity.cli.identify", arguments) == 1
    shown = capsys.readouterr().out
    assert "verdict: do not compensate with this" in shown
    assert re.search(r"\nouter_yaw .* do not compensate: held-out error", shown)
    assert "record instead: a free motion, without contact" in shown
    told = json.loads((tmp_path / "fit.json").read_text())["verdict"]
    assert told["overall"] == told["joints"]["outer_yaw"]["verdict"] == "do_not_compensate"
    assert told["joints"]["outer_yaw"]["reason"] in told["reason"]
    assert told["record"]
    page = (tmp_path / "model.html").read_text()
    headline = page.split("</h1>")[0]
    assert "mtmr, do not compensate with this (outer_yaw): errs by" in headline
    assert " to 100 % of the torque" in headline
    assert "R²" not in headline
    assert TorqueModel.load(out).verdict == "do_not_compensate"


def test_poses_that_never_moved_the_shoulder_do_not_tell_its_gravity():
    q = grid(3)
    q[:, 1] = 0.3
    verdict = identify(record(posed(), q), ARM).verdict
    assert verdict.joints["shoulder_pitch"].level == "do_not_compensate"
    assert "gravity torque uncertain" in verdict.joints["shoulder_pitch"].reason
    assert "more poses" in verdict.joints["shoulder_pitch"].record
    moved = identify(record(posed(), grid(3)), ARM).verdict
    assert moved.joints["shoulder_pitch"].level != "do_not_compensate"


def test_errors_held_out_of_a_few_seconds_make_no_model_usable():
    """Found with 2 s of a motion: "usable", and an error of 112 % of the torque in another one."""
    errors, holding = dict.fromkeys(JOINT_NAMES, JointError(0.5, 0.05, 0.99)), dict.fromkeys(
        JOINT_NAMES, KNOWN
    )  # fmt: skip
    assert judge(errors, errors, holding, ARM, "joint", duration=8.0).level == "good"
    short = judge(errors, errors, holding, ARM, "joint", duration=2.0)
    assert short.level == "do_not_compensate"
    told = "\n".join(error_table(errors, ARM, short.joints))
    assert told.count("2 s of motion") == 1, "why is told once for all joints"
    assert told.count("do not compensate: as outer_yaw") == len(JOINT_NAMES) - 1
