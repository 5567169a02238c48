"""Findings as a person reads them: signs in words, suitable units, no doubtful headline."""

from __future__ import annotations

import re
from dataclasses import dataclass

import known_ecm
import numpy as np
import pytest
from made_results import CLEAR, finding

from dvrk_gravity import effects
from dvrk_gravity.diagnosis import (
    FilteredData,
    Gain,
    effect_found,
    every_hypothesis,
    load,
    ordered,
    parameter_text,
)
from dvrk_gravity.effects import Estimate, Hypothesis, Meaning, Residual
from dvrk_gravity.units import fixed, percent, quantity

# Where a minus is a place or a direction, and no amount.
PLACES = ("roll", "pitch", "position", "lowest", "highest", "phase", "first_moment")


@pytest.mark.parametrize(
    ("value", "unit", "half", "expected"),
    [
        (0.00248, "N·m", 0.00023, "2.48 ± 0.23 mN·m"),
        (-21.0, "N·m", 4.3, "-21.0 ± 4.3 N·m"),
        (-1.78e-6, "N·m", 2.1e-6, "-1.8 ± 2.1 µN·m"),
        (0.145, "kg·m^2", 0.015, "0.145 ± 0.015 kg·m²"),
        (0.02, "kg·m^2", 0.001, "200 ± 10 kg·cm²"),
        (3.2e-5, "kg·m^2", 4e-6, "320 ± 40 g·cm²"),
        (0.21, "kg", 0.012, "210 ± 12 g"),
        (0.0042, "rad", 0.0013, "0.241 ± 0.074 deg"),
        (0.012, "s", 3e-4, "12.00 ± 0.30 ms"),
        (15.2, "s", 0.33, "15.20 ± 0.33 s"),
        (1.2, "N·m/rad", 0.22, "1.20 ± 0.22 N·m/rad"),
        (0.31, "N·m/rad^3", 0.0, "0.310 N·m/rad³"),
        (0.5, "N·m/rad^1", 0.0, "0.500 N·m/rad"),
        (0.4048, "N·m·s^2/rad^2", 0.0034, "0.4048 ± 0.0034 N·m·s²/rad²"),
        (1.0, "N·m", 1e-12, "1.00000 N·m"),
        (-1e-6, "rad", 0.01, "0.00 ± 0.57 deg"),
        (0.0, "N·m", 0.0, "0 N·m"),
        (1e85, "N·m", 0.0, "1e+85 N·m"),
    ],
)
def test_a_quantity_has_the_digits_of_its_interval_and_a_unit_of_its_size(
    value, unit, half, expected
):
    assert quantity(value, unit, half) == expected


@dataclass(frozen=True)
class Case:
    """A hypothesis, and how many parameters it is fitted with."""

    hypothesis: Hypothesis
    count: int

    def estimates(self, sign: float = 1.0, spread: float = 0.3) -> dict[str, Estimate]:
        """Return what a fit of 0.02 throughout is told as, with intervals of such a part."""
        theta = np.full(self.count, 0.02 * sign)
        return {
            name: Estimate(
                value, value - spread * abs(value), value + spread * abs(value),
                self.hypothesis.unit(name),
            )
            for name, value in self.hypothesis.parameters(theta).items()
            if self.hypothesis.meaning(name).reported
        }  # fmt: skip

    def sentence(self, sign: float = 1.0, spread: float = 0.3, gain: Gain = CLEAR) -> str:
        """Return the sentence of such a fit."""
        return effect_found(self.hypothesis, self.estimates(sign, spread), gain, ["pitch"])


@pytest.fixture(scope="module")
def every() -> list[Case]:
    """Return one hypothesis of each effect and form, as a diagnosis builds them."""
    motion = load([known_ecm.recorded(1, 9.0)], known_ecm.model())
    data = FilteredData.of(motion)
    noise = np.random.default_rng(0).normal(size=data.residual.shape)
    residual = Residual(data, noise, np.ones_like(noise), np.ones(len(noise), dtype=bool))
    found = [
        *every_hypothesis(motion),
        *(
            hypothesis
            for effect in effects.effects()
            for hypothesis in effect.search(effect.search_basis(data), residual)
        ),
    ]
    forms = {
        (
            hypothesis.effect,
            re.sub(r"\d| of \w+", "", hypothesis.place),
            len(hypothesis.joints),
        ): hypothesis
        for hypothesis in found
    }
    assert len({hypothesis.effect for hypothesis in forms.values()}) > 18
    return [
        Case(hypothesis, hypothesis.regressor(motion).shape[2]) for hypothesis in forms.values()
    ]


def of(every: list[Case], effect: str) -> Case:
    """Return the first case of an effect."""
    return next(case for case in every if case.hypothesis.effect == effect)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_no_effect_is_told_with_an_amount_below_zero_or_an_exponent(every, sign):
    cannot_be = (  # plausible() says so
        "payload", "stribeck_friction", "presliding_hysteresis", "torque_saturation",
        "joint_flexibility",
    )  # fmt: skip
    for case in every:
        effect, estimates = case.hypothesis.effect, case.estimates(sign)
        if effect in cannot_be and sign < 0.0:
            continue
        sentence = case.sentence(sign)
        assert not re.search(r"[{}]|\de[+-]?\d|lacks", sentence), sentence
        amounts = [
            parameter_text(effect, name, value)
            for name, value in estimates.items()
            if not name.startswith(PLACES) and not name[1:].isdigit()
        ]
        assert not [text for text in amounts if text.startswith("-")], (sentence, amounts)
        if not set(estimates) & set(PLACES):
            assert not re.search(r"-\d", sentence), sentence


