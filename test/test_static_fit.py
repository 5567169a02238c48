"""Static poses with a known truth come back as a model; real ones are predicted where unseen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conftest import first_slab
from known_poses import ARM, BETA, LOWER, NOISE, POSED, RECORDED, UPPER, grid, record, truth, worst

from dvrk_gravity.arms import JOINT_NAMES
from dvrk_gravity.effects import Range
from dvrk_gravity.errors import ConfigError, RecordingError
from dvrk_gravity.estimation import inner_slabs, slabs
from dvrk_gravity.identification import (
    Composition,
    Table,
    fit_model,
    fit_poses,
    fit_static,
    gravity_of,
    joint_columns,
    pose_identifiability,
    pose_uncertainty,
    predict_unseen,
    read_poses,
)
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Recording


def between(count: int = 3000, seed: int = 1) -> np.ndarray:
    """Return poses anywhere in the range of the grid."""
    return np.random.default_rng(seed).uniform(LOWER, UPPER, (count, 7))


@pytest.fixture(scope="module")
def fitted():
    return fit_static(record(truth(), grid(4)), ARM)


def test_poses_between_those_of_the_grid_are_predicted(fitted):
    assert worst(fitted.model, truth(), between()) < 0.75 * NOISE


def test_held_out_error_is_that_of_the_noise_and_of_what_three_positions_do_not_tell(fitted):
    for joint in POSED:
        name = JOINT_NAMES[joint]
        assert fitted.training[name].rmse == pytest.approx(NOISE, rel=0.05)
        assert 0.95 * NOISE < fitted.held_out[name].rmse < 5 * NOISE


def test_what_is_not_there_is_left_out(fitted):
    kept = [choice.term for choice in fitted.choices if choice.kept]
    assert kept == []
    assert fitted.model.term("held_load") is None
    assert any(not choice.kept for choice in fitted.choices)


def test_model_file_gives_the_same_torques(fitted, tmp_path):
    fitted.model.save(tmp_path / "model.yaml")
    loaded = TorqueModel.load(tmp_path / "model.yaml")
    assert worst(loaded, fitted.model, between()) < 1e-12


def test_what_the_poses_do_not_tell_is_said(fitted):
    statements = " ".join(fitted.identifiability.statements)
    assert "outer_yaw was posed at 0 deg only" in statements
    assert fitted.identifiability.rank < fitted.identifiability.columns


def test_shoulder_over_a_short_range_is_not_told_from_its_cable():
    q = grid(3)
    q[:, 1] = np.radians([-12.0, 5.0, 22.0])[slabs(q[:, 1])]
    poses, _ = read_poses(record(truth(), q), ARM, "joint")
    table = Table.of(poses, ARM)
    _, solution, _, weight = fit_poses(table, [Composition(((j,),), 0.1) for j in range(7)])
    spread = pose_uncertainty(table, solution, weight)
    statements = pose_identifiability(table, solution, spread).statements
    expected = "beta2 (arm_y) and directional_cable.positive.shoulder_pitch[0] cannot be separated"
    assert any(statement.startswith(expected) for statement in statements)


def test_parameters_of_gravity_lie_in_their_intervals(fitted):
    found = {p.name: p for p in fitted.parameters if p.name.startswith("beta")}
    assert len(found) == 10
    sure = [p for p in found.values() if p.identifiable]
    assert len(sure) >= 3
    # beta1 and beta2 stand for the shoulder's cable too, whose split a prior decides.
    for number, true in enumerate(BETA[2:], start=3):
        entry = next(p for name, p in found.items() if name.startswith(f"beta{number} "))
        width = entry.ci95[1] - entry.ci95[0]
        assert abs(entry.value - true) < max(width, 0.01)


def test_load_that_stiction_holds_is_found_and_predicted():
    held = truth(
        **{
            "held_load.orders": (0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 1, 1, 0, 0),
            "held_load.mean.elbow_pitch": (0.01, 0.03),
            "held_load.difference.elbow_pitch": (0.0, -0.02),
        }
    )
    with first_slab():
        fit = fit_static(record(held, grid(4)), ARM)
    kept = {choice.term for choice in fit.choices if choice.kept}
    assert kept == {
        "held_load elbow_pitch: function of wrist_platform",
        "held_load elbow_pitch: function of wrist_platform x wrist_pitch",
    }
    assert worst(fit.model, held, between()) < NOISE


def test_a_few_poses_where_the_arm_was_stuck_do_no_harm():
    recordings = record(truth(), grid(4))
    stuck = recordings[0].effort.copy()
    stuck[100:110, 4] = -0.26
    spoilt = [
        Recording(
            JOINT_NAMES, None, recording.position, effort=effort, direction=recording.direction
        )
        for recording, effort in zip(recordings, (stuck, recordings[1].effort), strict=True)
    ]
    with first_slab():
        fit = fit_static(spoilt, ARM)
    assert worst(fit.model, truth(), between()) < NOISE
    assert any("wrist_pitch: 10 of 2048 poses left out" in line for line in fit.handling)
    assert fit.model.torque(between())[:, 4].min() > -0.2


def anywhere(count: int = 100_000) -> np.ndarray:
    """Return poses in the arm's whole range, many with joints at a limit."""
    random = np.random.default_rng(2)
    q = random.uniform(ARM.lower, ARM.upper, (count, 7))
    q = np.where(random.random(q.shape) < 0.1, ARM.upper, q)
    return np.where(random.random(q.shape) < 0.1, ARM.lower, q)


