"""Which coefficients a model's posterior speaks of: those that its terms can hold."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import few_folds

from dvrk_gravity.arms import Arm
from dvrk_gravity.identification import held_by_terms, identify
from dvrk_gravity.model import Columns
from testing.world import COARSE, World


@pytest.fixture(scope="module")
def columns() -> Columns:
    arm = Arm.load("ecm")
    return Columns(arm, arm.lower, arm.upper)


def of(columns: Columns, effect: str) -> list[int]:
    return [i for i, column in enumerate(columns.columns) if column.effect == effect]


def test_an_element_that_a_term_does_not_have_is_no_parameter_of_the_model(columns):
    elements = of(columns, "presliding_hysteresis")
    theta = np.zeros(len(columns.columns))
    assert held_by_terms(columns, theta, elements) == []
    theta[elements[0]] = 0.1
    held = held_by_terms(columns, theta, elements)
    assert elements[0] in held
    assert len(held) < len(elements)
    for column in held:
        there = theta.copy()
        there[column] = 0.2
        sizes = [[len(term.theta) for term in columns.terms(at)] for at in (there, theta)]
        assert sizes[0] == sizes[1]


def test_friction_that_is_zero_is_a_parameter_all_the_same(columns):
    friction = of(columns, "coulomb_friction")
    theta = np.zeros(len(columns.columns))
    theta[friction[0]] = 0.1
    assert held_by_terms(columns, theta, friction) == friction


def test_a_recording_of_two_seconds_is_identified_with_a_posterior():
    world = World.draw(5, step=COARSE)
    with few_folds():
        fit = identify(world.record(1, 1, 3.0).between(0.0, 2.0), world.arm)
    assert fit.model.uncertainty is not None
