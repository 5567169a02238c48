"""What is inferred while the model's own parameters may be off, by closed forms."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from claims import N, claim, data, pool, problem
from diagnosed import ARM, INSERTION, PITCH, YAW

from dvrk_gravity.diagnosis import AtCalibration, CrossValidation, every_hypothesis, refined
from dvrk_gravity.effects import PushHypothesis, Site, WallHypothesis

SIGMA = 0.1  # N·m: what a standard deviation of the model's parameter makes of its torque
OFF = 5.0  # standard deviations
SAME = pool()[0]  # the claim whose torque is the model parameter's


def doubtful(torque: float, seed: int = 0) -> CrossValidation:
    """Return samples that hold some of the torque of the model's one uncertain parameter."""
    columns = SIGMA * SAME.columns()
    changed = problem({}, seed).data.residual + torque * SAME.columns()[..., 0]
    expectation = replace(data().expectation, columns=columns)
    samples = replace(data(), residual=changed, expectation=expectation)
    return CrossValidation.of(samples).weighted([])


@pytest.mark.parametrize("copies", [1.0, 3.0])
def test_a_parameter_of_the_model_counts_as_one_more_independent_sample(copies):
    """Of samples of which 2.5 count as one in each of the copies of a motion."""
    validation, other = doubtful(0.02), pool()[1]
    if copies > 1.0:
        again = SimpleNamespace(copies=copies)
        validation = replace(validation, data=replace(validation.data, repetition=again))
    choice = validation.choice
    weight = np.where(choice.usable, validation.weight, 0.0)[..., None]
    columns = np.concatenate([validation.data.model_columns, other.columns()], axis=2)
    design = (columns[choice.rows] * weight).reshape(-1, 2)
    target = (validation.data.residual[choice.rows] * weight[..., 0]).ravel()
    design = np.concatenate([design, [[np.sqrt(2.5 * copies), 0.0]]])  # the prior
    expected = np.linalg.lstsq(design, np.append(target, 0.0), rcond=None)[0]

    own, of_claim = validation.solution([other])

    assert [*own, *of_claim] == pytest.approx(expected, rel=1e-6)
    score = validation.score([other])
    assert score.negative_log_prior == pytest.approx(0.5 * expected[0] ** 2, rel=1e-6)


def test_a_cause_that_spares_the_model_a_move_gains_what_that_move_cost():
    """Both leave the same: half of the square of five standard deviations is the difference."""
    validation = doubtful(OFF * SIGMA)
    before, after = validation.score([]), validation.score([SAME])

    spared = 0.5 * OFF**2
    assert before.negative_log_prior == pytest.approx(spared, rel=0.05)
    assert after.negative_log_prior < 0.01 * spared
    assert after.likelihood - before.likelihood == pytest.approx(spared - SAME.cost, rel=0.1)
    dof = validation.significance.settings.dof  # known from so many: Student's
    student = 0.5 * (dof + 1.0) * np.log1p(2.0 * spared / dof)
    assert validation.gain(before, after, np.ones(N)) == pytest.approx(student, rel=0.1)
    assert validation.screen([], [SAME], 1) == [SAME]
    assert doubtful(0.5 * SIGMA).screen([], [SAME], 1) == []  # half a deviation costs an eighth


def test_what_is_screened_first_explains_most_with_the_model_s_moves_spared():
    """One claim explains a part of the noise, another one none, and neither the model's move."""
    validation = doubtful(OFF * SIGMA)
    noise = validation.data.residual[:, INSERTION]
    little = claim(INSERTION, "little", shape=np.convolve(noise, np.ones(3), "same"))
    other = claim(INSERTION, "none", shape=np.roll(noise, 40))

    assert validation.screen([], [other, little, SAME], 3) == [little, SAME]
    assert validation.screen([], [other, SAME], 2) == [SAME]


def test_the_model_s_torque_is_less_certain_the_less_a_motion_says_of_it():
    """One over its own and the samples' precision, and beside its own torque the prior's alone."""
    validation = doubtful(0.0)
    _, alone = validation.posterior([])
    _, beside = validation.posterior([SAME])

    square = (SIGMA * SAME.columns(validation.choice.rows)[:, YAW, 0]) ** 2
    precision = 1.0 + np.sum(square) * validation.weight[YAW] ** 2 / 2.5
    # Noise, too, is correlated by chance.
    assert alone[0, 0] == pytest.approx(1.0 / precision, rel=0.3)
    assert beside[0, 0] == pytest.approx(1.0, rel=0.3)


def test_what_came_once_is_not_expected_to_recur():
    at = {"arm": ARM, "site": Site.joint(YAW), "joints": (YAW,)}
    validation = problem({0: 0.3})
    push = validation.data.candidate(PushHypothesis(**at, setting={"start": 5.0, "end": 9.0}))
    shape = np.where(push.columns()[:, [YAW], 0] > 0.5, 0.3, 0.0) * np.eye(N)[YAW]
    kept = CrossValidation.of(replace(validation.data, residual=validation.data.residual + shape))

    assert AtCalibration(kept).misfit(push) is None


# Settings that are searched for.
WALL = WallHypothesis(arm=ARM, site=Site.joint(PITCH), side=1.0, setting={"position": 0.0})
PUSH = PushHypothesis(arm=ARM, site=Site.joint(PITCH), joints=(PITCH,))
LIGHT = np.array([0.1, 0.3, 0.3, 0.0])  # kg, and kg·m: farther away than a load can be
SEARCHED = {
    "contact": ([3.0], {"position": 0.31}, [{"position": 0.2}, {"position": 0.4}]),
    "for a while": ([0.5], {"start": 7.0, "end": 11.0}, [{"start": 6.7, "end": 11.4}]),
    "thermal_drift": ([1.0, 0.2], {"time_constant": 6.0}, [{"time_constant": 3.0}]),
    "stribeck_friction": ([0.3], {"velocity": 0.3}, [{"velocity": 0.16}, {"velocity": 0.6}]),
    "joint_offset": ([0.25], {"offset": 0.25}, [{"offset": 0.0}, {"offset": -0.3}]),
    "payload": (
        [0.5, 0.01, -0.015, 0.03], {"x": 0.02, "y": -0.03, "z": 0.06},
        [dict.fromkeys("xyz", 0.0), LIGHT],
    ),
}  # fmt: skip


@pytest.mark.parametrize("beside", [(), (pool()[0],)])
@pytest.mark.parametrize("effect", SEARCHED)
def test_a_search_ends_at_the_setting_that_is_there(effect, beside):
    """Wherever it begins, and beside another cause; a load that was held far away is released."""
    theta, setting, starts = SEARCHED[effect]
    cause = next(
        each for each in (WALL, PUSH, *every_hypothesis(data().motion))
        if effect in (each.effect, each.form) and each.site in (Site.joint(PITCH), Site.link(N - 1))
    )  # fmt: skip
    there = data().candidate(replace(cause, setting=setting))
    residual = there.columns() @ theta + 0.02 * problem({}).data.residual
    residual += sum(0.3 * each.columns()[..., 0] for each in beside)
    validation = CrossValidation.of(replace(data(), residual=residual)).weighted([])
    for start in starts:
        begun = cause.clamped(start) if start is LIGHT else replace(cause, setting=start)

        found = refined(validation, data().candidate(begun), beside)

        assert type(found.hypothesis) is type(cause)
        assert found.hypothesis.setting == pytest.approx(setting, rel=0.01)
        own = found.hypothesis.parameters(validation.parameters([*beside, found])[-len(theta) :])
        assert found.hypothesis.setting == pytest.approx(
            {name: own[name] for name in setting}, rel=1e-3
        )
