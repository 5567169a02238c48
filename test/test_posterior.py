"""What a posterior says of causes of known shapes: alternatives, doubts, what nothing explains."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from claims import N, claim, data, names, pool
from diagnosed import PITCH, ROLL, YAW, eye

from dvrk_gravity.diagnosis import Candidate, CrossValidation, Hypotheses, Posterior, infer

NOISE = 0.05 * np.random.default_rng(0).normal(size=data().residual.shape)
SHAPE = pool()[0].columns()[:, YAW, 0]
OTHER = pool()[8].columns()[:, YAW, 0]
BY_PITCH = np.sin(2.0 * data().reduce_state(data().motion.q)[:, PITCH])  # no claim's


@cache
def about() -> Hypotheses:
    return Hypotheses.about(data().motion)


def posterior(torque: np.ndarray, *claims: Candidate, noise: np.ndarray = NOISE) -> Posterior:
    """Return what is inferred from a (T,) torque at a joint beside noise, by some claims alone."""
    residual = noise + np.outer(torque, eye(YAW))
    validation = CrossValidation.of(replace(data(), residual=residual))
    context = replace(about().context, validation=validation, candidates=())
    return infer(replace(about(), context=context, pool=list(claims)))


def found(result: Posterior) -> set[str]:
    return names(effect.trial.candidate for effect in result.selected)


def test_what_looks_like_a_cause_is_its_alternative_and_what_overlaps_by_half_is_none():
    random = np.random.default_rng(1)
    twin = claim(YAW, "twin", shape=SHAPE + 0.02 * random.normal(size=len(SHAPE)))
    half = claim(YAW, "half", shape=SHAPE + OTHER)
    (effect,) = posterior(0.3 * SHAPE, pool()[0], half, twin).selected

    assert names([effect.trial.candidate]) == {"shape 0"}
    assert names(trial.candidate for trial in effect.alternatives) == {"twin"}
    assert effect.doubt == ("", "")


@pytest.mark.parametrize("rest", [0.05, 0.2])
def test_a_cause_is_uncertain_beside_a_third_of_its_torque_that_nothing_explains(rest):
    result = posterior(0.3 * SHAPE + rest * BY_PITCH, pool()[0])

    (effect,) = result.selected
    (unknown,) = result.unexplained
    assert unknown.candidate.hypothesis.form == "position of pitch"
    assert effect.doubt[0] == (
        "" if rest < 0.1 else
        "beside it an error of yaw remains that depends on the position of pitch"
    )  # fmt: skip


@pytest.mark.parametrize(("part", "kept"), [(0.7, False), (0.95, True)])
def test_a_cause_that_gains_half_of_what_a_function_would_is_withdrawn(part, kept):
    """It has so much of a torque that depends on a position, and as much of another one."""
    like, unlike = (each / each.std() for each in (BY_PITCH, SHAPE))
    shape = part * like + np.sqrt(1.0 - part**2) * unlike
    result = posterior(0.3 * like, claim(YAW, "partly", shape=shape))

    assert found(result) == ({"partly"} if kept else set())
    assert names(each.candidate for each in result.unexplained) == {"position of pitch"}


def test_what_the_samples_of_the_choice_alone_show_is_not_confirmed():
    seen = np.where(data().held_out, 0.0, 0.3 * SHAPE)
    result = posterior(seen, pool()[0])

    assert found(result) == set()
    (failed,) = result.unconfirmed
    assert (failed.hypothesis.form, failed.joint) == ("shape 0", "yaw")


def test_an_error_of_which_no_function_is_known_is_told_from_five_times_the_noise_on():
    """Noise could be as large where it is white; the other joints have as much as their efforts."""
    times = np.array([1.0, 1.0, 4.5, 5.5])
    white = np.random.default_rng(2).normal(size=data().residual.shape)
    floor = posterior(0.0 * SHAPE).floor
    noise = times * floor * white / white.std(axis=0)

    assert posterior(0.0 * SHAPE, noise=noise).unexplained_joints == (ROLL,)
    assert len(floor) == N
