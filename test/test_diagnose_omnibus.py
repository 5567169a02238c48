"""A name is not certain where any smooth function of the state explains what it leaves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dvrk_gravity.diagnosis import Diagnosis, diagnose
from testing.world import COARSE, World

pytestmark = pytest.mark.usefixtures("brief_simulation")

JOINT = 1
DRAG = 0.3  # N·m·s/rad


@pytest.fixture(scope="module")
def dragged():
    """Return what is found where drag differs by a part between the halves of a joint's range."""
    world = World.draw(5, step=COARSE)
    recording, model = world.record(3, 4, 20.0, 100.0), world.model()
    speed = np.gradient(recording.position[:, JOINT], recording.time)
    half = np.sign(recording.position[:, JOINT] - np.median(recording.position[:, JOINT]))

    def found(part: float) -> Diagnosis:
        effort = recording.effort.copy()
        effort[:, JOINT] += DRAG * speed * (1.0 + part * half)
        return diagnose(replace(recording, effort=effort), model)

    return found


@pytest.fixture(scope="module")
def uneven(dragged) -> Diagnosis:
    return dragged(0.6)


def test_drag_that_differs_over_the_range_is_perhaps_viscous_friction(uneven):
    finding = uneven.findings[0]

    assert (finding.effect, finding.joints) == ("viscous_friction", ("shoulder_pitch",))
    assert not finding.certain
    assert finding.sentence.startswith("perhaps ")
    assert "an error of shoulder_pitch remains that depends on its direction" in finding.sentence


def test_the_remedy_of_what_is_not_certain_is_another_motion(uneven):
    assert uneven.findings[0].remedy.startswith("record a motion that moves")


def test_drag_that_is_the_same_everywhere_is_certain(dragged):
    (finding,) = dragged(0.0).findings

    assert (finding.effect, finding.certain) == ("viscous_friction", True)
    assert finding.to_dict()["certainty"] == "certain"


def test_the_file_says_which_findings_are_not_certain(uneven):
    said = [finding["certainty"] for finding in uneven.to_dict()["findings"]]

    assert said == ["certain" if each.certain else "perhaps" for each in uneven.findings]
    assert said[0] == "perhaps"
