"""What is chosen, what stays and what is confirmed pass one measure."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from dvrk_gravity import effects
from dvrk_gravity.arms import JOINT_NAMES, Arm
from dvrk_gravity.diagnosis import (
    Candidate,
    CrossValidation,
    FilteredData,
    Gain,
    HeldOut,
    JudgementSettings,
    Multiplicity,
    Score,
    Selection,
    SelectionSettings,
    Unconfirmed,
    friction_change,
    like_changed_friction,
    load,
    most_parsimonious,
)
from dvrk_gravity.effects import (
    OffsetHypothesis,
    PayloadHypothesis,
    PushHypothesis,
    Site,
    ViscousHypothesis,
)
from dvrk_gravity.estimation import evidence
from dvrk_gravity.recording import Recording
from testing.world import World

ARM = Arm.load("mtmr")


def claim(searched: int = 1, form: str = "") -> Candidate:
    """Return a claim on joint 1, in one of several forms, the best of some that were searched."""
    hypothesis = OffsetHypothesis(
        arm=ARM, site=Site.joint(0), joints=(0,), form=form, n_comparisons=searched
    )
    columns = np.zeros((4, 7, 1))
    columns[:, 0] = 1.0
    return Candidate.of(hypothesis, columns)


class Scores:
    """A cross-validation in which every claim halves the error of its joint."""

    def __init__(self, p_value: float) -> None:
        self.weight = np.ones(7)
        self.known_error, self.model_size = np.zeros(7), 0
        self.data = SimpleNamespace(
            friction=np.zeros((4, 7)), known_error=self.known_error, torque_rms=np.zeros(7)
        )
        self._p_value = p_value

    def score(self, candidates) -> Score:
        rms = np.where(np.arange(7) == 0, 0.5 ** len(candidates), 1.0)
        return Score(np.zeros((4, 7)), rms, np.zeros(3), 100.0 * len(candidates), 0.0)

    def parameters(self, candidates) -> np.ndarray:
        return np.full(len(candidates), 0.1)

    def size(self, candidate, theta) -> np.ndarray:
        return np.zeros(7)

    def of_choice(self, values) -> np.ndarray:
        return values

    def inflation(self, error, torque) -> np.ndarray:
        return np.ones(7)

    def p_value(self, before, after, candidate, inflation, n_comparisons) -> float:
        return evidence.bonferroni(self._p_value, n_comparisons)

    def torque(self, candidate, theta) -> np.ndarray:
        return np.zeros((4, 7))

    def weighted(self, candidates, final=False) -> Scores:
        return self


@pytest.mark.parametrize(("searched", "p_value", "enough"), [
    (1, 0.9e-4 / 2, True), (1, 1.1e-4 / 2, False), (901, 0.9e-4 / 2, False), (901, 1e-5 / 2, True),
])  # fmt: skip
def test_what_is_searched_among_many_needs_as_much_to_stay_as_to_come(
    searched, p_value, enough, monkeypatch
):
    """Of a hundred causes one is the best, or that one is the best of 901 of its own."""
    candidate, others = claim(searched), [claim(form=f"form {i}") for i in range(99)]
    monkeypatch.setattr(Selection, "moves", lambda selection, state: selection.pool)
    selection = Selection(Scores(p_value), [candidate, *others], lambda line: None)
    coming = selection.evaluate(selection.at([]), candidate)
    of = 100 if searched == 1 else searched
    assert coming.p_value == pytest.approx(2 * of * p_value)
    assert coming.passes == enough
    assert selection.eliminate_backward([candidate]).candidates == ((candidate,) if enough else ())


def test_a_search_counts_once_whether_its_hypotheses_are_made_beforehand_or_found():
    first, second = claim(5), claim(form="another")
    assert Multiplicity.of([first]) == Multiplicity.of([first] * 5) == Multiplicity(0, 5)
    both = Multiplicity.of([first, second])
    assert (both.n_comparisons(first), both.n_comparisons(second)) == (10, 2)


def test_what_could_not_be_accepted_takes_no_place_from_what_could():
    """An offset of a tenth of a mN·m on a silent joint fits best, and is of no consequence."""
    model, random = World.draw(1).model(), np.random.default_rng(1)
    time = np.arange(0.0, 20.0, 0.01)
    q = 0.3 * np.sin(time[:, None] * (0.5 + 0.37 * np.arange(7)))
    qd = np.gradient(q, time, axis=0)
    effort = model.torque(q, qd) + np.array([0.1, *[1e-5] * 6]) * random.normal(size=q.shape)
    effort[:, 0] += 0.05
    effort[:, 6] += 1e-4
    recording = Recording(JOINT_NAMES, time, q, qd, effort)
    validation = CrossValidation.of(FilteredData.of(load([recording], model).motion))
    offsets = [
        validation.data.candidate(OffsetHypothesis(arm=ARM, site=Site.joint(i), joints=(i,)))
        for i in (0, 6)
    ]

    def first(least: float) -> list[tuple[int, ...]]:
        return [
            candidate.hypothesis.joints for candidate in validation.screen([], offsets, 1, least)
        ]

    assert first(0.0) == [(6,)]
    assert first(1e-3) == [(0,)]


def test_held_out_blocks_ask_for_the_level_of_the_choice_and_for_all_that_is_named(monkeypatch):
    assert JudgementSettings().alpha == SelectionSettings().alpha
    first, second, third = claim(), claim(), claim()
    gains = {
        id(first): Gain(0.5, 0.4, 0.6, 0.0032),
        id(second): Gain(0.5, 0.4, 0.6, 0.0049),
        id(third): Gain(0.02, 0.01, 0.03, 1e-6),
    }
    held_out = HeldOut.__new__(HeldOut)
    held_out.settings = JudgementSettings()
    monkeypatch.setattr(
        held_out, "_in_active_blocks",
        lambda chosen, candidate: Unconfirmed(
            candidate.hypothesis, "outer_yaw", gains[id(candidate)]
        ),
    )  # fmt: skip

    # All claims are whole.
    monkeypatch.setattr(held_out, "_shows", lambda chosen, candidate: True)

    def failed(*chosen: Candidate) -> list[Candidate]:
        return [candidate for _, candidate in held_out.unconfirmed(chosen)]

    assert failed(first, second) == []  # 2 * 0.0032, then 0.0049
    # Next to nothing is no finding, however certain; it counts among what is named.
    assert failed(first, second, third) == [third]
    gains[id(first)] = replace(gains[id(first)], p_value=0.0051)
    assert failed(first) == []
    gains[id(second)] = replace(gains[id(second)], p_value=0.0051)
    assert failed(first, second) == [first, second]


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


def test_a_joint_that_a_motor_hardly_rubs_lends_the_others_no_change():
    random = np.random.default_rng(0)
    friction = random.normal(size=(400, 7))
    most = friction_change(friction, 0.2 * friction)
    torque = np.zeros((400, 7))
    torque[:, 5] = 0.5 * friction[:, 5]  # of 0.4 that are expected
    torque[:, 6] = 0.01 * friction[:, 6]
    assert not like_changed_friction(torque, friction, most, of_friction=True).any()


def test_of_causes_with_as_few_parameters_the_best_is_told_or_a_commoner_one_hardly_worse():
    def told(*likelihoods: float) -> str:
        """Return which is taken of an offset, Coulomb friction and a payload's four parameters."""
        candidates = [*one_of_each()]
        pairs = list(zip(likelihoods, candidates, strict=True))
        best = max(likelihoods)
        equal = [pair for pair in pairs if pair[0] >= best - 40.0]
        return most_parsimonious(equal, clearly=3.0).hypothesis.effect

    def one_of_each() -> Iterator[Candidate]:
        at = {"arm": ARM, "site": Site.joint(0), "joints": (0,)}
        columns = np.ones((4, 7, 4))
        yield Candidate.of(OffsetHypothesis(**at), columns[..., :1])
        yield Candidate.of(ViscousHypothesis(**at), columns[..., :1])
        yield Candidate.of(PayloadHypothesis(arm=ARM, site=Site.link(0), joints=(0,)), columns)

    assert told(100.0, 102.0, 130.0) == commonest("torque_offset", "viscous_friction")
    assert told(100.0, 104.0, 130.0) == "viscous_friction"
    assert told(104.0, 100.0, 130.0) == "torque_offset"
    assert told(80.0, 80.0, 130.0) == "payload"