def assert_nothing_invented(path, effort: np.ndarray, noise: np.ndarray) -> None:
    """Assert that a model in a file stays within what (N, 7) efforts showed, and their noise."""
    model = TorqueModel.load(path)
    q = anywhere()
    for direction in (None, np.ones(q.shape), -np.ones(q.shape)):
        torque = model.torque(q, direction=direction)
        assert (torque <= effort.max(axis=0) + noise).all()
        assert (torque >= effort.min(axis=0) - noise).all()


def test_real_poses_invent_no_torque_outside_their_range(measured_data, tmp_path):
    """Joints 1 and 7 were never posed; the others through a part of their range."""
    poses, _ = read_poses([Recording.load(measured_data / name) for name in RECORDED], ARM, "joint")
    model = fit_model(poses, ARM)
    model.save(tmp_path / "model.yaml")
    residual = poses.effort - model.torque(poses.q, direction=poses.direction)
    # The median's own spread: the poses at which the arm was stuck are in the data.
    noise = 1.4826 * np.median(np.abs(residual), axis=0)
    assert (noise < [0.008, 0.02, 0.015, 0.009, 0.006, 0.005, 0.001]).all(), noise
    assert_nothing_invented(tmp_path / "model.yaml", poses.effort, 1.05 * noise)


def test_no_torque_is_invented_outside_the_range(fitted, tmp_path):
    recordings = record(truth(), grid(4))
    fitted.model.save(tmp_path / "model.yaml")
    effort = np.concatenate([recording.effort for recording in recordings])
    assert_nothing_invented(tmp_path / "model.yaml", effort, np.full(7, 1.1 * NOISE))
    # Within the range the bound takes nothing away.
    bound = fitted.model.term("shown_torque")
    seen = [recording.rows(slice(None, None, 3)) for recording in recordings]
    for poses in seen:
        rest = sum(term.torque(state_of(poses)) for term in fitted.model.terms if term is not bound)
        changed = np.abs(rest - fitted.model.torque(poses.position, direction=poses.direction))
        assert changed.max() < 3 * NOISE


def state_of(recording: Recording):
    from dvrk_gravity.effects import State

    return State.of(recording.position, direction=recording.direction)


def test_actuator_coordinates_give_the_same_model(fitted):
    motors = [
        Recording(
            JOINT_NAMES,
            None,
            ARM.actuator_position(recording.position),
            effort=ARM.actuator_effort(recording.effort),
            direction=recording.direction,
            coordinates="actuator",
        )
        for recording in record(truth(), grid(4))
    ]
    with first_slab():
        fit = fit_static(motors, ARM, "actuator")
    assert worst(fit.model, fitted.model, between()) < 1e-6
    assert fit.coordinates == "actuator"
    np.testing.assert_allclose(fit.traces[0].measured, motors[0].effort, atol=1e-12)


def test_one_direction_gives_no_friction_and_says_so():
    with first_slab():
        fit = fit_static(record(truth(), grid(3))[:1], ARM)
    q = between(100)
    up = fit.model.torque(q, direction=np.ones(q.shape))
    down = fit.model.torque(q, direction=-np.ones(q.shape))
    np.testing.assert_allclose(up, down, atol=1e-12)
    assert any("approached from one direction only" in s for s in fit.identifiability.statements)


def test_directions_that_are_exchanged_are_warned_of_and_right_ones_are_not(fitted):
    exchanged = [
        replace(recording, direction=-recording.direction) for recording in record(truth(), grid(3))
    ]
    with first_slab():
        found = [w for w in fit_static(exchanged, ARM).warnings if w.kind == "effort_sign"]
    assert "shoulder_pitch" in [warning.joint for warning in found]
    assert "as if it drove the joint" in str(found[0])
    assert "effort_sign" not in [warning.kind for warning in fitted.warnings]


def test_efforts_that_are_all_zero_are_not_those_of_an_arm():
    nothing = [replace(r, effort=0.0 * r.effort) for r in record(truth(), grid(3))]
    with pytest.raises(RecordingError, match=r"efforts of .*elbow_pitch.* are all zero"):
        fit_static(nothing, ARM)


def test_too_few_poses_are_refused():
    with pytest.raises(RecordingError, match=r"holds 12 static poses, expected at least 20"):
        fit_static(
            [recording.rows(slice(0, 600, 100)) for recording in record(truth(), grid(4))], ARM
        )


def test_slabs_are_the_levels_of_a_grid_or_fifths_of_the_poses():
    q = grid(4)[:, 3]
    assert sorted(np.bincount(slabs(q))) == [256] * 4
    assert all((q[slabs(q) == k].std() < 1e-12) for k in range(4))
    anywhere = np.random.default_rng(0).uniform(0, 1, 1000)
    assert np.bincount(slabs(anywhere)).tolist() == [200] * 5


