"""The estimator's parts against independent answers."""

from __future__ import annotations

import numpy as np
import pytest

from dvrk_gravity.arms import Arm, rigid_body
from dvrk_gravity.effects import State, base_directions, beta_map
from dvrk_gravity.estimation import NormalEquations, autocorrelated_scores, fit, sandwich
from dvrk_gravity.gravity import regressor as gravity_regressor
from dvrk_gravity.identification import Weighting, base_parameters, joint_errors
from dvrk_gravity.model import Columns

ARM = Arm.load("mtmr")


def test_silent_data_leave_a_coefficient_at_zero_and_loud_data_overrule_the_prior():
    random = np.random.default_rng(1)
    x = np.zeros((200, 7, 2))
    x[:, 0, 0] = random.normal(size=200)
    y = np.zeros((200, 7))
    y[:, 0] = 3.0 * x[:, 0, 0]
    moments = NormalEquations.of(x, y)
    solution = fit(moments, np.full(7, 1e6), np.ones(2), np.zeros(2, dtype=bool))
    assert solution.theta == pytest.approx([3.0, 0.0], abs=1e-6)


def test_intervals_hold_the_truth_although_every_fifth_sample_has_its_own_parameter():
    """The residual of the fit alone would hold it in 89 %, the held-out one alone in 98 %."""
    random = np.random.default_rng(12)
    count, parameters = 150, 30
    columns = random.normal(size=(count, parameters))
    x = np.zeros((count, 7, parameters))
    x[:, 0] = columns
    weight = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    block, part = np.arange(count) // 15, np.zeros(count, dtype=np.int64)
    hits = []
    for _ in range(100):
        truth = random.normal(size=parameters)
        y = np.zeros((count, 7))
        y[:, 0] = columns @ truth + random.normal(size=count)
        scale, signs = np.full(parameters, 1e3), np.zeros(parameters, dtype=bool)
        solution = fit(NormalEquations.of(x, y), weight, scale, signs)
        unseen = y.copy()
        for label in range(10):
            seen = block != label
            blind = fit(NormalEquations.of(x[seen], y[seen]), weight, scale, signs)
            unseen[~seen] -= x[~seen] @ blind.theta
        meat = autocorrelated_scores(
            x, y - x @ solution.theta, unseen, part, 50.0, weight, np.ones(y.shape, dtype=bool)
        )
        spread = sandwich(solution, meat)
        for k, unit in enumerate(np.eye(parameters)):
            low, high = spread.interval(solution.theta[k], unit)
            hits.append(low <= truth[k] <= high)
    assert 0.93 <= np.mean(hits) <= 0.97


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


def test_friction_that_data_would_make_negative_is_held_at_zero():
    random = np.random.default_rng(15)
    x = np.zeros((200, 7, 2))
    x[:, 0] = random.normal(size=(200, 2))
    y = np.zeros((200, 7))
    y[:, 0] = x[:, 0] @ [1.0, -0.2]
    solution = fit(NormalEquations.of(x, y), np.ones(7) * 1e4, np.ones(2),
                     np.array([False, True]))  # fmt: skip
    assert solution.theta[1] == 0.0
    assert not solution.free[1]
    assert solution.theta[0] == pytest.approx(1.0, abs=0.05)


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
    from dvrk_gravity.model import TorqueModel

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


def test_pseudo_inertia_of_a_sphere_is_positive_and_of_an_impossible_body_is_not():
    import pinocchio as pin

    from dvrk_gravity.identification import certificate, pseudo_inertia

    body = pin.Inertia.FromEllipsoid(0.7, 0.1, 0.2, 0.3)
    body.lever = np.array([0.1, -0.2, 0.05])
    row = body.toDynamicParameters()
    expected = pin.PseudoInertia.FromDynamicParameters(row).toMatrix()
    np.testing.assert_allclose(pseudo_inertia(row), expected, atol=1e-12)
    assert min(certificate(ARM, np.tile(row, 9)).values()) > 0.0
    row[0] = 0.01  # too light for where its first moment says it is
    assert max(certificate(ARM, np.tile(row, 9)).values()) < 0.0


def test_constrained_links_are_bodies_and_fit_data_of_such_bodies():
    import pinocchio as pin

    from dvrk_gravity.arms import BODIES as TREE_LINKS
    from dvrk_gravity.identification import certificate, physical_links

    columns = Columns(ARM, ARM.lower, ARM.upper)
    chosen = columns.select(effect="link_inertia")
    random = np.random.default_rng(11)
    links = []
    for _ in TREE_LINKS:
        body = pin.Inertia.FromSphere(random.uniform(0.1, 0.4), 0.08)
        body.lever = random.uniform(-0.05, 0.05, 3)
        links.append(body.toDynamicParameters())
    q, qd, qdd = random.normal(size=(3, 300, 7))
    full = rigid_body.regressor(ARM, q, qd, qdd, ARM.gravity)
    y = full @ np.ravel(links)
    x = full @ columns.base
    moments = NormalEquations.of(x, y + 0.01 * random.normal(size=y.shape))
    scale, positive = columns.scale[chosen], columns.positive[chosen]
    solution = fit(moments, np.full(7, 1e4), scale, positive)
    theta, found = physical_links(columns, chosen, solution)
    assert min(certificate(ARM, found).values()) > 0.0
    np.testing.assert_allclose(full @ found, x @ theta, atol=1e-9)
    assert np.sqrt(np.mean((full @ found - y) ** 2)) < 0.005
