"""What is chosen, kept and confirmed, on linear problems whose answer is known without it."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from claims import N, claim, data, names, pool, problem
from diagnosed import ARM, INSERTION, NOISE, PITCH, ROLL, YAW, eye, model, moving

from dvrk_gravity.diagnosis import (
    Candidate,
    CrossValidation,
    HeldOut,
    Multiplicity,
    RecurringMisfit,
    Selection,
    SelectionSettings,
    Significance,
    friction_change,
    like_changed_friction,
    load,
    most_parsimonious,
    unexplained_error,
)
from dvrk_gravity.effects import (
    JointOffset,
    OffsetHypothesis,
    PayloadHypothesis,
    PushHypothesis,
    Site,
    ViscousHypothesis,
)
from dvrk_gravity.errors import EffectError


def test_a_claim_costs_four_units_a_parameter_and_the_logarithm_of_its_search():
    assert claim(YAW).cost == pytest.approx(4.0)
    assert claim(YAW, searched=50).cost == pytest.approx(4.0 + np.log(50.0))


@pytest.mark.parametrize("frequency", [0.5, 2.0, 4.0])
def test_a_second_low_pass_makes_both_as_much_as_one_of_the_lower_band(frequency):
    """1 / (1 + (f / b)^4), here of two Hz, by the part that the first of eight Hz has left."""
    time = data().time
    sine = np.sin(2.0 * np.pi * frequency * time)[:, None] * np.ones(N)
    low = data().below(sine, 2.0)[len(time) // 4 : -len(time) // 4, 0]
    first = 1.0 / (1.0 + (frequency / data().band) ** 4)
    both = 1.0 / (1.0 + (frequency / 2.0) ** 4)
    assert np.sqrt(2.0) * low.std() == pytest.approx(both / first, abs=0.03)
    assert data().below(sine, 2.0 * data().band) is sine


# Fits.
def test_parameters_are_least_squares_of_the_samples_that_are_not_held_out():
    """Weighted by joint; those that are held out, whatever they say, change nothing."""
    validation = problem({0: 0.3, 4: -0.2, 1: 0.5})
    both = [pool()[0], pool()[4], pool()[1]]
    choice = validation.choice
    weight = np.where(choice.usable, validation.weight, 0.0).reshape(-1)
    design = np.concatenate([each.columns(choice.rows) for each in both], axis=2).reshape(-1, 3)
    target = validation.data.residual[choice.rows].reshape(-1)
    expected = np.linalg.lstsq(design * weight[:, None], target * weight, rcond=None)[0]

    assert validation.parameters(both) == pytest.approx(expected, rel=1e-6)
    other = validation.data.residual.copy()
    other[validation.data.held_out] += 10.0
    again = CrossValidation.of(replace(validation.data, residual=other))
    assert again.parameters(both) == pytest.approx(expected, rel=1e-6)


def test_a_score_is_of_errors_from_fits_that_left_their_fold_out():
    validation, both = problem({0: 0.3, 1: 0.5}), [pool()[0], pool()[1]]
    choice = validation.choice
    design = np.concatenate([each.columns(choice.rows) for each in both], axis=2)
    residual, weights = validation.data.residual[choice.rows], choice.usable * validation.weight
    expected = np.zeros_like(residual)
    for fold in choice.folds:
        rest = np.ones(len(residual), dtype=bool)
        rest[fold] = False
        x, y = (design * weights[..., None])[rest], (residual * weights)[rest]
        theta = np.linalg.lstsq(x.reshape(-1, 2), y.reshape(-1), rcond=None)[0]
        expected[fold] = residual[fold] - design[fold] @ theta

    error = validation.score(both).error

    np.testing.assert_allclose(
        np.where(choice.usable, error, 0.0), np.where(choice.usable, expected, 0.0), atol=1e-6
    )


def test_intervals_are_those_of_white_noise_where_nothing_else_is_there():
    """The standard deviation of a least-squares size: sigma over the root of sum x^2."""
    candidate, deviations, sizes = pool()[0], [], []
    for seed in range(20):
        theta, covariance = problem({0: 0.3}, seed).fit([candidate])
        sizes.append(theta[0])
        deviations.append(np.sqrt(covariance[0, 0]))
    validation = problem({0: 0.3})
    x = candidate.columns(validation.choice.rows)[:, 0, 0]
    expected = 0.05 / np.sqrt(np.sum(x**2))

    assert np.mean(sizes) == pytest.approx(0.3, abs=expected)
    assert np.mean(deviations) == pytest.approx(expected, rel=0.25)


def test_what_is_screened_is_in_the_order_of_what_each_explains_alone():
    validation = problem({0: 0.3, 4: 0.2, 8: 0.1})

    best = validation.screen([], pool(), 3)

    gains = {each.hypothesis.form: validation.score([each]).likelihood for each in pool()}
    assert best[0].hypothesis.form == max(gains, key=gains.__getitem__)
    assert names(best) <= {"shape 0", "shape 4", "shape 8"}


def test_what_could_not_be_accepted_takes_no_place_from_what_could():
    """A constant of a tenth of a mN·m on a silent joint fits best, and is of no consequence."""
    residual = np.array([0.1, 0.1, 0.1, 1e-5]) * np.random.default_rng(1).normal(
        size=data().residual.shape
    )
    residual += 0.05 * eye(YAW) + 1e-4 * eye(ROLL)
    validation = CrossValidation.of(replace(data(), residual=residual))
    both = [claim(YAW), claim(ROLL)]

    def first(least: float) -> list[tuple[int, ...]]:
        return [each.hypothesis.joints for each in validation.screen([], both, 1, least)]

    assert first(0.0) == [(ROLL,)]
    assert first(1e-3) == [(YAW,)]


# Choice.
def selection(validation: CrossValidation) -> Selection:
    return Selection(validation, pool(), lambda line: None)


def test_all_that_is_there_is_chosen_and_nothing_else():
    chosen = selection(problem({0: 0.3, 4: -0.2, 5: 0.15})).run().candidates

    assert names(chosen) >= {"shape 0", "shape 4", "shape 5"}
    assert len(chosen) == 3


def test_of_noise_nothing_is_chosen():
    for seed in range(8):
        assert selection(problem({}, seed)).run().candidates == (), seed


def test_what_another_one_explains_does_not_stay():
    """It came first, for it looks like both of those that are there."""
    validation = problem({0: 0.3, 4: 0.3})
    mixed = claim(YAW, "mixed", shape=sum(pool()[i].columns()[:, YAW, 0] for i in (0, 4)))
    kept = selection(validation).eliminate_backward([mixed, pool()[0], pool()[4]])

    assert len(kept.candidates) < 3
    left = validation.score(kept.candidates).rms[YAW]
    assert left == pytest.approx(0.05, rel=0.1)


def test_a_claim_stays_by_the_measure_by_which_it_comes():
    """Whatever its size: one that just came does not go at once, nor the other way round."""
    passed = []
    for size in (0.003, 0.006, 0.009, 0.012, 0.015, 0.2):
        choice, candidate = selection(problem({0: size})), pool()[0]
        coming = choice.evaluate(choice.at([]), candidate)
        stays = choice.eliminate_backward([candidate]).candidates
        assert stays == ((candidate,) if coming.passes else ()), size
        passed.append(coming.passes)
    assert (passed[0], passed[-1]) == (False, True)


def test_the_best_of_many_must_be_as_much_better():
    """Bonferroni's: half of the chance of an error for those that are searched, half for others."""
    first, second = claim(YAW, searched=5), claim(YAW, "another")
    assert Multiplicity.of([first]) == Multiplicity.of([first] * 5) == Multiplicity(0, 5)
    both = Multiplicity.of([first, second])
    assert (both.n_comparisons(first), both.n_comparisons(second)) == (10, 2)

    validation, inflation = problem({0: 0.02}), np.ones(N)
    before, after = validation.score([]), validation.score([pool()[0]])
    alone, best = (
        validation.p_value(before, after, pool()[0], inflation, count) for count in (1, 100)
    )
    assert 0.0 < alone < 1e-3
    assert best == pytest.approx(min(1.0, 100 * alone))


