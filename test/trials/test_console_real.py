"""The console's files of real arms: torques, round trips, and the answer to each."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
from console_files import assert_as_console, convert, repaired
from support import MODEL_FILE, REPOSITORY

from dvrk_gravity.console import ConsoleFile, Use, check_file
from dvrk_gravity.model import TorqueModel

DATA = Path(os.environ.get("DVRK_GRAVITY_DATA", REPOSITORY.parent / "shared" / "data")) / "gc_json"
REAL = sorted(DATA.glob("gc-*.json"))
pytestmark = pytest.mark.skipif(not REAL, reason=f"no console files in {DATA}")


def test_torques_of_real_files_equal_the_consoles_formula():
    for path in REAL:
        assert_as_console(json.loads(path.read_text()), ConsoleFile.load(path).model())


def test_real_files_become_models_whatever_their_limits_and_are_returned_exactly(tmp_path):
    for path in REAL:
        document = json.loads(path.read_text())
        assert convert(path, tmp_path / f"{path.stem}.yaml") == 0
        assert convert(tmp_path / f"{path.stem}.yaml", tmp_path / path.name) == 0
        back = json.loads((tmp_path / path.name).read_text())
        if document["version"] == "1.0":
            new = ("db_vel_vec", "sat_vec_vec", "fric_comp_ratio_vec")
            assert all(len(back["GC_controller"].pop(name)) == 7 for name in new)
            assert (document.pop("version"), back.pop("version")) == ("1.0", "2.0")
        assert back == document, path.name


def test_the_example_model_is_what_convert_makes_of_its_source(tmp_path):
    assert convert(DATA / "gc-MTMR-28002.json", tmp_path / "m.yaml") == 0
    ours = TorqueModel.load(MODEL_FILE)
    assert ours.parameters() == TorqueModel.load(tmp_path / "m.yaml").parameters()


REAL_USE = {
    "gc-MTML-22723": Use.REPAIR, "gc-MTML-34863": Use.NOT, "gc-MTML-41878": Use.REPAIR,
    "gc-MTMR-22403": Use.NOT, "gc-MTMR-28002": Use.REPAIR, "gc-MTMR-30924": Use.NOT,
    "gc-MTMR-32336": Use.NOT,
}  # fmt: skip


def test_the_real_files_are_answered_one_by_one(tmp_path):
    checked = {path.stem: check_file(path) for path in REAL}
    assert {name: each.answer.use for name, each in checked.items()} == REAL_USE
    for path in REAL:
        if REAL_USE[path.stem] is Use.REPAIR:
            assert check_file(repaired(path, tmp_path)).answer.use is Use.USABLE
    found = {name: {(f.code, f.subject) for f in each.findings} for name, each in checked.items()}
    assert {("other_hand", "beta6"), ("other_hand", "wrist_platform")} <= found["gc-MTMR-22403"]
    others = {name: codes for name, codes in found.items() if name != "gc-MTMR-22403"}
    assert not any(code == "other_hand" for codes in others.values() for code, _ in codes)
    assert ("limits_clip", "shoulder_pitch") in found["gc-MTMR-28002"]
    assert ("limits_beyond_actuator", "wrist_roll") in found["gc-MTML-41878"]
    assert ("other_data", "MTM_data_path") in found["gc-MTML-41878"]
