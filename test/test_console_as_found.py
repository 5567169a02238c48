"""The console's files as people have them: what its reader takes, other files, and what to do."""

from __future__ import annotations

import json

import pytest
from test_console import (
    BAD_FIELDS,
    FAULTS,
    REAL,
    both_sides,
    convert,
    limits,
    needs_data,
    position_range,
    scaled_gravity,
    synthetic,
    write,
)

from dvrk_gravity.__main__ import main
from dvrk_gravity.console import ConsoleFile, Use, check_file
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.model import TorqueModel

NAME = "gc-MTMR-12345.json"
HEAD = "/* -*- Mode: Javascript; tab-width: 4; -*- */\n"


def text(document=None) -> str:
    return json.dumps(document or synthetic(), indent=1)


def on(folder, content, name=NAME):
    path = folder / name
    path.write_text(content, encoding="utf-8")
    return path


# --- what the console reads ------------------------------------------------------------------

# What its reader takes, and whether the check warns of it.
READ = {
    "comment on top": (lambda plain: HEAD + plain, False),
    "comments at the ends of lines": (
        lambda plain: plain.replace(",\n", ', // see "log"\n'), False,
    ),
    "comment with an address in a text": (
        lambda plain: plain.replace('"SN"', '/* , */ "url": "http://a.b/*c*/", "SN"'), False,
    ),
    "byte order mark": (lambda plain: "\ufeff" + plain, False),
    "key twice": (lambda plain: plain.replace("{", '{"version": "1.0",', 1), True),
    "more behind the object": (lambda plain: plain + "\n}\n", True),
    "version a number": (lambda plain: plain.replace('"version": "2.0"', '"version": 2'), False),
    "version with words": (
        lambda plain: plain.replace('"version": "2.0"', '"version": " 2.1 of May"'), False,
    ),
    "numbers that end in a point": (lambda plain: plain.replace("0.02,", "2.e-2,"), False),
    "numbers with a zero before": (lambda plain: plain.replace("-40,", "-040.,"), False),
    "fields of other tools": (lambda plain: plain.replace("{", '{"tools": [null, {}],', 1), False),
    "no arm and no serial number": (
        lambda plain: plain.replace('"ARM_NAME": "MTMR",', "").replace('"SN": "12345",', ""), False,
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", READ)
def test_what_the_console_reads_is_read(case, tmp_path):
    change, warned = READ[case]
    content = change(text())
    assert content != text()
    path = on(tmp_path, content)
    found = ConsoleFile.load(path)
    expected = ConsoleFile.from_document(synthetic())
    assert (found.arm, found.version) == ("mtmr", 2)
    assert (found.positive == expected.positive).all()
    assert (found.dead_band == expected.dead_band).all()
    assert (found.lower == expected.lower).all()
    checked = check_file(path)
    assert any(finding.code == "text" for finding in checked.findings) == warned
    assert checked.answer.use is Use.USABLE


@pytest.mark.parametrize("comma", ["]", "}"])
def test_a_comma_too_many_is_read_and_the_check_has_it_taken_out(comma, tmp_path, capsys):
    plain = text()
    at = plain.index(comma, plain.index("GC_init_pos"))
    path = on(tmp_path, plain[:at].rstrip() + ", // last\n" + plain[at:])
    assert convert(path, tmp_path / "m.yaml") == 0
    assert convert("--check", path) == 1
    line = plain.count("\n", 0, at)
    said = capsys.readouterr().out
    assert f"{path}: repair this (the console does not read it)\n  take it out: line" in said
    assert f"take it out: line {line} (a comma after the last item)" in said


def test_an_arm_that_neither_file_nor_name_says_is_asked_for(tmp_path):
    path = on(tmp_path, text().replace('"ARM_NAME": "MTMR",', ""), "old.json")
    with pytest.raises(ConfigError, match="ARM_NAME: got nothing, expected MTML or MTMR, there or"):
        ConsoleFile.load(path)


# --- other files of the console ---------------------------------------------------------------

ARM = (
    HEAD
    + """{
    // since 1.7
    "kinematic": "kinematic/mtmr.json"
    , "%s": "gc-MTMR-12345.json" // MTMR
}"""
)
SYSTEM = (
    HEAD + '{"arms": [{"name": "MTMR", "type": "MTM", "arm": "MTMR-12345.json"}, {"name": "PSM1"}]}'
)


@pytest.mark.parametrize("key", ["gravity-compensation", "gravity_compensation"])
def test_an_arm_s_configuration_leads_to_the_calibration_that_it_names(key, tmp_path, capsys):
    arm = on(tmp_path, ARM % key, "MTMR-12345.json")
    for words in ((arm, tmp_path / "m.yaml"), ("--check", arm)):
        assert convert(*words) == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1
        assert f"{arm}: got 'a configuration', expected a calibration" in error
        assert error.strip().endswith("it names gc-MTMR-12345.json")
    beside = write(tmp_path, synthetic())
    assert convert("--check", arm) == 2
    assert capsys.readouterr().err.strip().endswith(f"it names {beside}")


def test_a_console_s_configuration_leads_there_by_the_arm_s(tmp_path, capsys):
    on(tmp_path, ARM % "gravity_compensation", "MTMR-12345.json")
    assert convert(on(tmp_path, SYSTEM, "system-MTMR.json"), tmp_path / "m.yaml") == 2
    assert "it names gc-MTMR-12345.json" in capsys.readouterr().err


@pytest.mark.parametrize("content", ['{"kinematic": "kinematic/mtml.json"}', SYSTEM])
def test_a_configuration_that_names_no_calibration_is_told_from_a_broken_one(content, tmp_path):
    with pytest.raises(ConfigError, match="this names none: gravity_compensation in the file"):
        ConsoleFile.load(on(tmp_path, content, "console.json"))


@pytest.mark.parametrize("content", [text(), HEAD + "{}", "no JSON"])
@pytest.mark.parametrize("verb", ["diagnose", "evaluate"])
def test_a_console_file_given_for_a_model_names_the_conversion(verb, content, tmp_path, capsys):
    path = on(tmp_path, content)
    out = ["--out", str(tmp_path / "out")] if verb == "diagnose" else []
    assert main([verb, "run.csv", "--model", str(path), *out]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert f"{path}: model: got 'a JSON file'" in error
    assert f"`convert {path} gc-MTMR-12345.yaml`" in error


# --- the answer -------------------------------------------------------------------------------

USE = {
    "limits_clip": Use.REPAIR, "limits_reversed": Use.REPAIR, "limits_beyond_actuator": Use.REPAIR,
    "g_constant": Use.REPAIR, "limits_exclude_zero": Use.USABLE, "limits_wide": Use.USABLE,
    "growth": Use.REPAIR,  # it is beyond the safe limits, too
    "pair_sum": Use.USABLE, "other_data": Use.USABLE, "other_hand": Use.NOT,
    "range": Use.NOT, "file_name": Use.NOT,
}  # fmt: skip


@pytest.mark.parametrize("code", FAULTS)
def test_each_fault_has_an_answer_and_what_to_do(code, tmp_path, capsys):
    document = synthetic()
    FAULTS[code][0](document)
    path = write(tmp_path, document)
    answer = check_file(path).answer
    assert answer.use is USE[code]
    assert bool(answer.reason) == (answer.use is not Use.USABLE)
    assert answer.todo or answer.use is Use.USABLE
    assert convert("--check", path) == (answer.use is not Use.USABLE)
    first, *lines = capsys.readouterr().out.splitlines()
    assert first.startswith(f"{path}: {answer.use}")
    assert [line.strip() for line in lines[: len(answer.todo)]] == [
        line.strip() for line in answer.todo
    ]


@pytest.mark.parametrize("case", BAD_FIELDS)
def test_a_bad_field_is_to_be_repaired(case, tmp_path):
    edit, named = BAD_FIELDS[case]
    document = synthetic()
    edit(document)
    answer = check_file(write(tmp_path, document)).answer
    if case == "unknown arm":  # and the name says another one: whose is it?
        assert answer.use is Use.NOT
        assert answer.todo[0].startswith("find out which arm")
        return
    assert answer.use is Use.REPAIR
    assert any(line.startswith("correct ") and named in line for line in answer.todo)


def test_parameters_that_no_edit_makes_right_are_not_to_be_used(tmp_path):
    two, cancelling = synthetic(), synthetic()
    two["GC_controller"]["gc_dynamic_params_neg"][4] += 1e-6
    scaled_gravity(cancelling, -2.4)
    limits(1, 0.5, -0.5)(cancelling)  # a repair of the limits would not be enough
    for document, reason in (
        (two, "two gravities in one file"),
        (cancelling, "wrong by up to "),
    ):
        answer = check_file(write(tmp_path, document)).answer
        assert answer.use is Use.NOT
        assert reason in answer.reason
        assert "--arm mtmr --for-console" in answer.todo[0]


def repaired(path, folder):
    """The file with the limits that the answer says, by hand."""
    document = json.loads(path.read_text())
    lines = [line.strip().rstrip(",") for line in check_file(path).answer.todo]
    new = json.loads("{" + ",".join(line for line in lines if line.startswith('"safe_')) + "}")
    assert len(new) == 2
    document["GC_controller"].update(new)
    return write(folder, document, path.name)


@pytest.mark.parametrize("joint", [0, 1, 6])
def test_the_safe_limits_that_are_proposed_make_a_file_usable(joint, tmp_path):
    document = synthetic()
    limits(joint, 0.5, -0.5)(document)
    assert check_file(repaired(write(tmp_path, document), tmp_path)).answer.use is Use.USABLE


def test_parameters_of_another_gravity_are_right_after_the_repair(tmp_path):
    document, sound = synthetic(), ConsoleFile.from_document(synthetic())
    document["lse"]["g_constant"] = 9.5
    for side in ("pos", "neg"):
        row = document["GC_controller"][f"gc_dynamic_params_{side}"]
        row[:10] = [value * 9.81 / 9.5 for value in row[:10]]
    (line,) = check_file(write(tmp_path, document)).answer.todo
    factor = float(line.split(" by ")[1].split(",")[0])
    found = ConsoleFile.from_document(document).positive[:10] * factor
    assert found == pytest.approx(sound.positive[:10], rel=1e-5)


def test_what_grows_outside_the_range_is_a_caution(tmp_path):
    document = synthetic()
    both_sides(14, 1.0)(document)
    position_range(0, -20, 20)(document)
    limits(0, -0.2, 0.2)(document)
    answer = check_file(write(tmp_path, document)).answer
    assert answer.use is Use.USABLE
    assert answer.todo[0].startswith("keep outer_yaw within the calibrated range")


@pytest.mark.parametrize("code", FAULTS)
def test_a_conversion_warns_of_what_a_model_takes_over(code, tmp_path, capsys):
    document = synthetic()
    FAULTS[code][0](document)
    path = write(tmp_path, document)
    assert convert(path, tmp_path / "m.yaml") == 0
    error = capsys.readouterr().err
    if USE[code] is Use.NOT or code == "g_constant":
        assert error.startswith(f"warning: {path}: {USE[code]} (")
        assert f"`convert --check {path}` says what to do" in error
    else:
        assert not error


REAL_USE = {
    "gc-MTML-22723": Use.REPAIR, "gc-MTML-34863": Use.NOT, "gc-MTML-41878": Use.REPAIR,
    "gc-MTMR-22403": Use.NOT, "gc-MTMR-28002": Use.REPAIR, "gc-MTMR-30924": Use.NOT,
    "gc-MTMR-32336": Use.NOT,
}  # fmt: skip


@needs_data
def test_the_real_files_are_answered_one_by_one(tmp_path):
    found = {path.stem: check_file(path).answer.use for path in REAL}
    assert found == REAL_USE
    for path in REAL:
        if found[path.stem] is Use.REPAIR:
            assert check_file(repaired(path, tmp_path)).answer.use is Use.USABLE


@needs_data
def test_every_real_file_becomes_a_model_whatever_its_safe_limits(tmp_path):
    for path in REAL:
        assert convert(path, tmp_path / f"{path.stem}.yaml") == 0
        assert TorqueModel.load(tmp_path / f"{path.stem}.yaml").document
