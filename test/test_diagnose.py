"""The diagnosis from outside: files, formats, bad recordings, and what it must not do."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from dvrk_gravity import TorqueModel, diagnose
from dvrk_gravity.command_line import run
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.recording import Recording
from testing.hide import hide
from testing.world import COARSE, World

pytestmark = pytest.mark.usefixtures("brief_simulation")

KNOWN = World.draw(5, step=COARSE)


@pytest.fixture(scope="module")
def recording() -> Recording:
    """12 s of an arm with viscous friction that its model lacks."""
    world, _ = hide(KNOWN, "viscous_friction", np.random.default_rng(2))
    return world.record(3, 4, 12.0, 100.0)


@pytest.fixture(scope="module")
def files(recording, tmp_path_factory):
    """Folder with what the command wrote, and what it was given."""
    folder = tmp_path_factory.mktemp("diagnosis")
    recording.save(folder / "motion.csv")
    KNOWN.model().save(folder / "model.yaml")
    words = [str(folder / "motion.csv"), "--model", str(folder / "model.yaml")]
    assert run("dvrk_gravity.cli.diagnose", [*words, "--out", str(folder / "out")]) == 0
    return folder


def test_findings_have_the_documented_format(files):
    content = json.loads((files / "out" / "findings.json").read_text())

    assert content["format"] == 2
    assert content["verdict"] == "explained"
    (finding,) = content["findings"]
    assert finding["effect"] == "viscous_friction"
    (value,) = finding["parameters"].values()
    assert value["ci95"][0] <= value["value"] <= value["ci95"][1]
    assert value["unit"] == "N·m·s/rad"
    assert finding["gain"]["ci95"][0] <= finding["gain"]["relative"] <= finding["gain"]["ci95"][1]
    assert set(content["rmse"]) == {"before", "after", "floor", "model"}
    assert content["known"] == []  # the model does not tell how sure it is
    assert content["data"]["held_out"] < content["data"]["samples"]


def test_the_extended_model_loads_and_leaves_nothing_to_explain(files, recording):
    model = TorqueModel.load(files / "out" / "extended_model.yaml")

    assert diagnose(recording, model).verdict == "nothing_to_explain"


def test_the_report_is_complete_in_itself_and_begins_with_the_sentence(files):
    content = json.loads((files / "out" / "findings.json").read_text())
    page = (files / "out" / "report.html").read_text()

    assert not re.search(r"(src|href)=\"?(http|//)", page)
    assert "data:image/svg+xml;base64," in page
    assert page.index(content["findings"][0]["sentence"]) < page.index("<h2>")


@pytest.fixture(scope="module")
def diagnosed(recording):
    """Return what is found, the model that was given, and what it was before."""
    model = KNOWN.model()
    before = model.parameters()
    return diagnose(recording, model), model, before


def test_a_name_in_the_report_cannot_become_markup(diagnosed):
    from dvrk_gravity.report import diagnosis_page

    page = diagnosis_page(diagnosed[0], ["<script>alert(1)</script>.csv"])

    assert "<script>" not in page


def test_the_given_model_is_left_as_it_was(diagnosed):
    _, model, before = diagnosed

    assert model.parameters() == before


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda r: r.between(0.0, 5.0), "at least 8 s"),
        (lambda r: replace(r, effort=None), "no effort"),
        (lambda r: replace(r, position=np.zeros_like(r.position)), "no joint moves"),
        (lambda r: replace(r, time=None, velocity=None).rows(slice(0, 900, 30)), "at least 40"),
    ],
    ids=["short", "no effort", "no motion", "few poses"],
)
def test_a_recording_that_cannot_tell_says_what_is_missing(recording, change, words):
    with pytest.raises(RecordingError, match=words):
        diagnose(change(recording), KNOWN.model())


def test_a_bad_recording_ends_the_command_with_one_line_and_status_2(files, recording, capsys):
    recording.between(0.0, 5.0).save(files / "short.csv")

    words = [str(files / "short.csv"), "--model", str(files / "model.yaml")]
    status = run("dvrk_gravity.cli.diagnose", [*words, "--out", str(files / "short")])

    assert status == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not (files / "short").exists()
