"""A recording of the other arm: every verb says so first, and nobody compensates with it."""

from __future__ import annotations

import json
import re

from known_mtm import truth

from dvrk_gravity import TorqueModel, command_line

LEFT = TorqueModel.from_parameters({"arm": "mtml", "beta": (0.1,) * 10})


def test_a_recording_of_the_other_arm_has_status_1_from_every_verb_and_is_named_first(
    tmp_path, capsys
):
    """Each answers in its first line, and identify writes a model that no compensator takes."""
    recording, model = tmp_path / "right.csv", tmp_path / "left.yaml"
    truth(1, 12.0).save(recording)
    LEFT.save(model)
    words = "looks like a recording of mtmr, not mtml"
    out, evaluated = tmp_path / "model.yaml", tmp_path / "evaluated.html"
    for verb, options in (
        ("identify", ["--arm", "mtml", "--out", str(out), "--terms", "coulomb_friction"]),
        ("evaluate", ["--model", str(model), "--report", str(evaluated)]),
        ("diagnose", ["--model", str(model), "--out", str(tmp_path / "diagnosis")]),
    ):
        status = command_line.run(f"dvrk_gravity.cli.{verb}", [str(recording), *options])
        shown = capsys.readouterr().out
        assert status == 1, verb
        assert words in shown.splitlines()[0], verb
        assert shown.count(words) == 1, verb
    # Nor is such a recording diagnosed in depth, or advice given by what is found in it.
    assert "next: " not in shown
    diagnosed = json.loads((tmp_path / "diagnosis" / "findings.json").read_text())
    assert any("effects were not looked for" in note for note in diagnosed["notes"])
    assert {found["effect"] for found in diagnosed["findings"]} <= {"unknown"}
    assert TorqueModel.load(out).verdict == "do_not_compensate"
    assert words in TorqueModel.load(out).reason
    for report in (out.with_suffix(".html"), tmp_path / "diagnosis" / "report.html", evaluated):
        head = re.search(r"<h1[^>]*>(.*)</h1>", report.read_text())
        assert words in head[1]
