"""Columns of a fit, weights of motors, and links that are bodies that can exist."""

from __future__ import annotations

from dataclasses import replace

import diagnosed
import fitted
import numpy as np
import pinocchio as pin
import pytest
from known_mtm import ARM

from dvrk_gravity.arms import rigid_body
from dvrk_gravity.effects import (
    State,
    assumed_rotors,
    base_directions,
    beta_map,
    prior_scale,
    separable_rotors,
)
from dvrk_gravity.estimation import NormalEquations, Solution, fit
from dvrk_gravity.gravity import regressor as gravity_regressor
from dvrk_gravity.identification import (
    Weighting,
    base_parameters,
    certificate,
    identify,
    joint_errors,
    physical_links,
    possible_links,
    pseudo_inertia,
)
from dvrk_gravity.model import Columns, TorqueModel
from dvrk_gravity.simulate import ModelArm


def least_eigenvalue(links: np.ndarray) -> float:
    """Return the least eigenvalue of all links' pseudo-inertias, by Pinocchio."""
    return min(
        np.linalg.eigvalsh(pin.PseudoInertia.FromDynamicParameters(row).toMatrix())[0]
        for row in np.reshape(links, (-1, 10))
    )


def test_links_are_bodies_by_default_and_the_held_out_error_is_that_of_a_free_fit():
    known = fitted.chain()
    free = identify([known.recording], known.arm, physical=False)
    assert set(known.fit.physical) == set(known.arm.body_names)
    assert min(known.fit.physical.values()) > 0.0
    assert least_eigenvalue(known.fit.model.term("link_inertia").links) > 0.0
    assert not free.physical
    errors = [np.mean([e.nrmse for e in each.held_out.values()]) for each in (known.fit, free)]
    assert errors[0] < 1.01 * errors[1]


def test_the_simulator_moves_an_identified_arm_as_it_is():
    assert ModelArm.of(fitted.chain().fit.model).inertia_error.max() < 1e-9


def test_a_saved_model_s_links_are_still_bodies_and_its_uncertainty_is_of_them(tmp_path):
    fitted.chain().fit.model.save(tmp_path / "m.yaml")
    loaded = TorqueModel.load(tmp_path / "m.yaml")
    assert least_eigenvalue(loaded.term("link_inertia").links) > 0.0
    assert loaded.uncertainty is not None
    assert loaded.uncertainty.fits(loaded.terms)


def test_pseudo_inertia_of_a_sphere_is_positive_and_of_an_impossible_body_is_not():
    body = pin.Inertia.FromEllipsoid(0.7, 0.1, 0.2, 0.3)
    body.lever = np.array([0.1, -0.2, 0.05])
    row = body.toDynamicParameters()
    expected = pin.PseudoInertia.FromDynamicParameters(row).toMatrix()
    np.testing.assert_allclose(pseudo_inertia(row), expected, atol=1e-12)
    assert min(certificate(ARM, np.tile(row, 9)).values()) > 0.0
    row[0] = 0.01  # too light for where its first moment says it is
    assert max(certificate(ARM, np.tile(row, 9)).values()) < 0.0


def drawn(masses: float, noise: float) -> tuple[Columns, list[int], Solution, np.ndarray]:
    """Return a fit to drawn spheres of some mass, kg, and the coefficients that are true."""
    columns = Columns(ARM, ARM.lower, ARM.upper)
    chosen = columns.select(effect="link_inertia")
    random = np.random.default_rng(5)
    rows = []
    for _ in ARM.body_names:
        body = pin.Inertia.FromSphere(masses, 0.08)
        body.lever = random.uniform(-0.03, 0.03, 3)
        rows.append(body.toDynamicParameters())
    q, qd, qdd = random.normal(size=(3, 200, 7))
    full = rigid_body.regressor(ARM, q, qd, qdd, ARM.gravity)
    y = full @ np.ravel(rows) + noise * random.normal(size=(200, 7))
    moments = NormalEquations.of(full @ columns.base, y)
    weight = np.full(7, max(noise, 1e-6) ** -2.0)
    solution = fit(moments, weight, columns.scale[chosen], columns.positive[chosen])
    true = (columns.base / prior_scale(ARM)[:, None] ** 2).T @ np.ravel(rows)
    return columns, chosen, solution, true