def test_of_causes_with_as_few_parameters_the_best_is_told_or_a_commoner_one_hardly_worse():
    at = {"arm": ARM, "site": Site.joint(0), "joints": (0,)}
    columns = np.ones((4, N, 4))
    offset = Candidate.of(OffsetHypothesis(**at), columns[..., :1])
    viscous = Candidate.of(ViscousHypothesis(**at), columns[..., :1])
    load_ = Candidate.of(PayloadHypothesis(arm=ARM, site=Site.link(0), joints=(0,)), columns)

    def told(*likelihoods: float) -> Candidate:
        pairs = list(zip(likelihoods, (offset, viscous, load_), strict=True))
        equal = [pair for pair in pairs if pair[0] >= max(likelihoods) - 40.0]
        return most_parsimonious(equal, clearly=3.0)

    assert told(100.0, 102.0, 130.0) is viscous  # commoner, and better
    assert told(102.0, 100.0, 130.0) is viscous  # commoner, and hardly worse
    assert told(104.0, 100.0, 130.0) is offset
    assert told(80.0, 80.0, 130.0) is load_


# Held-out blocks.
def test_a_gain_is_the_part_of_the_held_out_error_that_goes():
    validation, candidate = problem({0: 0.3}), pool()[0]
    held_out = HeldOut(validation)
    rows, theta = validation.data.held_out, validation.parameters([candidate])

    before, after = held_out.error([]), held_out.error([candidate])
    gain = held_out.gain(before, after, [YAW])

    left = validation.data.residual - candidate.columns() @ theta
    usable = validation.data.usable[rows][:, YAW]
    then, now = (
        np.sqrt(np.mean(values[rows][:, YAW][usable] ** 2))
        for values in (validation.data.residual, left)
    )
    assert gain.relative == pytest.approx(1.0 - now / then, rel=1e-6)
    assert gain.low < gain.relative < gain.high
    assert gain.p_value < 1e-3


