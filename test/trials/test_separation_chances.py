"""How often evidence is clear, and every cause as a file has it."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from support import MODEL_FILE
from unresolved_causes import passed

from dvrk_gravity import effects
from dvrk_gravity.diagnosis import FittedHypothesis
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.planning import STRONG, Prediction, TrueHypothesis

# Of two shapes whose sizes are uncertain, one of which may also be an offset.
COLUMNS = np.random.default_rng(0).normal(size=(40, 3))


ROOTS = np.diag([0.2, 0.0, 0.0]), np.diag([0.0, 0.5, 0.2])


MEANS = np.array([0.8, 0.0, 0.0]), np.array([0.0, 0.6, 0.3])


def between(columns: np.ndarray, before: float = 0.0) -> TrueHypothesis:
    gram = columns.T @ columns
    apart = MEANS[0] - MEANS[1]
    return TrueHypothesis(*(Prediction.of(gram, root) for root in ROOTS), apart, before)


@pytest.mark.parametrize("before", [0.0, -2.0, 2.0])
def test_the_chance_of_clear_evidence_is_how_often_fits_to_data_give_it(before):
    """Of fits as `diagnose` compares them: each cause as well as it can, near what was found."""
    random = np.random.default_rng(1)
    factors = MEANS[0] + random.normal(size=(20_000, 3)) @ ROOTS[0]
    drawn = factors @ COLUMNS.T + random.normal(size=(20_000, 40))
    misfit = []
    for root, mean in zip(ROOTS, MEANS, strict=True):
        left = drawn - COLUMNS @ mean
        spread = np.eye(40) + COLUMNS @ root**2 @ COLUMNS.T
        misfit.append(np.sum(left * np.linalg.solve(spread, left.T).T, axis=1))
    found = before + 0.5 * (misfit[1] - misfit[0])
    far = (factors - MEANS[1]) @ COLUMNS.T
    spread = np.eye(40) + COLUMNS @ ROOTS[1] ** 2 @ COLUMNS.T
    scatter = 1.64 * np.sqrt(np.sum(far * np.linalg.solve(spread, far.T).T, axis=1))
    clear = float(np.mean(found > np.maximum(STRONG, scatter)))
    chance = between(COLUMNS, before).chance(COLUMNS.T @ COLUMNS)
    assert 0.2 < clear < 0.9
    assert chance == pytest.approx(clear, abs=0.05)


def test_a_wide_spread_of_the_other_cause_is_no_evidence_against_it():
    """A fit is free within it, and pays nothing for what it does not use."""
    gram = COLUMNS.T @ COLUMNS
    near, wide = (
        replace(between(COLUMNS), other=Prediction.of(gram, size * ROOTS[1])) for size in (1.0, 1e3)
    )
    assert wide.expected_evidence(gram)[0] <= near.expected_evidence(gram)[0]
    assert wide.chance(gram) <= near.chance(gram)


def test_every_cause_that_is_written_is_read_again_with_the_same_torque():
    model = TorqueModel.load(MODEL_FILE)
    motion, seen = passed(model, 12, 0.2), set()
    every = (each for effect in effects.effects() for each in effect.hypotheses(motion))
    for hypothesis in every:
        size = hypothesis.regressor(motion).shape[2]
        before = FittedHypothesis(hypothesis, np.ones(size), np.eye(size))
        if not before.known_elsewhere:
            continue
        seen.add(hypothesis.effect)
        entry = json.loads(json.dumps(before.to_dict(), allow_nan=False))
        after = FittedHypothesis.from_dict(entry, model.arm, "pair")
        assert after.hypothesis.key == hypothesis.key
        np.testing.assert_array_equal(
            after.hypothesis.regressor(motion), hypothesis.regressor(motion), str(hypothesis)
        )
    assert {"payload", "elastic_cable", "base_tilt", "joint_offset", "torque_scale"} <= seen
