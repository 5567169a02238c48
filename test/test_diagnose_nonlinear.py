"""Causes that are not linear, as nonlinear least squares has them; products of model and cause.

Weights that are known roughly, in a base that leans: their products are no sum of both.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from robots import UR5
from scipy.optimize import minimize_scalar

from dvrk_gravity.arms import Arm, gravity_in_base
from dvrk_gravity.diagnosis import (
    Candidate,
    CrossValidation,
    FilteredData,
    load,
    refined,
    relinearised,
    tangents,
)
from dvrk_gravity.effects import THE_ARM, BaseTilt, DelayHypothesis, Gravity, TorqueOffset
from dvrk_gravity.model import ModelUncertainty, TorqueModel
from dvrk_gravity.recording import LowPass, Recording

ARM = Arm.load(UR5)
MODEL = TorqueModel(ARM, TorqueModel.from_arm(ARM).terms)
DELAY, MISSED = 0.04, 0.5  # s; part of all that is faster than SLOW, which the model has too much
SLOW = 0.6  # Hz
LEANS = 0.3, -0.2  # rad, roll and pitch
NOISE = 0.02  # N·m


def leaning(model: TorqueModel, seed: int) -> Recording:
    """Return a motion in a base that leans of an arm whose masses are some others, drawn."""
    known, random = model.uncertainty, np.random.default_rng(seed)
    assert known is not None
    heavier = known.shift_terms(model.terms, random.normal(size=known.size))
    vector = gravity_in_base(*LEANS)
    terms = tuple(t if t.gravity_vector is None else t.with_gravity(vector) for t in heavier)
    time = np.arange(0.0, 20.0, 0.01)
    speed = 0.5 + 0.37 * np.arange(ARM.n)
    q = 0.8 * np.sin(speed * time[:, None]) + 0.3 * random.normal(size=ARM.n)
    qd = np.gradient(q, time, axis=0)
    effort = TorqueModel(ARM, terms).torque(q, qd, np.gradient(qd, time, axis=0))
    return Recording(
        ARM.joint_names, time, q, qd, effort + NOISE * random.normal(size=effort.shape)
    )


def told(seed: int) -> list[tuple[CrossValidation, list[Candidate]]]:
    """Return the tilt beside the model's parameters in a base that is level, and in the leaning."""
    model = TorqueModel.from_arm(ARM)
    motion = load([leaning(model, seed)], model)
    validation = CrossValidation.of(FilteredData.of(motion))
    tilt = validation.data.candidate(next(BaseTilt.hypotheses(motion)))
    level = [refined(validation, tilt, [])]
    validation = validation.weighted(level)
    return [(validation, level), relinearised(validation, level)]


def off(validation: CrossValidation, chosen: list[Candidate]) -> NDArray[np.float64]:
    """Return by how much roll and pitch are off, rad."""
    return np.abs(validation.parameters(chosen)[:2] - LEANS)


def left(validation: CrossValidation, chosen: list[Candidate]) -> float:
    """Return the greatest RMS that is left of a joint's effort, N·m."""
    return float(np.sqrt(np.mean(validation.residual(chosen) ** 2, axis=0)).max())


def test_where_errors_are_correlated_masses_move_less_for_what_counts_little():
    (validation, tilt), _ = told(0)
    with_it, without = validation.score(tilt), validation.score([])
    held = replace(validation, prior_inflation=10.0).score([])

    assert held.negative_log_prior < without.negative_log_prior
    # What they must be off by counts by itself: as Student's, for it was estimated.
    spared = without.negative_log_prior - with_it.negative_log_prior
    left = with_it.likelihood - without.likelihood - spared
    once = left + validation.significance.of_model(spared)
    assert validation.evidence(tilt, [], 1.0) == pytest.approx(once)
    assert validation.evidence(tilt, [], 10.0) == -validation.evidence([], tilt, 10.0) > 3.0


def test_a_tilt_is_exact_though_masses_are_off():
    level, at_tilt = told(1)

    assert off(*at_tilt).max() < 1e-3
    assert off(*at_tilt).max() < 0.5 * off(*level).max()
    # Of the white noise 8 of 50 Hz, and what differencing of positions does to accelerations.
    assert left(*at_tilt) < 0.4 * left(*level)


