"""The console's files as people have them: what its reader takes, faults found, and what to do."""

from __future__ import annotations

import json
import math

import pytest
from console_files import (
    both_sides,
    convert,
    edited,
    limits,
    position_range,
    repaired,
    scaled_gravity,
    synthetic,
    write,
)

from dvrk_gravity.console import ConsoleFile, Severity, Use, check_file

NAME = "gc-MTMR-12345.json"
HEAD = "/* -*- Mode: Javascript; tab-width: 4; -*- */\n"
SERIOUS, WARNING, NOTE = Severity


def text(document=None) -> str:
    return json.dumps(document or synthetic(), indent=1)


def on(folder, content, name=NAME):
    path = folder / name
    path.write_text(content, encoding="utf-8")
    return path


def only(path, code):
    """Return the one finding of a kind."""
    (finding,) = (found for found in check_file(path).findings if found.code == code)
    return finding


def codes(path) -> set[str]:
    return {finding.code for finding in check_file(path).findings}


# --- what the console reads ------------------------------------------------------------------

# What its reader takes, and whether the check warns of it.
READ = {
    "comment on top": (lambda plain: HEAD + plain, False),
    "comment with an address in a text": (
        lambda plain: plain.replace('"SN"', '/* , */ "url": "http://a.b/*c*/", "SN"'), False,
    ),
    "key twice": (lambda plain: plain.replace("{", '{"version": "1.0",', 1), True),
    "more behind the object": (lambda plain: plain + "\n}\n", True),
    "numbers that end in a point": (lambda plain: plain.replace("0.02,", "2.e-2,"), False),
    "numbers with a zero before": (lambda plain: plain.replace("-40,", "-040.,"), False),
}  # fmt: skip


def test_what_the_console_reads_is_read(tmp_path):
    expected = ConsoleFile.from_document(synthetic())
    for case, (change, warned) in READ.items():
        content = change(text())
        assert content != text(), case
        path = on(tmp_path, content)
        found = ConsoleFile.load(path)
        assert (found.arm, found.version) == ("mtmr", 2), case
        assert (found.positive == expected.positive).all(), case
        assert (found.blend.dead_band == expected.blend.dead_band).all(), case
        assert (found.valid.lower == expected.valid.lower).all(), case
        assert ("text" in codes(path)) == warned, case
        assert check_file(path).answer.use is Use.USABLE, case


@pytest.mark.parametrize("comma", ["]", "}"])
def test_a_comma_too_many_is_read_and_the_check_has_it_taken_out(comma, tmp_path):
    plain = text()
    at = plain.index(comma, plain.index("GC_init_pos"))
    path = on(tmp_path, plain[:at].rstrip() + ", // last\n" + plain[at:])
    assert convert(path, tmp_path / "m.yaml") == 0
    answer = check_file(path).answer
    assert answer.use is Use.REPAIR
    assert f"line {plain.count(chr(10), 0, at)} " in answer.todo[0]


# --- faults, and the answer -------------------------------------------------------------------

# code -> (fault that must be found, its severity, what may be done with the file, near miss)
FAULTS = {
    "limits_clip": (limits(1, -0.5, 0.5), SERIOUS, Use.REPAIR, limits(1, 0.0, 1.1)),
    "limits_reversed": (limits(0, 0.5, -0.5), SERIOUS, Use.REPAIR, limits(0, -0.5, 0.5)),
    "limits_exclude_zero": (limits(6, 9e-5, 9e-5), WARNING, Use.USABLE, limits(6, 0, 9e-5)),
    "limits_beyond_actuator": (
        limits(5, -1.485, 0.09), SERIOUS, Use.REPAIR, limits(5, -0.097, 0.09),
    ),
    "limits_wide": (limits(0, -1.8, 1.8), WARNING, Use.USABLE, limits(0, -0.01, 0.03)),
    # It is beyond the safe limits, too.
    "growth": (both_sides(14, 1.0), SERIOUS, Use.REPAIR, both_sides(14, 0.001)),
    "other_hand": (both_sides(5, -0.0197), SERIOUS, Use.NOT, both_sides(5, 0.0205)),
    "range": (position_range(1, -14, 80), SERIOUS, Use.NOT, position_range(1, -14, 65)),
    "g_constant": (
        lambda document: document["lse"].update(g_constant=9.5), SERIOUS, Use.REPAIR,
        lambda document: document["lse"].update(g_constant=9.81),
    ),
    "pair_sum": (scaled_gravity(0.03, 0.75), WARNING, Use.USABLE, scaled_gravity(0.03, 0.6)),
    "file_name": (
        lambda document: document.update(SN="999"), SERIOUS, Use.NOT,
        lambda document: document.update(SN=12345),
    ),
    "other_data": (
        lambda document: document.update(MTM_data_path="data/MTMR_777"), WARNING, Use.USABLE,
        lambda document: document.update(MTM_data_path="data/MTMR_12345"),
    ),
}  # fmt: skip


def test_a_sound_file_has_no_findings_but_the_pair(tmp_path):
    path = write(tmp_path, synthetic())
    assert convert("--check", path) == 0
    assert codes(path) == {"pair"}
    assert {"version_1", "no_range"} <= codes(write(tmp_path, synthetic("1.0")))