def test_what_the_held_out_blocks_do_not_show_is_not_confirmed():
    validation, candidate = problem({0: 0.3, 1: 0.3}), pool()[0]
    without = validation.data.residual - np.where(
        validation.data.held_out[:, None], 0.3 * candidate.columns()[..., 0], 0.0
    )
    gone = CrossValidation.of(replace(validation.data, residual=without))
    both = [candidate, pool()[1]]

    assert HeldOut(validation).unconfirmed(both) == []
    ((failed, which),) = HeldOut(gone).unconfirmed(both)
    assert which is candidate
    assert (failed.joint, failed.gain.relative < 0.03) == ("yaw", True)
    assert HeldOut(gone).worse(both, HeldOut(gone).error([]), np.full(N, 0.05)) == [YAW]


def test_a_push_is_as_large_as_while_it_pushes():
    """Two seconds of twenty: of all samples' RMS it would be a third."""
    at = {"arm": ARM, "site": Site.joint(PITCH), "joints": (PITCH,)}
    validation = problem({})
    push = validation.data.candidate(PushHypothesis(**at, setting={"start": 9.0, "end": 11.0}))
    bias = validation.data.candidate(OffsetHypothesis(**at))

    sizes = [validation.size(each, np.array([0.2]))[PITCH] for each in (push, bias)]

    assert sizes == pytest.approx([0.2, 0.2], rel=0.1)


# What the model knows.
KNOWN = np.array([0.02, 0.01, 0.0])  # N·m; the last joint's is not known
SAMPLES = np.full(3, 100.0)
SIGNIFICANCE = Significance(
    SimpleNamespace(known_error=KNOWN, band=8.0, samples_per_independent=2.5)
)


def gain(before: float, after: float) -> list[float]:
    """Return the gains from one multiple of the known error (or of 1 mN·m) to another."""
    scale = np.where(KNOWN > 0.0, KNOWN, 1e-3)
    return SIGNIFICANCE.gain((before * scale) ** 2, (after * scale) ** 2, SAMPLES).tolist()


def test_an_error_that_falls_below_the_known_one_is_evidence_of_nothing():
    assert gain(1.0, 0.2)[:2] == [0.0, 0.0]
    assert gain(0.9, 0.3)[:2] == [0.0, 0.0]
    assert gain(2.0, 0.2) == pytest.approx([*gain(2.0, 1.0)[:2], 230.3], abs=0.1)


def test_an_error_beyond_the_known_one_is_and_where_none_is_known_every_gain():
    """By 100 samples of a variance that 30 others told: -65 ln(1 + 100 (4 - 1) / 130)."""
    first, second, unknown = gain(2.0, 1.0)
    assert first == second == pytest.approx(65.0 * np.log(1.0 + 300.0 / 130.0))
    assert unknown == pytest.approx(100.0 * np.log(2.0))
    assert gain(1.0, 2.0) == pytest.approx([-first, -second, -unknown])


def test_a_joint_whose_error_is_known_has_fewer_samples_that_count():
    """A part of it, 15 %, may look like any cause: 1 + 100 * 0.15² times the variance."""
    white = np.random.default_rng(0).normal(size=(4000, 3))
    assert SIGNIFICANCE.inflation(white, SAMPLES) == pytest.approx([3.25, 3.25, 1.0], abs=0.05)


def test_less_than_a_known_error_or_a_part_of_the_torque_does_not_matter():
    known = np.array([0.02, 0.01, 0.0, 1e-6])
    torque = np.array([1.0, 1.0, 1.0, 1.0])
    validation = SimpleNamespace(known_error=known, data=SimpleNamespace(torque_rms=torque))

    least = SelectionSettings().least(validation, np.array([0.0, 0.05, 0.0, 0.0]))

    assert least == pytest.approx([1.36 * 0.02, np.hypot(1.36 * 0.01, 0.05), 0.0, 0.003])


