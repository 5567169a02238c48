"""Intervals of what is found hold what a model's known error can look like."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dvrk_gravity.arms import JOINT_NAMES
from dvrk_gravity.diagnosis import (
    Candidate,
    CrossValidation,
    FilteredData,
    estimates,
    hypotheses,
    load,
)
from dvrk_gravity.estimation import NORMAL_95
from dvrk_gravity.recording import Recording
from testing.world import World

NOISE = 1e-4  # N·m
KNOWN = np.array([0.05, 0.04, 0.03, 0.02, 0.01, 0.01, 0.005])  # N·m, RMS by joint


@pytest.fixture(scope="module")
def data() -> FilteredData:
    model, random = World.draw(1).model(), np.random.default_rng(1)
    time = np.arange(0.0, 20.0, 0.01)
    q = 0.3 * np.sin(time[:, None] * (0.5 + 0.37 * np.arange(7)))
    qd, noise = np.gradient(q, time, axis=0), NOISE * random.normal(size=q.shape)
    recording = Recording(JOINT_NAMES, time, q, qd, model.torque(q, qd) + noise)
    data = FilteredData.of(load([recording], model).motion)
    vars(data)["known_error"] = KNOWN
    return data


def first(data: FilteredData, effect: str, joint: int) -> Candidate:
    validation = CrossValidation.of(data)
    return next(
        candidate
        for candidate in validation.data.candidates(hypotheses(data.motion))
        if candidate.hypothesis.effect == effect and candidate.acts[joint]
    )


@pytest.mark.parametrize("sure", [True, False])
@pytest.mark.parametrize(("effect", "joint"), [
    ("torque_offset", 0), ("payload", 2), ("time_delay", 0),
    pytest.param("coulomb_friction", 3, marks=pytest.mark.slow),
    pytest.param("elastic_cable", 4, marks=pytest.mark.slow),
])  # fmt: skip
def test_they_are_as_wide_as_estimates_scatter_when_the_known_error_looks_like_the_cause(
    data, effect, joint, sure
):
    """Drawn are errors in the shapes of the cause's columns, joint by joint, and fitted.

    What comes on late does so at all joints: of a delay one is drawn for all of them. Of a model
    that is not sure of its parameters these move along: of a constant at every joint.
    """
    candidate = first(data, effect, joint)
    data = replace(data)
    vars(data)["known_error"] = KNOWN
    constants = 0.01 * np.eye(7) * np.ones((len(data.residual), 1, 1))
    vars(data)["model_columns"] = constants[:, :, : 0 if sure else 7]
    validation = CrossValidation.of(data)
    part = validation.significance.settings.coherent
    _, covariance = validation.fit([candidate])
    told = validation.significance
    incoherent = replace(told, settings=replace(told.settings, coherent=0.0))
    _, without = replace(validation, significance=incoherent).fit([candidate])
    random, scattered = np.random.default_rng(0), []
    size = np.sqrt(np.mean(candidate.columns() ** 2, axis=0))
    shapes = [
        columns[:, rms > 0.0] / rms[rms > 0.0]
        for columns, rms in zip(np.moveaxis(candidate.columns(), 1, 0), size, strict=True)
    ]
    for _ in range(400):
        sizes = random.normal(size=(len(KNOWN), candidate.size))
        if effect == "time_delay":
            sizes[:] = sizes[0]
        error = np.stack(
            [
                part * known * shape @ of_joint[: shape.shape[1]]
                for known, shape, of_joint in zip(KNOWN, shapes, sizes, strict=True)
            ],
            axis=1,
        )
        drawn = replace(data, residual=error)
        vars(drawn).update(known_error=KNOWN, model_columns=data.model_columns)
        fitted = replace(CrossValidation.of(drawn), weight=validation.weight)
        scattered.append(fitted.parameters([candidate]))
    seen = np.cov(np.array(scattered).T).reshape(covariance.shape)
    added = np.sqrt(np.diag(covariance - without))
    assert added == pytest.approx(np.sqrt(np.diag(seen)), rel=0.3)


@pytest.mark.parametrize("spread", [0.01, 10.0, 1e300])
def test_that_of_a_time_constant_is_even_in_its_logarithm_and_never_below_zero(data, spread):
    candidate = first(data, "thermal_drift", 0)
    told = estimates(candidate.hypothesis, np.ones(1), np.eye(1), {"time_constant": spread})
    constant = told["time_constant"]
    assert 0.0 < constant.low < constant.value < constant.high < np.inf
    assert constant.value**2 == pytest.approx(constant.low * constant.high)
    if spread < 0.1:
        assert constant.high - constant.low == pytest.approx(2 * NORMAL_95 * spread, rel=1e-3)


def test_of_an_exact_model_they_are_those_of_the_noise(data):
    candidate = first(data, "torque_offset", 0)
    exact = replace(data)
    assert not exact.known_error.any()
    _, with_known = CrossValidation.of(data).fit([candidate])
    _, of_noise = CrossValidation.of(exact).fit([candidate])
    coherent = CrossValidation.of(data).significance.settings.coherent * KNOWN[0]
    assert np.sqrt(of_noise[0, 0]) < 0.2 * coherent < coherent < np.sqrt(with_known[0, 0])
