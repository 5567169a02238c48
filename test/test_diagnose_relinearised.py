"""Weights that are known roughly, in a base that leans: their products are no sum of both."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from robots import UR5

from dvrk_gravity.arms import Arm, gravity_in_base
from dvrk_gravity.diagnosis import (
    Candidate,
    CrossValidation,
    FilteredData,
    load,
    refined,
    relinearised,
)
from dvrk_gravity.effects import BaseTilt, Gravity
from dvrk_gravity.model import ModelUncertainty, TorqueModel
from dvrk_gravity.recording import Recording

ARM = Arm.load(UR5)
LEANS = 0.3, -0.2  # rad, roll and pitch
NOISE = 0.02  # N·m


def leaning(model: TorqueModel, seed: int) -> Recording:
    """Return a motion in a base that leans of an arm whose masses are some others, drawn."""
    known, random = model.uncertainty, np.random.default_rng(seed)
    assert known is not None
    heavier = known.moved(model.terms, random.normal(size=known.size))
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
    model = TorqueModel.stated(ARM)
    motion = load([leaning(model, seed)], model).motion
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
    held = replace(validation, held=10.0).score([])

    assert held.negative_log_prior < without.negative_log_prior
    # What they must be off by counts by itself: as Student's, for it was estimated.
    spared = without.negative_log_prior - with_it.negative_log_prior
    left = with_it.likelihood - without.likelihood - spared
    once = left + validation.significance.of_model(spared)
    assert validation.evidence(tilt, [], 1.0) == pytest.approx(once)
    assert validation.evidence(tilt, [], 10.0) == -validation.evidence([], tilt, 10.0) > 3.0


@pytest.mark.parametrize("seed", range(3))
def test_a_tilt_is_exact_though_masses_are_off(seed):
    level, at_tilt = told(seed)

    assert off(*at_tilt).max() < 1e-3
    assert off(*at_tilt).max() < 0.5 * off(*level).max()
    # Of the white noise 8 of 50 Hz, and what differencing of positions does to accelerations.
    assert left(*at_tilt) < 0.4 * left(*level)


def test_where_nothing_changes_what_the_model_says_nothing_changes():
    model = TorqueModel.stated(ARM)
    validation = CrossValidation.of(FilteredData.of(load([leaning(model, 0)], model).motion))
    assert relinearised(validation, []) == (validation, [])


def test_the_coefficients_that_beta_gains_in_a_base_that_leans_leave_the_others_uncertain():
    mtm, unknown = Arm.load("mtmr"), np.full(7, np.nan)
    known = ModelUncertainty(
        {Gravity.NAME: np.zeros(12)}, {Gravity.NAME: np.eye(12)}, np.zeros((7, 12)),
        np.zeros((3, 12)), unknown, np.nan, unknown, -np.ones(7), np.ones(7), unknown,
    )  # fmt: skip
    leaning_beta = [Gravity(mtm, np.zeros(14), mtm.gravity)]

    (moved,) = known.of_longer(leaning_beta).moved(leaning_beta, np.arange(1.0, 13.0))

    np.testing.assert_array_equal(moved.theta, [*range(1, 13), 0.0, 0.0])