@pytest.mark.parametrize("code", FAULTS)
def test_each_fault_is_found_and_answered_and_its_near_miss_is_not(code, tmp_path, capsys):
    fault, severity, use, near_miss = FAULTS[code]
    path = write(tmp_path, edited(fault))
    checked = check_file(path)
    (found, *_) = (finding for finding in checked.findings if finding.code == code)
    assert found.severity is severity
    assert checked.answer.use is use
    assert bool(checked.answer.reason) == (use is not Use.USABLE)
    assert checked.answer.todo or use is Use.USABLE
    assert convert("--check", path) == (use is not Use.USABLE)
    capsys.readouterr()
    # A conversion warns of what a model takes over; it leaves the safe limits behind.
    assert convert(path, tmp_path / "m.yaml") == 0
    warned = capsys.readouterr().err.startswith(f"warning: {path}: {use} (")
    assert warned == (use is Use.NOT or code == "g_constant")
    assert code not in codes(write(tmp_path, edited(near_miss)))


def test_the_range_of_the_other_arm_side_is_told_apart_from_a_wrong_range(tmp_path):
    finding = only(write(tmp_path, edited(position_range(3, -190, 80))), "other_hand")
    assert (finding.subject, finding.severity) == ("wrist_platform", SERIOUS)
    assert "MTML" in finding.text


def test_the_pair_of_opposite_torques_is_judged_by_its_size(tmp_path):
    for beta1, severity in ((0.03, NOTE), (-0.14, WARNING), (-2.4, SERIOUS)):
        finding = only(write(tmp_path, edited(scaled_gravity(beta1))), "pair")
        assert finding.severity is severity, beta1
        assert finding.numbers["positive_Nm_rad"] == pytest.approx(0.45, abs=1e-12)
    assert "pair" not in codes(write(tmp_path, edited(both_sides(16, 0.0))))


def test_a_copy_of_another_arms_file_is_named(tmp_path):
    path = write(tmp_path, synthetic())
    write(tmp_path, synthetic() | {"SN": "777"}, "gc-MTMR-777.json")
    write(tmp_path, synthetic(seed=9) | {"SN": "778"}, "gc-MTMR-778.json")
    (tmp_path / "gc-MTMR-779.json").write_text("broken")
    finding = only(path, "copy")
    assert (finding.subject, finding.severity) == ("gc-MTMR-777.json", SERIOUS)
    assert "copy" not in codes(tmp_path / "gc-MTMR-778.json")
    # A second name of the same arm's file is no copy of another arm's.
    write(tmp_path, synthetic(), "gc-MTMR-12345-old.json")
    (tmp_path / "gc-MTMR-777.json").unlink()
    assert "copy" not in codes(path)


@pytest.mark.parametrize("side", [1, -1], ids=["above", "below"])
def test_the_share_of_clipped_poses_is_right(side, tmp_path):
    # Joint 1 has its own polynomial only: linear in q, uniform poses, the share is plain.
    document = synthetic()
    for index, value in enumerate((0.0, 0.1, 0.0, 0.0, 0.0), start=10):
        both_sides(index, value)(document)
    position_range(0, -40, 40)(document)
    edge = 0.1 * math.radians(20) - 0.001
    limits(0, *((-0.5, edge) if side == 1 else (-edge, 0.5)))(document)
    finding = only(write(tmp_path, document), "limits_clip")
    assert (finding.subject, finding.severity) == ("outer_yaw", SERIOUS)
    assert finding.numbers["share"] == pytest.approx(0.25, abs=0.01)
    assert finding.numbers["worst_Nm"] == pytest.approx(side * 0.1 * math.radians(40), abs=1e-3)


def test_parameters_that_no_edit_makes_right_are_not_to_be_used(tmp_path):
    two, cancelling = synthetic(), edited(scaled_gravity(-2.4))
    two["GC_controller"]["gc_dynamic_params_neg"][4] += 1e-6
    limits(1, 0.5, -0.5)(cancelling)  # a repair of the limits would not be enough
    for document in (two, cancelling):
        answer = check_file(write(tmp_path, document)).answer
        assert answer.use is Use.NOT
        assert "--arm mtmr --for console" in answer.todo[0]


@pytest.mark.parametrize("joint", [1, 6])
def test_the_safe_limits_that_are_proposed_make_a_file_usable(joint, tmp_path):
    path = write(tmp_path, edited(limits(joint, 0.5, -0.5)))
    assert check_file(repaired(path, tmp_path)).answer.use is Use.USABLE


def test_the_report_is_json_and_statuses_combine(tmp_path, capsys):
    good = write(tmp_path, synthetic())
    bad = edited(limits(0, 0.5, -0.5), seed=4) | {"SN": "5"}
    serious = write(tmp_path, bad, "gc-MTMR-5.json")
    report = tmp_path / "report.json"
    assert convert("--check", good, serious, "--json", report) == 1
    content = json.loads(report.read_text())
    assert set(content) == {str(good), str(serious)}
    assert content[str(good)]["answer"]["use"] == "usable"
    assert content[str(serious)]["answer"]["use"] == "repair this"
    first = content[str(serious)]["findings"][0]
    assert (first["code"], first["severity"]) == ("limits_reversed", "serious")
    assert convert("--check", good, serious, tmp_path / "none.json") == 2
    assert "none.json" in capsys.readouterr().err
