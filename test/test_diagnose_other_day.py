"""Friction that a day has changed at many joints is expected; what goes beyond it is news."""

from types import SimpleNamespace

import numpy as np
import pytest

from dvrk_gravity.arms import Arm
from dvrk_gravity.diagnosis import Beside, Candidate, FrictionChange
from dvrk_gravity.effects import OffsetHypothesis, Site

ARM = Arm.load("mtmr")
SAMPLES = 400
SIGN = np.where(np.arange(SAMPLES) // 20 % 2 == 0, 1.0, -1.0)
FRICTION = np.tile(SIGN[:, None], 7)


class Choice:
    """What a cross-validation tells of its samples: least squares, joint by joint."""

    def __init__(self, residual: np.ndarray) -> None:
        self.weight = np.ones(7)
        self.data = SimpleNamespace(
            friction=FRICTION, residual=residual, known_error=np.full(7, 0.1)
        )

    def of_choice(self, values: np.ndarray) -> np.ndarray:
        return values

    def torque(self, candidate: Candidate, theta: np.ndarray) -> np.ndarray:
        torque = np.zeros((SAMPLES, 7))
        torque[:, candidate.joints] = candidate.values @ theta
        return torque

    def parameters(self, candidates: list[Candidate]) -> np.ndarray:
        columns = [candidate.columns().reshape(-1, candidate.size) for candidate in candidates]
        design = np.concatenate([np.zeros((SAMPLES * 7, 0)), *columns], axis=1)
        return np.linalg.lstsq(design, self.data.residual.reshape(-1), rcond=None)[0]


def offset(joint: int, shape: np.ndarray) -> Candidate:
    """Return a claim that a joint has a torque of some shape, not called friction."""
    columns = np.zeros((SAMPLES, 7, 1))
    columns[:, joint, 0] = shape
    hypothesis = OffsetHypothesis(arm=ARM, site=Site.joint(joint), joints=(joint,))
    return Candidate.of(hypothesis, columns)


def changed(*changes: float) -> np.ndarray:
    """Return the residual of friction that changed by a part at each of the first joints."""
    return FRICTION * np.array([*changes, *[0.0] * (7 - len(changes))])


def beside(residual: np.ndarray, *selected: Candidate) -> FrictionChange:
    """Return by how much friction changed beside some causes."""
    return Beside(Choice(residual), selected).friction


def torque(shape: np.ndarray) -> np.ndarray:
    """Return a torque of some shape at the third joint."""
    return shape[:, None] * np.eye(7)[2]


def test_a_change_as_at_other_joints_is_explained_and_a_larger_one_is_not():
    day, effect = beside(changed(0.4, 0.4, 0.35)), "torque_offset"
    assert day.explains(effect, torque(0.35 * SIGN)).tolist() == [
        False, False, True, False, False, False, False,
    ]  # fmt: skip
    assert not day.explains(effect, torque(0.7 * SIGN)).any()
    assert not day.explains(effect, torque(np.full(SAMPLES, 0.35))).any()
    alone = beside(changed(0.0, 0.0, 0.35))
    assert not alone.explains(effect, torque(0.35 * SIGN)).any()


def test_what_another_cause_does_is_no_change_of_friction_elsewhere():
    """A cause at the first joint has as much of friction's shape as hides the change there."""
    cause = 2.0 * np.cos(np.arange(SAMPLES) / 7.0) - 0.4 * SIGN
    residual = changed(0.4, 0.0, 0.3)
    residual[:, 0] += cause
    effect, change = "torque_offset", torque(0.3 * SIGN)
    assert not beside(residual).explains(effect, change).any()
    assert beside(residual, offset(0, cause)).explains(effect, change)[2]


def test_more_is_expected_where_a_selected_cause_is_friction_that_changed():
    """For that did not change by just what the cause says; by no larger part than it changed."""
    assert beside(changed(0.4, 0.4, 0.35)).uncertain == pytest.approx(0.0)
    most = 0.3  # FRICTION_PART of a friction of 1
    day = beside(changed(0.4, 0.4, 0.35), offset(2, SIGN))
    assert day.uncertain == pytest.approx([0.0, 0.0, most, *4 * [0.0]])
    day = beside(changed(0.05, 0.05, 0.04), offset(2, SIGN))
    assert day.uncertain == pytest.approx([0.0, 0.0, 0.04, *4 * [0.0]])