def test_a_large_tilt_s_columns_are_rebuilt_until_they_agree():
    """Without noise, and by a model that is exact: by secants alone, about ten steps."""
    model = TorqueModel.from_arm(ARM)
    q = np.random.default_rng(2).uniform(-1.0, 1.0, (60, ARM.n))
    vector = gravity_in_base(0.4, -0.3)
    terms = tuple(t if t.gravity_vector is None else t.with_gravity(vector) for t in model.terms)
    effort = TorqueModel(ARM, terms).torque(q)
    motion = load([Recording(ARM.joint_names, None, q, None, effort)], model)
    validation = CrossValidation.of(FilteredData.of(motion))
    tilt = validation.data.candidate(next(BaseTilt.hypotheses(motion)))
    found = refined(replace(validation, prior_inflation=1e-9), tilt, [])
    assert found.hypothesis.setting == pytest.approx({"roll": 0.4, "pitch": -0.3}, abs=3e-5)


def test_where_nothing_changes_what_the_model_says_nothing_changes():
    model = TorqueModel.from_arm(ARM)
    validation = CrossValidation.of(FilteredData.of(load([leaning(model, 0)], model)))
    assert relinearised(validation, []) == (validation, [])


def test_the_coefficients_that_beta_gains_in_a_base_that_leans_leave_the_others_uncertain():
    mtm, unknown = Arm.load("mtmr"), np.full(7, np.nan)
    known = ModelUncertainty(
        {Gravity.NAME: np.zeros(12)}, {Gravity.NAME: np.eye(12)}, np.zeros((7, 12)),
        np.zeros((3, 12)), unknown, np.nan, unknown, -np.ones(7), np.ones(7), unknown,
    )  # fmt: skip
    leaning_beta = [Gravity(mtm, np.zeros(14), mtm.gravity)]

    (moved,) = known.extended_to(leaning_beta).shift_terms(leaning_beta, np.arange(1.0, 13.0))

    np.testing.assert_array_equal(moved.theta, [*range(1, 13), 0.0, 0.0])


def shifted(values: NDArray[np.float64], time: NDArray[np.float64], delay: float):
    """Return (N, n) values a delay later."""
    return np.stack([np.interp(time - delay, time, column) for column in values.T], axis=1)


@pytest.fixture(scope="module")
def validation() -> CrossValidation:
    """Of an arm that takes less of what is fast than its model says, and efforts that are late."""
    time, random = np.arange(0.0, 30.0, 0.01), np.random.default_rng(0)
    slow, fast = 0.5 + 0.17 * np.arange(ARM.n), 5.0 + 0.7 * np.arange(ARM.n)
    q = np.sin(slow * time[:, None]) + 0.1 * np.sin(fast * time[:, None] + np.arange(ARM.n))
    qd = np.gradient(q, time, axis=0)
    torque = MODEL.torque(q, qd, np.gradient(qd, time, axis=0))
    taken = torque - MISSED * (torque - LowPass(SLOW, 100.0)(torque))
    effort = shifted(taken, time, DELAY) + 0.05 * random.normal(size=q.shape)
    recording = Recording(ARM.joint_names, time, q, qd, effort)
    return CrossValidation.of(FilteredData.of(load([recording], MODEL)))


def least_squares(validation: CrossValidation) -> float:
    """Return the delay of the model's torque that leaves least of the samples of choice, s."""
    data = validation.data
    measured = data.reduce(data.motion.effort)

    def cost(delay: float) -> float:
        late = data.reduce(shifted(data.motion.modelled, data.motion.time, delay))
        return float(np.sum((validation.of_choice(measured - late) * validation.weight) ** 2))

    return float(minimize_scalar(cost, bounds=(0.0, 0.2), method="bounded").x)


class Sharp(DelayHypothesis):
    """The model's torque as it is, late: in one form alone, that of :func:`least_squares`."""

    alternative_form = None


def by_secants(validation: CrossValidation) -> tuple[CrossValidation, Candidate]:
    """Return the delay at the setting that its own fit determines."""
    motion = validation.data.motion
    hypothesis = Sharp(arm=motion.arm, site=THE_ARM, setting={"delay": 0.0})
    found = refined(validation, validation.data.candidate(hypothesis), [])
    return validation.weighted([found]), found


def test_a_delay_is_that_of_least_squares_though_the_model_misses_what_is_fast(validation):
    validation, secants = by_secants(validation)
    there, (along,) = tangents(validation, [secants])
    (delay,), (by_secant,) = there.parameters([along]), validation.parameters([secants])

    assert delay == pytest.approx(least_squares(validation), rel=0.01)
    assert abs(delay - DELAY) < 0.5 * abs(by_secant - DELAY)


def test_what_is_linear_stays_as_it_is(validation):
    motion = validation.data.motion
    constant = validation.data.candidate(next(TorqueOffset.hypotheses(motion)))

    assert tangents(validation, [constant]) == (validation, [constant])