SIGNS = {
    "viscous_friction": (" more ", " less "),
    "coulomb_friction": (" more ", " less "),
    "rotor_inertia": (" more ", " less "),
    "joint_offset": ("high", "low"),
    "torque_offset": ("high", "low"),
    "torque_scale": ("high", "low"),
    "time_delay": ("late", "early"),
    "thermal_drift": (" up ", " down "),
    "joint_coupling": ("", "opposite"),
    "joint_spring": (" more ", " less "),
    "encoder_scale": ("far", "short"),
}


def test_a_sign_is_told_in_words(every):
    for effect, (positive, negative) in SIGNS.items():
        case = of(every, effect)
        up, down = case.sentence(1.0), case.sentence(-1.0)
        assert positive in up, effect
        assert negative in down, effect
        assert negative not in up, effect


def test_friction_of_two_levels_is_more_or_less_by_both(every):
    friction = of(every, "coulomb_friction").hypothesis

    def told(*levels: float) -> str:
        estimates = (Estimate(level, level - 0.002, level + 0.002, "N·m") for level in levels)
        return friction.claim(dict(zip(("positive", "negative"), estimates, strict=True)))

    assert " more " in told(0.02, 0.03)
    assert " less " in told(-0.02, -0.03)
    for differs in ((0.02, -0.03), (0.02, 0.001)):  # of another sign, or perhaps none
        assert not re.search(r"has (more|less) ", told(*differs))


def test_what_a_motion_does_not_tell_of_a_payload_s_place_is_left_out(every):
    payload = of(every, "payload").hypothesis

    def place(**half: float) -> str:
        centre = {axis: Estimate(0.1, 0.1 - h, 0.1 + h, "m") for axis, h in half.items()}
        return payload.claim({"mass": Estimate(0.2, 0.19, 0.21, "kg"), **centre})

    assert place(x=0.01, y=0.01, z=0.01).count("100.0 ± 10.0 mm") == 3
    some = place(x=0.01, y=0.5, z=0.5)
    assert some.count("100.0 ± 10.0 mm") == 1
    assert "y and z" in some
    assert "mm" not in place(x=0.5, y=0.5, z=0.5)
    assert place(x=0.01, y=0.01, z=0.0).count("mm") == 2, "along an axis a mass has no torque"


def test_what_may_be_nothing_is_told_as_perhaps(every):
    case = of(every, "viscous_friction")
    assert "perhaps" not in case.sentence()
    assert "perhaps" in case.sentence(spread=1.5)
    around_zero = Estimate(0.01, -0.01, 0.03, "N·m")
    size, curve = (Meaning("N·m", 0.0, certain=certain) for certain in (False, True))
    assert ["perhaps" in each.in_words(around_zero) for each in (size, curve)] == [True, False]
    assert "-5 to 20 %" in case.sentence(gain=Gain(0.1, -0.05, 0.2, 0.04))


@pytest.mark.parametrize(
    ("size", "decimals", "text"),
    [(0.004, 2, "< 0.01"), (0.006, 2, "0.01"), (0.0, 2, "0.00"), (0.04, 1, "< 0.1"),
     (0.4, 0, "< 1"), (12.345, 2, "12.35")],
)  # fmt: skip
def test_a_size_that_is_not_zero_does_not_show_as_zero(size, decimals, text):
    assert fixed(size, decimals) == text


@pytest.mark.parametrize(
    ("estimate", "text"),
    [
        (Estimate(0.0123, 0.0119, 0.0127, "N·m"), "12.30 ± 0.40 mN·m more"),
        (Estimate(0.0123, 0.0119, 0.0187, "N·m"), "12.30 (11.90 to 18.70) mN·m more"),
        (Estimate(-0.0123, -0.0187, -0.0119, "N·m"), "12.30 (11.90 to 18.70) mN·m less"),
        (Estimate(-0.0123, -0.0187, 0.003, "N·m"), "perhaps 12.3 (-3.0 to 18.7) mN·m less"),
    ],
)
def test_an_interval_that_is_not_even_is_told_by_its_ends(estimate, text):
    assert estimate.signed(("more", "less")) == text


def test_the_headline_is_certain_where_any_finding_is_and_removes_most_of_these():
    clear, around_zero = Estimate(0.02, 0.01, 0.03, ""), Estimate(0.02, -0.01, 0.05, "")
    certain = finding("viscous_friction", clear, CLEAR)
    small = finding("viscous_friction", around_zero, CLEAR)
    weak = finding("viscous_friction", clear, Gain(0.1, -0.1, 0.2, 0.2))
    exact = finding("torque_scale", Estimate(1.1, 0.9, 1.3, ""), CLEAR, "factor")

    assert [finding.certain for finding in (certain, small, weak, exact)] == [True, *3 * [False]]
    assert certain.to_dict()["certainty"] == "certain"
    assert weak.to_dict()["certainty"] == "perhaps"
    more = finding("viscous_friction", clear, Gain(0.6, 0.5, 0.7, 0.001))
    assert ordered([weak, certain, more, small]) == [more, certain, small, weak]


def test_a_part_in_percent_is_never_a_power_of_ten():
    shown = [percent(part) for part in (0.0043, 0.25, 0.996, 2.21, -3.0)]
    assert shown == ["0.43 %", "25 %", "100 %", "221 %", "-300 %"]
