"""The estimator's parts against independent answers."""

from __future__ import annotations

import numpy as np
import pytest

from dvrk_gravity.arms import Arm, rigid_body
from dvrk_gravity.effects import State, base_directions, beta_map
from dvrk_gravity.estimation import NormalEquations, fit
from dvrk_gravity.gravity import regressor as gravity_regressor
from dvrk_gravity.identification import Weighting, base_parameters, joint_errors
from dvrk_gravity.model import Columns, TorqueModel

ARM = Arm.load("mtmr")


def test_a_noisy_motor_does_not_spoil_what_a_quiet_one_tells():
    random = np.random.default_rng(14)
    x = np.zeros((400, 7, 1))
    x[:, :2, 0] = random.normal(size=(400, 2))
    noise = np.array([2.0, 0.01, 0.0, 0.0, 0.0, 0.0, 0.0])
    y = 0.7 * x[:, :, 0] + noise * random.normal(size=(400, 7))
    moments, signs = NormalEquations.of(x, y), np.zeros(1, dtype=bool)
    weighted = fit(moments, np.append(noise[:2] ** -2, np.ones(5)), np.ones(1), signs)
    unweighted = fit(moments, np.ones(7), np.ones(1), signs)
    assert abs(weighted.theta[0] - 0.7) < 0.002 < abs(unweighted.theta[0] - 0.7)


def test_a_motor_with_three_times_the_noise_counts_a_third():
    """Not a ninth: a correlated residual tells a variance only roughly."""
    random = np.random.default_rng(15)
    certainty, power = random.uniform(0.1, 10.0, (2, 7))
    noise, everyone = np.where(np.arange(7) == 5, 3.0, 1.0), np.ones((1, 7))
    quiet = Weighting(certainty, power, everyone).motor
    loud = Weighting(certainty / noise**2, power, everyone).motor
    ratio = quiet / loud
    assert ratio[5] / np.delete(ratio, 5) == pytest.approx(np.full(6, 3.0), rel=1e-12)
    # In other units of torque that motor counts the same.
    unit = np.where(np.arange(7) == 2, 1e3, 1.0)
    other = Weighting(certainty / unit**2, power * unit**2, everyone).motor
    assert other * unit**2 == pytest.approx(quiet, rel=1e-12)


def test_base_parameters_span_what_torque_depends_on():
    """The pivoted combinations, times their own regressor columns, give every torque."""
    q, qd, qdd = np.random.default_rng(7).normal(size=(3, 200, 7))
    full = rigid_body.regressor(ARM, q, qd, qdd, ARM.gravity).reshape(-1, 90)
    rank = np.linalg.matrix_rank(full, tol=1e-9 * np.linalg.norm(full))
    combinations = np.array([combination for _, _, combination in base_parameters(ARM)])
    assert len(combinations) == rank == base_directions(ARM).shape[1]
    # Every row of the regressor is a combination of them.
    residual = full - full @ np.linalg.pinv(combinations) @ combinations
    assert np.abs(residual).max() < 1e-6 * np.abs(full).max()


def test_beta_of_links_gives_their_weight():
    q = np.random.default_rng(8).uniform(ARM.lower, ARM.upper, (20, 7))
    links = np.random.default_rng(9).normal(size=90)
    weight = rigid_body.regressor(ARM, q, None, None, ARM.gravity) @ links
    beta = beta_map(ARM) @ links
    np.testing.assert_allclose(gravity_regressor(q, columns=12) @ beta, weight, atol=1e-9)


def test_columns_and_the_model_built_from_them_agree():
    columns = Columns(ARM, ARM.lower, ARM.upper)
    random = np.random.default_rng(10)
    theta = random.normal(size=len(columns.columns)) * columns.scale
    theta = np.where(columns.positive, np.abs(theta), theta)
    state = State(random.uniform(ARM.lower, ARM.upper, (30, 7)), *random.normal(size=(2, 30, 7)))
    model = TorqueModel(ARM, columns.terms(theta))
    at_motors = columns.regressor(state, columns.history(state)) @ theta
    np.testing.assert_allclose(ARM.actuator_effort(model.torque_at(state)), at_motors, atol=1e-9)


def test_error_measures():
    measured = np.array([[3.0, 0.0], [4.0, 0.0]])
    errors = joint_errors(("a", "b"), measured, np.array([[3.0, 1.0], [3.0, 0.0]]))
    assert errors["a"].rmse == pytest.approx(np.sqrt(0.5))
    assert errors["a"].nrmse == pytest.approx(1.0 / 5.0)
    assert errors["a"].r2 == pytest.approx(1.0 - 1.0 / 0.5)
    assert errors["b"].nrmse == 1.0