def commonest(*names: str) -> str:
    return min(names, key=effects.rank)


def test_an_error_of_poses_that_tell_no_noise_is_told_against_what_the_model_expects():
    """Static poses without directions: no noise is known, and none may become a NaN in a file."""
    from dvrk_gravity.arms import Arm
    from dvrk_gravity.diagnosis import unexplained_error

    finding = unexplained_error(Arm.load("ecm"), 2, 5.0, float("nan"), 3.0, "nothing")

    assert finding.parameters["rms"].value == 4.0
    assert "5.00 N RMS, 1.7 times the model's error at calibration" in finding.sentence


def test_a_push_is_as_large_as_while_it_pushes():
    """Two seconds of twenty: of all samples' RMS it would be a third."""
    model, random = World.draw(1).model(), np.random.default_rng(1)
    time = np.arange(0.0, 20.0, 0.01)
    q = 0.3 * np.sin(time[:, None] * (0.5 + 0.37 * np.arange(7)))
    qd = np.gradient(q, time, axis=0)
    effort = model.torque(q, qd) + 0.01 * random.normal(size=q.shape)
    recording = Recording(JOINT_NAMES, time, q, qd, effort)
    validation = CrossValidation.of(FilteredData.of(load([recording], model).motion))
    place = {"arm": ARM, "site": Site.joint(0), "joints": (0,)}
    push = PushHypothesis(**place, setting={"start": 9.0, "end": 11.0})
    bias = OffsetHypothesis(**place)

    sizes = [
        validation.size(candidate, np.array([0.2]))[0]
        for candidate in validation.data.candidates([push, bias])
    ]

    assert sizes == pytest.approx([0.2, 0.2], rel=0.1)
    least = np.full(7, 0.15)
    shown = replace(
        validation.data, residual=0.2 * validation.data.candidate(push).columns()[..., 0]
    )
    assert CrossValidation.of(shown).screen([], [validation.data.candidate(push)], 1, least)
    assert not CrossValidation.of(shown).screen([], [validation.data.candidate(bias)], 1, least)
