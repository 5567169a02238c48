"""A recording of the other side's arm is recognised by limits and weight, in every verb."""

from __future__ import annotations

import numpy as np
import pytest
from known_mtm import truth

from dvrk_gravity.arms import JOINT_NAMES, Arm
from dvrk_gravity.diagnosis import load
from dvrk_gravity.identification import FittedParameter, by_weight, evaluate
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.observation import beyond_limits, contradiction, observe
from dvrk_gravity.recording import Recording

LEFT, RIGHT = Arm.load("mtml"), Arm.load("mtmr")


def anywhere(arm: Arm) -> np.ndarray:
    """Return positions all over an arm's range."""
    return np.random.default_rng(0).uniform(arm.lower, arm.upper, (500, 7))


@pytest.mark.parametrize(("mine", "other"), [(LEFT, RIGHT), (RIGHT, LEFT)])
def test_positions_that_only_the_other_side_s_arm_reaches_are_its_own(mine, other):
    assert beyond_limits(anywhere(mine), mine) == []
    q = anywhere(other)
    q[0, 2] = mine.upper[2] + 1.2  # as far beyond the other side's limit
    (found,) = beyond_limits(q, mine)
    assert (found.kind, "wrist_platform" in str(found)) == ("other_hand", True)
    assert other.name in str(found)
    assert contradiction([found]) == str(found)
    assert found.numbers["beyond_rad"] > np.radians(90.0) > found.numbers["beyond_other_rad"]


def test_a_zero_that_is_off_is_no_other_arm():
    for arm in (LEFT, RIGHT):
        for shift in (-0.09, 0.09):
            assert beyond_limits(anywhere(arm) + shift, arm) == []


def test_a_joint_that_neither_side_s_arm_reaches_is_beyond_the_limits():
    q = anywhere(RIGHT)
    for limit, sign in ((RIGHT.upper[2], 1.0), (RIGHT.lower[2], -1.0)):
        for far, warned in ((0.36, True), (0.34, False)):
            q[0, 2] = limit + sign * far
            found = beyond_limits(q, RIGHT)
            assert [(w.kind, w.joint) for w in found] == [("arm_limits", "elbow_pitch")] * warned
            assert not warned or found[0].numbers["beyond_rad"] == pytest.approx(far)


@pytest.mark.parametrize(
    ("value", "half", "arm", "kinds"),
    [
        (0.20, 0.05, LEFT, ["other_hand"]),
        (-0.20, 0.05, RIGHT, ["other_hand"]),
        (0.20, 0.05, RIGHT, []),
        (-0.20, 0.05, LEFT, []),
        (0.20, 0.25, LEFT, []),  # not significant
        (0.20, np.inf, LEFT, []),
        (0.05, 0.01, LEFT, []),  # far from either side's
        (0.002, 0.001, RIGHT, ["effort_unit"]),
        (0.98, 0.05, RIGHT, ["effort_unit"]),
        (0.002, 0.1, RIGHT, []),
        (0.15, 0.02, RIGHT, []),
    ],
)
def test_the_platform_s_weight_shows_the_side_by_its_sign_and_the_unit_by_its_size(
    value, half, arm, kinds
):
    for name in ("beta[5] (pitch_y)", "beta6 (pitch_y)"):
        found = by_weight((FittedParameter(name, value, "N·m", (value - half, value + half)),), arm)
        assert [warning.kind for warning in found] == kinds
    assert by_weight((), arm) == []


def test_every_verb_warns_once():
    recording = truth(1, 12.0)
    model = TorqueModel.from_parameters({"arm": "mtml", "beta": (0.1,) * 10})
    q = anywhere(RIGHT)
    poses = Recording(JOINT_NAMES, None, q, effort=np.full(q.shape, 0.01))
    for warnings in (
        observe([recording], LEFT)[0].warnings,
        evaluate(model, [recording], "joint").warnings,
        load([recording], model).warnings,
        evaluate(model, [poses], "joint").warnings,
    ):
        kinds = [warning.kind for warning in warnings]
        assert kinds.count("other_hand") == 1
        assert "arm_limits" not in kinds
    right = observe([recording], RIGHT)[0].warnings
    assert "other_hand" not in {warning.kind for warning in right}


def test_the_measured_arm_is_a_right_one(measured_data):
    recording = Recording.load(measured_data / "mtm_dynamic_30s_200hz.csv")
    poses = Recording.load(measured_data / "mtmr28002_static_pos.csv").position
    for q in (RIGHT.joint_position(recording.position), poses):
        assert beyond_limits(q, RIGHT) == []
        assert [warning.kind for warning in beyond_limits(q, LEFT)] == ["other_hand"]