def test_a_fit_that_bodies_can_have_is_kept_exactly():
    columns, _, solution, _ = drawn(0.3, 1e-5)
    links = possible_links(columns, solution.theta)
    assert links is not None
    assert least_eigenvalue(links) > 0.0
    full = rigid_body.regressor(ARM, *np.random.default_rng(0).normal(size=(3, 50, 7)), ARM.gravity)
    np.testing.assert_allclose(full @ links, full @ columns.base @ solution.theta, atol=1e-11)


def test_a_fit_that_no_bodies_can_have_moves_no_farther_than_to_the_truth():
    columns, chosen, solution, true = drawn(0.01, 0.02)
    assert possible_links(columns, solution.theta) is None
    theta, links = physical_links(columns, chosen, solution)
    assert least_eigenvalue(links) > 0.0

    def distance(first: np.ndarray, second: np.ndarray) -> float:
        return float((first - second) @ solution.precision @ (first - second))

    assert 0.0 < distance(theta, solution.theta) < distance(true, solution.theta)
    # Towards the truth: bodies are a convex set, and a projection on it is no expansion.
    assert distance(theta, true) < distance(solution.theta, true)


def test_signs_hold_beside_bodies():
    """Friction and rotors of the nearest bodies are not negative."""
    columns, chosen, solution, _ = drawn(0.01, 0.02)
    more = replace(
        solution,
        theta=np.append(solution.theta, 1e-9),
        precision=np.pad(solution.precision, (0, 1)),
        data=np.pad(solution.data, (0, 1)),
        free=np.append(solution.free, True),
    )
    more.precision[-1, -1] = 1.0
    coupling = 0.3 * np.sqrt(np.diag(solution.precision)) / len(solution.theta)
    more.precision[-1, :-1] = more.precision[:-1, -1] = coupling
    signed = int(np.flatnonzero(columns.positive)[0])
    theta, _ = physical_links(columns, [*chosen, signed], more)
    assert theta[-1] >= 0.0


# --- weights, base parameters and columns -------------------------------------------------


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


@pytest.mark.parametrize("arm", [ARM, diagnosed.ARM])
def test_a_rotor_is_beside_links_where_torque_shows_it_apart_from_them(arm):
    """By the rank of the regressor with it; each takes the same part of its motor's effort."""
    q, qd, qdd = np.random.default_rng(7).normal(size=(3, 200, arm.n))
    full = rigid_body.regressor(arm, q, qd, qdd, arm.gravity).reshape(200 * arm.n, -1)
    full = full / np.maximum(np.linalg.norm(full, axis=0), 1e-9)
    rotors = [np.outer(qdd @ row, row).reshape(-1, 1) for row in arm.joint_to_actuator]
    ranks = [
        np.linalg.matrix_rank(np.hstack([full, *more]), tol=1e-6)
        for more in ([], *([rotor / np.linalg.norm(rotor)] for rotor in rotors))
    ]
    apart = np.flatnonzero(np.array(ranks[1:]) > ranks[0])
    assert separable_rotors(arm) == tuple(apart.tolist())
    travel = np.diag(arm.joint_to_actuator) * arm.scale
    part = assumed_rotors(arm) * travel / arm.actuator_effort_limit
    assert part == pytest.approx(np.full(arm.n, part[0]))


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
    for column in columns.select(effect="coulomb_friction") + columns.select(
        effect="stribeck_friction"
    ):
        theta[column] *= columns.columns[column].index == 2  # a site has one setting
    state = State(random.uniform(ARM.lower, ARM.upper, (30, 7)), *random.normal(size=(2, 30, 7)))
    model = TorqueModel(ARM, columns.terms(theta))
    columns = columns.with_terms(model.terms)
    at_motors = columns.regressor(state, columns.history(state)) @ theta
    np.testing.assert_allclose(ARM.actuator_effort(model.torque_at(state)), at_motors, atol=1e-9)


def test_error_measures():
    measured = np.array([[3.0, 0.0], [4.0, 0.0]])
    errors = joint_errors(("a", "b"), measured, np.array([[3.0, 1.0], [3.0, 0.0]]))
    assert errors["a"].rmse == pytest.approx(np.sqrt(0.5))
    assert errors["a"].nrmse == pytest.approx(1.0 / 5.0)
    assert errors["a"].r2 == pytest.approx(1.0 - 1.0 / 0.5)
    assert errors["b"].nrmse == 1.0
