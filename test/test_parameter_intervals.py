"""Intervals of what is found hold what a model's known error can look like."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dvrk_gravity.arms.mtm import JOINT_NAMES
from dvrk_gravity.diagnosis.candidate import Candidate
from dvrk_gravity.diagnosis.cross_validation import CrossValidation
from dvrk_gravity.diagnosis.filtered_data import FilteredData
from dvrk_gravity.diagnosis.load import load
from dvrk_gravity.diagnosis.run import hypotheses
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
    validation = CrossValidation(data)
    return next(
        candidate
        for candidate in validation.candidates(hypotheses(data.motion))
        if candidate.hypothesis.effect == effect and candidate.acts[joint]
    )


@pytest.mark.parametrize(("effect", "joint"), [
    ("torque_offset", 0), ("coulomb_friction", 3), ("elastic_cable", 4), ("payload", 2),
])  # fmt: skip
def test_they_are_as_wide_as_estimates_scatter_when_the_known_error_looks_like_the_cause(
    data, effect, joint
):
    """Drawn are errors in the space of the cause's columns, joint by joint, and fitted."""
    candidate = first(data, effect, joint)
    validation = CrossValidation(data)
    part = validation.settings.coherent
    _, covariance = validation.fit([candidate])
    validation.settings = replace(validation.settings, coherent=0.0)
    _, without = validation.fit([candidate])
    random, scattered = np.random.default_rng(0), []
    shapes = []
    for columns in np.moveaxis(candidate.columns(), 1, 0):
        left, size, _ = np.linalg.svd(columns, full_matrices=False)
        shapes.append(left[:, size > 1e-9 * max(size[0], 1e-9)] * np.sqrt(len(columns)))
    for _ in range(400):
        error = np.stack(
            [
                part * known * shape @ random.normal(size=shape.shape[1])
                for known, shape in zip(KNOWN, shapes, strict=True)
            ],
            axis=1,
        )
        drawn = replace(data, residual=error)
        vars(drawn)["known_error"] = KNOWN
        fitted = CrossValidation(drawn)
        fitted.weight = validation.weight
        scattered.append(fitted.parameters([candidate]))
    seen = np.cov(np.array(scattered).T).reshape(covariance.shape)
    added = np.sqrt(np.diag(covariance - without))
    assert added == pytest.approx(np.sqrt(np.diag(seen)), rel=0.3)


def test_of_an_exact_model_they_are_those_of_the_noise(data):
    candidate = first(data, "torque_offset", 0)
    exact = replace(data)
    assert not exact.known_error.any()
    _, with_known = CrossValidation(data).fit([candidate])
    _, of_noise = CrossValidation(exact).fit([candidate])
    alike = CrossValidation(data).settings.coherent * KNOWN[0]
    assert np.sqrt(of_noise[0, 0]) < 0.2 * alike < alike < np.sqrt(with_known[0, 0])