def test_of_what_recurs_the_part_that_is_no_more_than_expected_is_no_change():
    """By the distance from the nearest between nothing and all that is expected."""
    expected = RecurringMisfit(np.array([1.0, 0.0]), np.eye(2))

    def part(*theta: float) -> float:
        return expected.changed_fraction(np.array(theta), np.eye(2))

    assert part(1.0, 0.0) == part(0.5, 0.0) == pytest.approx(0.0, abs=1e-9)
    assert part(3.0, 0.0) == pytest.approx(4.0 / 9.0)
    assert part(-1.0, 0.0) == pytest.approx(1.0)
    assert part(1.0, 1.0) == pytest.approx(0.5)
    assert expected.spread == pytest.approx(np.array([[2.0, 0.0], [0.0, 1.0]]))


# Friction of another day.
def test_friction_is_told_where_it_did_not_change_as_much_at_other_joints():
    """A torque more than half of which is the model's friction times a factor, and no other."""
    random = np.random.default_rng(0)
    friction, other = random.normal(size=(400, 7)), random.normal(size=400)
    day = friction * [0.3, -0.3, 0.3, 0.4, 0.3, -0.3, 0.3]  # changed at all joints
    for factor, beside, error, like in (
        (0.4, 0.1, day, True), (0.6, 0.1, day, False), (0.4, 0.8, day, False),
        (0.4, 0.1, 0.1 * day, False), (0.05, 0.01, 0.1 * day, True),
    ):  # fmt: skip
        torque = np.zeros((400, 7))
        torque[:, 2] = factor * friction[:, 2] + beside * other
        said = like_changed_friction(torque, friction, friction_change(friction, error))
        assert said.tolist() == [False, False, like, False, False, False, False]


def test_friction_of_a_motor_may_change_in_any_shape_and_at_all_of_its_joints_together():
    random = np.random.default_rng(0)
    friction = random.normal(size=(400, 7)) * [1.0, 1.0, 1.0, 2.0, 1.0, 1.0, 0.1]
    day = 0.2 * friction
    most = friction_change(friction, day)
    torque = np.zeros((400, 7))
    torque[:, 5:] = 0.3 * random.normal(size=(400, 1)) * [1.0, 0.15]  # most where most rubs
    said = like_changed_friction(torque, friction, most, of_friction=True)
    assert said.tolist() == [False] * 7  # 1.5 times the little friction of the last joint
    torque[:, 6] /= 5.0
    said = like_changed_friction(torque, friction, most, of_friction=True)
    assert said.tolist() == [False] * 5 + [True, True]
    assert not like_changed_friction(torque, friction, most)[5:].any()  # of another shape
    little = friction_change(friction, 0.2 * day)
    assert not like_changed_friction(torque, friction, little, of_friction=True).any()


# Small ones.
def test_an_error_of_poses_that_show_no_noise_is_told_against_what_the_model_expects():
    """Static poses without directions: no noise is known, and none may become a NaN in a file."""
    finding = unexplained_error(ARM, INSERTION, 5.0, float("nan"), 3.0, "nothing")

    assert (finding.effect, finding.joints) == ("unknown", ("insertion",))
    assert finding.parameters["rms"].value == pytest.approx(4.0)  # the root of 25 - 9
    assert "1.7 times" in finding.sentence


@pytest.mark.parametrize("shape", [(5, N), (5, N + 1, 2), (5,)])
def test_columns_that_are_no_torques_of_the_joints_are_refused(shape):
    cause = OffsetHypothesis(arm=ARM, site=Site.joint(YAW))
    with pytest.raises(EffectError, match=r"returns shape .* expected \(N, 4, k\)"):
        Candidate.of(cause, np.ones(shape))
    assert Candidate.of(cause, np.ones((5, N, 2))).size == 2


def test_the_zero_of_a_joint_that_did_not_move_is_not_supposed():
    """A constant is all that it would show."""
    motion, moved = moving(), 1.0 - eye(INSERTION)
    still = replace(
        motion, q=np.where(moved > 0.0, motion.q, 0.1), qd=moved * motion.qd, qdd=moved * motion.qdd
    )
    recording = still.read(still.torque() + NOISE)

    supposed = {
        joint
        for hypothesis in JointOffset.hypotheses(load([recording], model()))
        for joint in hypothesis.joints
    }

    assert supposed == {YAW, PITCH, ROLL}
