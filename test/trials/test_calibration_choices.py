"""What a calibration chooses: terms, and further motions."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
from finished_calibration import BRIEF, Finished, finished_calibration
from unresolved_causes import made_up, offset_or_spring, twins

from dvrk_gravity.identification import identify
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.planning import Plan


@pytest.fixture(scope="session")
def finished() -> Finished:
    return finished_calibration()


def test_less_gain_is_asked_of_a_term_the_more_terms_there_are(finished):
    bag = str(finished.folder / "motion")
    few, more = (identify(bag, finished.arm, least_gain=least) for least in (0.3, 0.0))
    kept = [sum(each.kept for each in fit.choices) for fit in (few, more)]
    assert kept[0] < kept[1]


@pytest.fixture
def further(finished, tmp_path):
    """Return what plans the first further motion, of other findings and with less friction."""
    folder = finished.before("plan further_1", tmp_path / "again")

    def plan(part: float = 1.0, following: str | None = None, unseparated=None, settings=BRIEF):
        left = {"next": following, **(unseparated or {"unseparated": {"groups": []}})}
        for name, change in (
            ("diagnosis_0.json", left),
            ("model_0.json", {"held": {"part": part, "least": "pitch"}}),
        ):
            content = json.loads((finished.folder / name).read_text())
            (folder / name).write_text(json.dumps(content | change))
        # What they contain is changed: the step is asked alone.
        return finished.take("plan further_1", folder, settings=settings, changed=True)

    return plan


@pytest.mark.parametrize("separable", [True, False])
def test_an_ambiguous_diagnosis_is_followed_by_the_motion_that_separates(
    finished, further, separable
):
    model = TorqueModel.load(finished.folder / "model_0.yaml")
    of = offset_or_spring(model, 1e-2) if separable else made_up(model, twins(model))
    content = of.content()
    content["unseparated"]["model"] = "model_0.yaml"
    asked, more = ("plan --separate", content), replace(BRIEF, search=20, further_duration=20.0)
    outcome = further(1.0, *asked, more)
    assert "pitch" in outcome.summary
    assert bool(outcome.paths) == separable
    if separable:
        assert Plan.load(outcome.paths[0]).duration == more.further_duration
    else:  # another motion is planned where friction may not hold the arm
        assert further(0.5, *asked).paths
