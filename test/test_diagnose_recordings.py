"""Several recordings, files, formats, and what a diagnosis must not do."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from diagnosed import (
    NOISE,
    PITCH,
    ROLL,
    Motion,
    another,
    eye,
    identified,
    loaded,
    model,
    moving,
    only,
    recorded,
    seen,
)

from dvrk_gravity import TorqueModel, diagnose, evaluate
from dvrk_gravity.command_line import run
from dvrk_gravity.recording import Recording
from dvrk_gravity.report import diagnosis_page

MASS, COM = 0.5, (0.03, -0.02, 0.05)
DRAG = 0.05  # N·m·s/rad at roll


def dragging(motion: Motion) -> Recording:
    """Record an arm with viscous friction that its model lacks."""
    return motion.read(motion.torque() + DRAG * motion.qd[:, [ROLL]] * eye(ROLL))


def carrying(seed: int, mass: float, name: str) -> Recording:
    motion = moving(seed)
    return motion.read(motion.torque(loaded(mass, COM)), seed, source=f"/somewhere/{name}")


def test_a_load_that_is_hardly_another_one_in_both_is_one_load():
    found = only(diagnose([carrying(0, MASS, "a"), carrying(1, 1.01 * MASS, "b")], model()))

    assert found.parameters["mass"].value == pytest.approx(MASS, rel=0.02)
    assert found.left_out == ""


def test_an_average_of_two_loads_is_in_no_model():
    two = diagnose([carrying(0, MASS, "a"), carrying(1, 0.5 * MASS, "b")], model())

    (load,) = (each for each in two.findings if each.effect == "payload")
    assert load.left_out == "the recordings differ about it"
    assert two.model.parameters() == model().parameters()


def test_a_slow_recording_beside_a_fast_one_is_diagnosed_at_its_rate():
    fast, slow = carrying(0, MASS, "a"), carrying(1, MASS, "b").rows(slice(None, None, 4))
    found = only(diagnose([fast, slow], model()))
    assert found.parameters["mass"].value == pytest.approx(MASS, rel=0.05)


def test_a_warning_and_an_error_say_which_of_two_recordings_they_are_about():
    whole = replace(seen(another(3), 3), source="/somewhere/good.csv")
    worse = replace(seen(another(4), 4), source="/somewhere/bad.csv")
    effort = worse.effort.copy()
    effort[len(worse) // 2 :, PITCH] = effort[len(worse) // 2, PITCH]

    both = evaluate(identified().model, [whole, replace(worse, effort=effort)])

    frozen = [str(each) for each in both.warnings if each.kind == "effort_frozen"]
    assert [text.startswith("bad.csv: pitch: ") for text in frozen] == [True]
    assert list(both.recordings) == ["good.csv", "bad.csv"]
    alone = evaluate(identified().model, [whole]).joints
    for joint, error in both.recordings["good.csv"].items():
        assert error.rmse == pytest.approx(alone[joint].rmse, rel=1e-12)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Folder with what the command wrote, and what it was given."""
    folder = tmp_path_factory.mktemp("diagnosis")
    dragging(moving()).save(folder / "motion.csv")
    model().save(folder / "model.yaml")
    words = [str(folder / "motion.csv"), "--model", str(folder / "model.yaml")]
    assert run("dvrk_gravity.cli.diagnose", [*words, "--out", str(folder / "out")]) == 0
    return folder


def test_findings_have_the_documented_format(files):
    content = json.loads((files / "out" / "findings.json").read_text())

    assert content["format"] == 2
    assert content["verdict"] == "explained"
    (finding,) = content["findings"]
    assert (finding["effect"], finding["joints"]) == ("viscous_friction", ["roll"])
    value = finding["parameters"]["coefficient"]
    assert value["ci95"][0] <= DRAG <= value["ci95"][1]
    assert value["ci95"][0] <= value["value"] <= value["ci95"][1]
    assert value["unit"] == "N·m·s/rad"
    gain = finding["gain"]
    assert 0.0 < gain["ci95"][0] <= gain["relative"] <= gain["ci95"][1] < 1.0
    assert set(content["rmse"]) == {"before", "after", "floor", "model"}
    assert content["rmse"]["after"]["roll"] < 0.3 * content["rmse"]["before"]["roll"]
    assert content["known"] == []  # the model does not say how sure it is
    assert 0 < content["data"]["held_out"] < content["data"]["samples"]


def test_the_extended_model_loads_has_the_finding_and_leaves_nothing_to_explain(files):
    extended, motion = TorqueModel.load(files / "out" / "extended_model.yaml"), moving()

    more = extended.torque(motion.q, motion.qd) - model().torque(motion.q, motion.qd)

    np.testing.assert_allclose(more, DRAG * motion.qd * eye(ROLL), atol=0.1 * NOISE[ROLL])
    assert diagnose(dragging(moving(2)), extended).verdict == "nothing_to_explain"


def test_the_report_is_complete_in_itself_and_holds_the_finding(files):
    content = json.loads((files / "out" / "findings.json").read_text())
    page = (files / "out" / "report.html").read_text()

    assert not re.search(r"(src|href)=\"?(http|//)", page)
    assert "data:image/png;base64," in page
    assert page.index(content["findings"][0]["sentence"]) < page.index("<h2>")


def test_a_name_cannot_become_markup_and_the_given_model_is_left_as_it_was():
    given = replace(model())
    before = given.parameters()

    page = diagnosis_page(diagnose(recorded(), given), ["<script>alert(1)</script>.csv"])

    assert "<script>" not in page
    assert given.parameters() == before


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda r: r.between(0.0, 5.0), "at least 8 s"),
        (lambda r: replace(r, position=np.zeros_like(r.position)), "no joint moves"),
    ],
    ids=["short", "no motion"],
)
def test_a_bad_recording_ends_the_command_with_one_line_and_status_2(
    files, tmp_path, capsys, change, words
):
    change(recorded()).save(tmp_path / "bad.csv")

    arguments = [str(tmp_path / "bad.csv"), "--model", str(files / "model.yaml")]
    status = run("dvrk_gravity.cli.diagnose", [*arguments, "--out", str(tmp_path / "out")])

    error = capsys.readouterr().err
    assert status == 2
    assert words in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()
