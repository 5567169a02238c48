"""Intervals of what is found hold what a model's known error can look like."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from diagnosed import ARM, model, moving

from dvrk_gravity.diagnosis import (
    Candidate,
    CrossValidation,
    FilteredData,
    estimates,
    every_hypothesis,
    load,
)
from dvrk_gravity.estimation import NORMAL_95

KNOWN = np.array([0.05, 0.04, 0.06, 0.01])  # N·m or N, RMS by joint
DRAWN = 200


@cache
def exact() -> FilteredData:
    motion = moving(0, 15.0)
    effort = model().torque(motion.q, motion.qd, motion.qdd)
    return FilteredData.of(load([motion.read(effort)], model()))


def knowing(own: int = 0) -> FilteredData:
    """Return data whose model knows an error, and is unsure of a constant at some joints."""
    data = exact()
    constants = 0.05 * np.eye(ARM.n)[:, :own] * np.ones((len(data.residual), 1, 1))
    expected = replace(data.expectation, known_error=KNOWN, columns=constants)
    return replace(data, expectation=expected)


def first(effect: str, joint: int) -> Candidate:
    data = CrossValidation.of(exact()).data
    return next(
        candidate
        for candidate in data.candidates(every_hypothesis(data.motion))
        if candidate.hypothesis.effect == effect and candidate.acts[joint]
    )


@pytest.mark.parametrize(
    ("effect", "joint", "own"),
    [("torque_offset", 0, 0), ("torque_offset", 0, 4), ("payload", 2, 4), ("time_delay", 0, 0)],
)
def test_they_are_as_wide_as_estimates_scatter_when_the_known_error_looks_like_the_cause(
    effect, joint, own
):
    """Drawn are errors in the shapes of the cause's columns, joint by joint, and fitted.

    What comes on late does so at all joints: of a delay one is drawn for all of them. Of a model
    that is not sure of its parameters these move along.
    """
    candidate, data = first(effect, joint), knowing(own)
    validation = CrossValidation.of(data)
    told = validation.significance
    incoherent = replace(told, settings=replace(told.settings, coherent=0.0))
    _, covariance = validation.fit([candidate])
    _, without = replace(validation, significance=incoherent).fit([candidate])
    columns, random, scattered = candidate.columns(), np.random.default_rng(0), []
    rms = np.sqrt(np.mean(columns**2, axis=0))
    shapes = columns / np.where(rms > 0.0, rms, np.inf)
    for _ in range(DRAWN):
        sizes = random.normal(size=(ARM.n, candidate.size))
        if effect == "time_delay":
            sizes[:] = sizes[0]
        error = told.settings.coherent * KNOWN * np.einsum("tnk,nk->tn", shapes, sizes)
        drawn = replace(data, residual=error)
        fitted = replace(CrossValidation.of(drawn), weight=validation.weight)
        scattered.append(fitted.parameters([candidate]))
    seen = np.cov(np.array(scattered).T).reshape(covariance.shape)
    added = np.sqrt(np.diag(covariance - without))
    assert added == pytest.approx(np.sqrt(np.diag(seen)), rel=0.3)


def test_that_of_a_time_constant_is_even_in_its_logarithm_and_never_below_zero():
    candidate = first("thermal_drift", 0)
    for spread in (0.01, 10.0, 1e300):
        told = estimates(candidate.hypothesis, np.ones(1), np.eye(1), {"time_constant": spread})
        constant = told["time_constant"]
        assert 0.0 < constant.low < constant.value < constant.high < np.inf
        assert constant.value**2 == pytest.approx(constant.low * constant.high)
        if spread < 0.1:
            width = constant.high - constant.low
            assert width == pytest.approx(2 * NORMAL_95 * spread, rel=1e-3)


def test_of_an_exact_model_they_are_those_of_the_noise():
    candidate = first("torque_offset", 0)
    assert not exact().known_error.any()
    _, of_noise = CrossValidation.of(exact()).fit([candidate])
    _, with_known = CrossValidation.of(knowing()).fit([candidate])
    coherent = CrossValidation.of(knowing()).significance.settings.coherent * KNOWN[0]
    assert np.sqrt(of_noise[0, 0]) < 0.4 * coherent < coherent < np.sqrt(with_known[0, 0])
