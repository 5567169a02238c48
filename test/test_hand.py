"""A recording of the other hand's arm is told as such, in one line, by every verb."""

from __future__ import annotations

import numpy as np
import pytest
from known_mtm import truth

from dvrk_gravity.arms import JOINT_NAMES, Arm
from dvrk_gravity.diagnosis import load
from dvrk_gravity.identification import FittedParameter, by_weight, evaluate, identify
from dvrk_gravity.intake import beyond_limits
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Recording

pytestmark = pytest.mark.usefixtures("four_folds")

LEFT, RIGHT = Arm.load("mtml"), Arm.load("mtmr")


def anywhere(arm: Arm, share: float = 1.0) -> np.ndarray:
    """Return positions all over a part of an arm's range."""
    middle, half = 0.5 * (arm.lower + arm.upper), 0.5 * share * (arm.upper - arm.lower)
    return np.random.default_rng(0).uniform(middle - half, middle + half, (500, 7))


@pytest.mark.parametrize(("mine", "other"), [(LEFT, RIGHT), (RIGHT, LEFT)])
def test_positions_that_only_the_other_hand_reaches_are_told_in_one_line(mine, other):
    assert beyond_limits(anywhere(mine), mine) == []
    (found,) = beyond_limits(anywhere(other), mine)
    assert found.kind == "other_hand"
    assert f"looks like a recording of {other.name}, not {mine.name}: wrist_platform" in str(found)
    assert found.numbers["beyond_rad"] > np.radians(90.0) > found.numbers["beyond_other_rad"]


def test_a_zero_that_is_off_is_no_other_hand():
    for arm in (LEFT, RIGHT):
        for shift in (-0.09, 0.09):
            assert beyond_limits(anywhere(arm) + shift, arm) == []


def test_a_joint_that_neither_hand_reaches_is_told_as_before():
    q = anywhere(RIGHT)
    q[:, 2] += 1.0
    (found,) = beyond_limits(q, RIGHT)
    assert (found.kind, found.joint) == ("arm_limits", "elbow_pitch")


@pytest.mark.parametrize(
    ("value", "half", "arm", "told"),
    [
        (0.20, 0.05, LEFT, True),
        (-0.20, 0.05, RIGHT, True),
        (0.20, 0.05, RIGHT, False),
        (-0.20, 0.05, LEFT, False),
        (0.20, 0.25, LEFT, False),  # not significant
        (0.20, np.inf, LEFT, False),
        (0.05, 0.01, LEFT, False),  # far from either hand's
    ],
)
def test_the_sign_of_the_platform_s_weight_tells_where_limits_do_not(value, half, arm, told):
    for name in ("beta[5] (pitch_y)", "beta6 (pitch_y)"):
        found = by_weight((FittedParameter(name, value, "N·m", (value - half, value + half)),), arm)
        assert bool(found) == told
        assert not told or "not mtm" in str(found[0])
    assert by_weight((), arm) == []


@pytest.mark.parametrize(("value", "half", "told"), [
    (0.002, 0.001, True), (0.98, 0.05, True), (0.002, 0.1, False), (0.15, 0.02, False),
])  # fmt: skip
def test_the_size_of_the_platform_s_weight_tells_a_wrong_unit(value, half, told):
    found = by_weight(
        (FittedParameter("beta[5] (pitch_y)", value, "N·m", (value - half, value + half)),), RIGHT
    )
    assert [warning.kind for warning in found] == ["effort_unit"] * told


def test_identify_evaluate_and_diagnose_warn_once():
    recording = truth(1, 12.0)
    model = TorqueModel.from_parameters({"arm": "mtml", "beta": (0.1,) * 10})
    for warnings in (
        identify([recording], LEFT, "joint", ["coulomb_friction"]).warnings,
        evaluate(model, [recording], "joint").warnings,
        load([recording], model).warnings,
    ):
        assert [warning.kind for warning in warnings].count("other_hand") == 1
        assert not any(warning.kind == "arm_limits" for warning in warnings)
    right = identify([recording], RIGHT, "joint", ["coulomb_friction"]).warnings
    assert not any(warning.kind == "other_hand" for warning in right)


def test_evaluated_poses_are_compared_with_the_limits_too():
    q = anywhere(RIGHT)
    poses = Recording(JOINT_NAMES, None, q, effort=np.full(q.shape, 0.01))
    model = TorqueModel.from_parameters({"arm": "mtml", "beta": (0.1,) * 10})
    assert "other_hand" in {warning.kind for warning in evaluate(model, [poses], "joint").warnings}


def test_the_measured_arm_is_a_right_one(measured_data):
    recording = Recording.load(measured_data / "mtm_dynamic_30s_200hz.csv")
    q = RIGHT.joint_position(recording.position)
    assert beyond_limits(q, RIGHT) == []
    assert [warning.kind for warning in beyond_limits(q, LEFT)] == ["other_hand"]
    poses = Recording.load(measured_data / "mtmr28002_static_pos.csv").position
    assert beyond_limits(poses, RIGHT) == []
    assert [warning.kind for warning in beyond_limits(poses, LEFT)] == ["other_hand"]
