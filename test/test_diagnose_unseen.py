"""What acts in no block that is held out: told with that doubt, if it comes back and is sure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from dvrk_gravity.diagnosis import Diagnosis, FilteredData, diagnose, load
from dvrk_gravity.recording import Recording
from testing.world import COARSE, World

pytestmark = pytest.mark.usefixtures("brief_simulation")

WORLD, JOINT = World.draw(3, step=COARSE), 1
BEGIN, END = 10.9, 12.0  # s: nothing is held out between
LIMIT = 0.59  # N·m: the joint takes more then, and never else
UNSEEN = "acts in no held-out block that could confirm it"
Changed = Callable[[NDArray[np.float64]], NDArray[np.float64]]


@pytest.fixture(scope="module")
def recording() -> Recording:
    return WORLD.record(11, 11)


def diagnosed(recording: Recording, change: Changed) -> Diagnosis:
    """Return what is found where one joint's effort in that time is another one."""
    inside = (recording.time > BEGIN + 0.1) & (recording.time < END - 0.1)
    effort = recording.effort.copy()
    effort[inside, JOINT] = change(effort[inside, JOINT])
    return diagnose(replace(recording, effort=effort), WORLD.model())


def test_in_that_time_nothing_is_held_out_and_the_joint_takes_most(recording):
    spans = FilteredData.of(load([recording], WORLD.model()).motion).held_out_spans
    assert not [span for span in spans if span[1] > BEGIN and span[0] < END]
    above = np.abs(recording.effort[:, JOINT]) > LIMIT
    assert above.any()
    assert np.all((recording.time[above] > BEGIN) & (recording.time[above] < END))


def test_an_effort_that_is_clipped_in_that_time_alone_is_told_with_that_doubt(recording):
    (found,) = diagnosed(recording, lambda effort: np.clip(effort, -LIMIT, LIMIT)).findings

    assert (found.effect, found.certain) == ("effort_saturation", False)
    assert found.parameters["limit"].value == pytest.approx(LIMIT, rel=0.01)
    assert found.doubt == f"it {UNSEEN}"
    assert found.doubt in found.sentence


def test_a_push_that_is_over_before_a_block_is_held_out_is_left_out_and_said_to_be(recording):
    """A joint that slips once looks so, and does not come back."""
    diagnosis = diagnosed(recording, lambda effort: effort - 0.1)

    assert not diagnosis.findings
    assert any(UNSEEN in note and "contact" in note for note in diagnosis.notes)
