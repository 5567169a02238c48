"""What acts in no block that is held out: told with that doubt where it is sure all the same."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import pytest

from dvrk_gravity.diagnosis import Diagnosis, diagnose
from dvrk_gravity.diagnosis.cross_validation import CrossValidation
from dvrk_gravity.diagnosis.filtered_data import FilteredData
from dvrk_gravity.diagnosis.held_out import HeldOut
from dvrk_gravity.diagnosis.load import load
from dvrk_gravity.effects.base import site
from dvrk_gravity.effects.contact import PushHypothesis
from dvrk_gravity.recording import Recording
from testing.world import World

WORLD = World.draw(3)
JOINT = 1
EDGE = 0.1  # s, that the low-pass smears


@pytest.fixture(scope="module")
def recording() -> Recording:
    return WORLD.record(1, 1)


@pytest.fixture(scope="module")
def between(recording) -> tuple[float, float]:
    """The longest piece of time in which nothing is held out, s, its edges taken off."""
    spans = FilteredData.of(load([recording], WORLD.model()).motion).held_out_spans
    begin, end = max(
        ((before[1], after[0]) for before, after in pairwise(spans)),
        key=lambda piece: piece[1] - piece[0],
    )
    return begin + EDGE, end - EDGE


def pushed(recording: Recording, between: tuple[float, float], torque: float) -> Diagnosis:
    begin, end = between
    inside = (recording.time >= begin) & (recording.time < end)
    effort = recording.effort.copy()
    effort[inside, JOINT] -= torque
    return diagnose(replace(recording, effort=effort), WORLD.model())


def test_a_clear_push_that_no_held_out_block_shows_is_told_with_that_doubt(recording, between):
    (found,) = pushed(recording, between, 0.3).findings

    assert (found.effect, found.certain) == ("contact", False)
    assert abs(found.parameters["torque"].value) == pytest.approx(0.3, rel=0.15)
    assert found.doubt == "it acts in no held-out block that could confirm it"
    assert found.doubt in found.sentence


@pytest.mark.parametrize("sure", [False, True])
def test_one_that_is_not_sure_is_left_out(recording, between, sure):
    validation = CrossValidation(FilteredData.of(load([recording], WORLD.model()).motion))
    begin, end = between
    push = validation.data.candidate(
        PushHypothesis(
            arm=WORLD.arm, site=site.joint(JOINT), joints=(JOINT,),
            setting={"start": begin, "end": end},
        )
    )  # fmt: skip

    failed = HeldOut(validation).unconfirmed([push], sure=lambda candidate: sure)

    assert [str(failure).split(":")[0] for failure, _ in failed] == (
        []
        if sure
        else ["chosen, but left out, for it acts in no held-out block that could confirm it"]
    )
