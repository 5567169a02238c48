"""Static poses with a known truth come back as a model that invents nothing elsewhere."""

from __future__ import annotations

from dataclasses import replace

import fitted
import numpy as np
import pytest
from known_poses import ARM, BETA, LOWER, NOISE, POSED, UPPER, between, grid, record, truth, worst

from dvrk_gravity.arms import JOINT_NAMES
from dvrk_gravity.errors import ConfigError, RecordingError
from dvrk_gravity.identification import Fit, fit_static, read_poses
from dvrk_gravity.model import TorqueModel


@pytest.fixture(scope="module")
def fit() -> Fit:
    return fitted.mtm_poses()


def test_poses_between_those_of_the_grid_are_predicted_also_by_the_model_file(fit, tmp_path):
    assert worst(fit.model, truth(), between()) < 0.75 * NOISE
    fit.model.save(tmp_path / "model.yaml")
    assert worst(TorqueModel.load(tmp_path / "model.yaml"), fit.model, between()) < 1e-12


def test_held_out_error_is_that_of_the_noise_and_of_what_three_positions_leave_open(fit):
    for joint in POSED:
        name = JOINT_NAMES[joint]
        assert fit.training[name].rmse == pytest.approx(NOISE, rel=0.05)
        assert 0.95 * NOISE < fit.held_out[name].rmse < 5 * NOISE


def test_what_is_not_there_is_left_out(fit):
    assert fit.choices
    assert not any(choice.kept for choice in fit.choices)
    assert fit.model.term("held_load") is None
    assert not [warning for warning in fit.warnings if warning.kind == "effort_sign"]


def test_what_poses_leave_open_is_counted_and_the_joint_that_was_not_moved_is_named(fit):
    assert any("outer_yaw" in each for each in fit.identifiability.statements)
    assert fit.identifiability.rank < fit.identifiability.columns
    assert fit.verdict.joints["shoulder_pitch"].level != "do_not_compensate"


def test_parameters_of_gravity_lie_in_their_intervals(fit):
    found = {p.name: p for p in fit.parameters if p.name.startswith("beta")}
    assert len(found) == 10
    assert sum(p.identifiable for p in found.values()) >= 3
    # beta1 and beta2 stand for the shoulder's cable too, whose split a prior decides.
    for number, true in enumerate(BETA[2:], start=3):
        entry = next(p for name, p in found.items() if name.startswith(f"beta{number} "))
        width = entry.ci95[1] - entry.ci95[0]
        assert abs(entry.value - true) < max(width, 0.01)


def test_no_torque_is_invented_outside_the_range(fit):
    effort = np.concatenate([each.effort for each in record(truth(), grid(4))])
    random, size = np.random.default_rng(2), (20_000, 7)
    q = random.uniform(ARM.lower, ARM.upper, size)  # many with joints at a limit
    q = np.where(random.random(size) < 0.1, ARM.upper, q)
    q = np.where(random.random(size) < 0.1, ARM.lower, q)
    for direction in (None, np.ones(size), -np.ones(size)):
        torque = fit.model.torque(q, direction=direction)
        assert (torque <= effort.max(axis=0) + 1.1 * NOISE).all()
        assert (torque >= effort.min(axis=0) - 1.1 * NOISE).all()


def test_a_load_that_stiction_holds_is_found_and_predicted():
    held = truth(
        **{
            "held_load.orders": (0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 1, 1, 0, 0),
            "held_load.mean.elbow_pitch": (0.01, 0.03),
            "held_load.difference.elbow_pitch": (0.0, -0.02),
        }
    )
    fit = fit_static(record(held, grid(4)), ARM)
    kept = {choice.term for choice in fit.choices if choice.kept}
    assert kept == {
        "held_load elbow_pitch: function of wrist_platform",
        "held_load elbow_pitch: function of wrist_platform x wrist_pitch",
    }
    assert worst(fit.model, held, between()) < NOISE


def test_actuator_coordinates_are_read_as_the_same_poses():
    joint = record(truth(), grid(3))
    motors = [
        replace(
            each, position=ARM.actuator_position(each.position),
            effort=ARM.actuator_effort(each.effort), coordinates="actuator",
        )
        for each in joint
    ]  # fmt: skip
    (found, _), (expected, _) = read_poses(motors, ARM, "actuator"), read_poses(joint, ARM, "joint")
    np.testing.assert_allclose(found.q, expected.q, atol=1e-12)
    np.testing.assert_allclose(found.effort, expected.effort, atol=1e-12)
    np.testing.assert_array_equal(found.direction, expected.direction)


def test_one_direction_gives_no_friction():
    one = fit_static(record(truth(), grid(3))[:1], ARM)
    q = between(100)
    up, down = (one.model.torque(q, direction=np.full(q.shape, way)) for way in (1.0, -1.0))
    np.testing.assert_allclose(up, down, atol=1e-12)


def test_poses_of_no_effort_or_too_few_are_refused():
    recordings = record(truth(), grid(3))
    with pytest.raises(RecordingError, match=r"efforts of .*elbow_pitch.* are all zero"):
        fit_static([replace(each, effort=0.0 * each.effort) for each in recordings], ARM)
    with pytest.raises(RecordingError, match=r"holds 12 static poses, expected at least 20"):
        fit_static([each.rows(slice(0, 240, 40)) for each in recordings], ARM)


# --- what poses are fitted with ----------------------------------------------------------

HELD: dict[str, object] = {
    "arm": "mtmr",
    "held_load.orders": (0, 0, 0, 2, 1, 0, 0),
    "held_load.mean.elbow_pitch": (0.03,),
    "held_load.difference.elbow_pitch": (0.01,),
    "held_load.valid_lower": tuple(LOWER),
    "held_load.valid_upper": tuple(UPPER),
}


def test_a_held_load_is_a_product_of_chebyshev_polynomials_held_at_the_edges_and_zero_in_motion():
    model = TorqueModel.from_parameters(HELD)
    q = between(50)
    x = 2 * (q - LOWER)[:, 3:5] / (UPPER - LOWER)[3:5] - 1
    expected = (2 * x[:, 0] ** 2 - 1) * x[:, 1]
    for way, size in ((1.0, 0.04), (-1.0, 0.02)):
        found = model.torque(q, direction=np.full(q.shape, way))[:, 2]
        np.testing.assert_allclose(found, size * expected)
    beyond = np.where(np.arange(7) == 3, 4.0, q)
    edge = np.where(np.arange(7) == 3, UPPER[3], q)
    np.testing.assert_allclose(model.torque(beyond), model.torque(edge))
    assert not model.torque(q, np.full(q.shape, 0.1)).any()


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"held_load.orders": (1.0, 2.0)}, "held_load.orders"),
        ({"held_load.orders": (0.5, 0, 0, 0, 0, 0, 0)}, "whole numbers"),
        ({"held_load.mean.elbow_pitch": (0.1, 0.2)}, "held_load.mean.elbow_pitch"),
        ({"held_load.valid_upper": ()}, "held_load.valid"),
        ({"shown_torque.lower": (1.0,) * 7, "shown_torque.upper": (0.0,) * 7}, "shown_torque"),
    ],
)
def test_wrong_values_are_refused(changes, says):
    with pytest.raises(ConfigError, match=says):
        TorqueModel.from_parameters(HELD | changes)