def test_inner_slabs_lie_between_others():
    poses, _ = read_poses(record(truth(), grid(4)), ARM, "joint")
    assert poses.moving == POSED
    for mask in inner_slabs(poses.q, poses.moving):
        inside = [
            poses.q[mask, j].min() > poses.q[~mask, j].min()
            and poses.q[mask, j].max() < poses.q[~mask, j].max()
            for j in POSED
        ]
        assert any(inside)


def test_functions_of_a_spring_are_a_sine_and_a_cosine():
    poses, _ = read_poses(record(truth(), grid(4)), ARM, "joint")
    columns = joint_columns(4, poses, gravity_of(ARM))
    matrix = columns.matrix(poses, Range(poses.lower, poses.upper))
    both = np.stack([np.sin(poses.q[:, 4]), np.cos(poses.q[:, 4])], axis=1)
    difference = matrix[:, : len(columns.own)][:, -2:] - both
    assert np.abs(difference).max() < 1e-6


HELD: dict[str, object] = {
    "arm": "mtmr",
    "held_load.orders": (0, 0, 0, 2, 1, 0, 0),
    "held_load.mean.elbow_pitch": (0.03,),
    "held_load.difference.elbow_pitch": (0.01,),
    "held_load.valid_lower": tuple(LOWER),
    "held_load.valid_upper": tuple(UPPER),
}


class TestHeldLoad:
    def test_is_a_product_of_chebyshev_polynomials_held_at_the_edges(self):
        model = TorqueModel.from_parameters(HELD)
        q = between(50)
        x = 2 * (q - LOWER)[:, 3:5] / (UPPER - LOWER)[3:5] - 1
        expected = 0.04 * (2 * x[:, 0] ** 2 - 1) * x[:, 1]
        np.testing.assert_allclose(model.torque(q, direction=np.ones(q.shape))[:, 2], expected)
        beyond = np.where(np.arange(7) == 3, 4.0, q)
        edge = np.where(np.arange(7) == 3, UPPER[3], q)
        np.testing.assert_allclose(model.torque(beyond), model.torque(edge))

    def test_is_zero_in_motion(self):
        model = TorqueModel.from_parameters(HELD)
        q = between(5)
        assert model.torque(q).any()
        assert not model.torque(q, np.full(q.shape, 0.1)).any()

    @pytest.mark.parametrize(
        ("name", "value", "says"),
        [
            ("held_load.orders", (1.0, 2.0), "7 for each function"),
            ("held_load.orders", (0.5, 0, 0, 0, 0, 0, 0), "whole numbers"),
            ("held_load.mean.elbow_pitch", (0.1, 0.2), "one for each function"),
            ("held_load.valid_upper", (), "a range that has edges"),
        ],
    )
    def test_wrong_values_are_refused(self, name, value, says):
        with pytest.raises(ConfigError, match=says):
            TorqueModel.from_parameters(HELD | {name: value})


def test_bounds_that_are_upside_down_are_refused():
    bounds = {"shown_torque.lower": (1.0,) * 7, "shown_torque.upper": (0.0,) * 7}
    with pytest.raises(ConfigError, match="at most upper"):
        TorqueModel.from_parameters({"arm": "mtmr"} | bounds)


def test_real_poses_are_predicted_at_positions_never_seen(measured_data):
    recordings = [Recording.load(measured_data / name) for name in RECORDED]
    poses, _ = read_poses(recordings, ARM, "joint")
    unseen = slabs(poses.q[:, 4]) == 2
    predicted = predict_unseen(poses, unseen, ARM)
    rmse = np.sqrt(np.mean((poses.effort[unseen] - predicted) ** 2, axis=0))
    # The last two are half of what a refit of the console's columns leaves: 14 and 7 mN·m.
    assert (rmse[1:6] < [0.020, 0.016, 0.009, 0.011, 0.005]).all(), rmse


@pytest.mark.slow
def test_real_poses_give_a_model_that_may_be_compensated_with(measured_data):
    """Poses at which wrist_pitch was stuck are no fault of the model."""
    rows = slice(None, None, 4)
    poses = [Recording.load(measured_data / name).rows(rows) for name in RECORDED]
    verdict = fit_static(poses, ARM).verdict
    assert verdict.level == "usable"
    assert {name for name, joint in verdict.joints.items() if joint.level == "good"} == {
        "shoulder_pitch", "elbow_pitch", "wrist_platform", "wrist_yaw"
    }  # fmt: skip


def test_real_poses_that_a_joint_was_stuck_at_are_left_out(measured_data):
    poses, _ = read_poses([Recording.load(measured_data / name) for name in RECORDED], ARM, "joint")
    rows = np.arange(len(poses)) % 2 == 0
    thinned = poses.rows(rows)
    model_error = predict_unseen(thinned, np.arange(len(thinned)) % 25 == 0, ARM)
    assert np.abs(model_error[:, 4]).max() < 0.1
