"""What a terminal shows: a table, a few lines, reasons beside verdicts, and how long it takes."""

from __future__ import annotations

import sys
from dataclasses import replace

import pytest
from made_results import CLEAR, finding, fit_of
from unresolved_causes import passed

from dvrk_gravity import command_line
from dvrk_gravity.arms import JOINT_NAMES, Arm
from dvrk_gravity.command_line import Progress
from dvrk_gravity.diagnosis import Alternative, Diagnosis, Gain
from dvrk_gravity.effects import Estimate
from dvrk_gravity.identification import (
    Evaluation,
    Fit,
    JointError,
    JointVerdict,
    Verdict,
    by_errors,
)
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Note
from dvrk_gravity.report import (
    MOST_WARNINGS,
    diagnosis_text,
    evaluation_text,
    fit_text,
    warning_lines,
)

ARM = Arm.load("mtmr")
LEFT = TorqueModel.from_parameters({"arm": "mtml", "beta": (0.1,) * 10})
EXTRAPOLATED = "gravity torque uncertain by ±31 mN·m outside the recorded poses"
DETAIL = Note("stale_samples", None, {}, "95 samples repeat the one before")
OTHER_UNIT = Note("effort_unit", None, {}, "efforts in another unit than N·m?")


def of_two_minds() -> Fit:
    """Return a fit with a good joint of a large error, and a usable one of a small error."""
    errors = dict.fromkeys(JOINT_NAMES, JointError(0.02, 0.05, 0.99))
    errors["wrist_roll"] = JointError(0.0005, 0.6, 0.4)
    errors["outer_yaw"] = JointError(0.01, 0.013, 0.99)
    joints = dict.fromkeys(JOINT_NAMES, JointVerdict("good", "held-out error 5 % of its torque"))
    joints["wrist_roll"] = JointVerdict("good", "held-out error 0.5 mN·m, less than dry friction")
    joints["outer_yaw"] = JointVerdict("usable", EXTRAPOLATED, "elsewhere")
    verdict = Verdict("usable", "outer_yaw", "elsewhere", joints)
    return replace(fit_of(None), held_out=errors, verdict=verdict)


def row_of(lines: list[str], joint: str) -> str:
    (row,) = [line for line in lines if line.startswith(joint)]
    return row


def test_the_verdict_on_a_recording_has_its_reason_too():
    errors = dict.fromkeys(JOINT_NAMES, JointError(1.0, 0.05, 0.99))
    errors["wrist_roll"] = JointError(1e-4, 0.9, 0.0)
    errors["outer_yaw"] = JointError(1.0, 0.9, 0.0)
    judged = by_errors(ARM, errors, "joint")
    assert judged["wrist_roll"].level == "good"
    assert "0.1 mN·m" in judged["wrist_roll"].reason
    assert judged["outer_yaw"].level == "do_not_compensate"
    of_poses = by_errors(
        ARM, errors | {"elbow_pitch": JointError(0.05 * ARM.effort_limit[2], 0.9, 0.0)}, "joint",
        ["elbow_pitch"],
    )  # fmt: skip
    assert of_poses["elbow_pitch"].level == "usable"
    assert "friction" in of_poses["elbow_pitch"].reason


def test_an_identification_is_a_table_with_reasons_and_verbose_says_the_rest():
    fit = replace(of_two_minds(), warnings=(DETAIL, OTHER_UNIT))
    lines = list(fit_text(fit))
    for joint, numbers in (("wrist_roll", "0.600 0.400"), ("outer_yaw", "0.013 0.990")):
        verdict, row = fit.verdict.joints[joint], row_of(lines, joint)
        assert numbers in " ".join(row.split())
        assert row.endswith(f"{verdict.level}: {verdict.reason}")
    assert row_of(lines, "elbow_pitch").endswith("  good")
    assert len(lines) <= 1 + len(JOINT_NAMES) + 7
    said = "\n".join(fit_text(fit, verbose=True))
    for detail in (*fit.handling, *fit.identifiability.statements, DETAIL.text):
        assert detail in said
        assert detail not in "\n".join(lines)


def test_of_many_warnings_few_are_shown_and_the_others_counted():
    many = [replace(OTHER_UNIT, text=f"number {k}") for k in range(MOST_WARNINGS + 2)]
    held = Note("held_joints", None, {}, "not recorded: roll")
    lines = list(warning_lines([*many, DETAIL, held]))
    assert lines[0] == "data: not recorded: roll"
    assert len(lines) == 1 + MOST_WARNINGS + 1
    assert "3 more" in lines[-1]
    assert len(list(warning_lines([*many, DETAIL, held], verbose=True))) == len(many) + 2
    much = replace(DETAIL, kind="samples_discarded", numbers={"samples": 900, "share": 0.25})
    assert next(warning_lines([*many, much])) == f"warning: {much}"
    for shown in (much, replace(DETAIL, unusable=True)):
        assert list(warning_lines([shown])) == [f"warning: {shown}"]


def diagnosis() -> Diagnosis:
    small = Estimate(0.02, 0.01, 0.03, "N·m")
    first = replace(
        finding("coulomb_friction", small, CLEAR, "positive"),
        joints=("wrist_roll",), remedy="oil it",
        alternatives=(Alternative("presliding_hysteresis", ("wrist_roll",), why="as well"),),
    )  # fmt: skip
    weak = replace(
        finding("torque_scale", Estimate(1.1, 0.9, 1.3, ""), CLEAR, "factor"), joints=JOINT_NAMES
    )
    before, after, floor = (dict.fromkeys(JOINT_NAMES, value) for value in (0.2, 0.05, 0.01))
    nan = dict.fromkeys(JOINT_NAMES, float("nan"))
    after["elbow_pitch"], model = 0.3, TorqueModel(ARM, ())
    return Diagnosis(
        "explained", (first, weak), (), before, after, floor, nan, "repetition", 100, 30,
        (DETAIL, OTHER_UNIT), ("thinned out",), (), model, passed(model, 5), (), band=8.0,
    )  # fmt: skip


def test_a_diagnosis_is_a_table_with_sizes_and_what_is_next():
    lines = list(diagnosis_text(diagnosis()))
    row = lines[2].split()
    assert row[:6] == ["1", "coulomb_friction", "wrist_roll", "40", "%", "yes"]
    assert row[-5:-1] == ["20.0", "±", "10.0", "mN·m"]
    assert "presliding_hysteresis" in lines[3]
    assert "outer_yaw 200 -> 50" in lines[5]
    assert "elbow_pitch 200 -> 300, 30 times" in lines[5]
    assert "oil it" in lines[6]
    assert len(lines) == 9, "a warning, and how many more"
    clock = finding("time_scale", Estimate(1.1, 1.0, 1.2, ""), Gain(0.1, 0.0, 0.2, 0.001), "factor")
    both = (replace(clock, remedy="set it"), *diagnosis().findings)
    said = list(diagnosis_text(replace(diagnosis(), findings=both)))
    assert [line for line in said if line.startswith("next:")] == ["next: oil it"]
    said = "\n".join(diagnosis_text(diagnosis(), verbose=True))
    assert "thinned out" in said
    assert "thinned out" not in "\n".join(lines)


@pytest.mark.parametrize(
    ("share", "claimed", "status"),
    [(0.05, "good", 0), (0.2, "unknown", 0), (0.9, "good", 1), (0.05, "do_not_compensate", 1)],
)
def test_evaluate_has_the_status_of_its_answer(share, claimed, status, tmp_path, monkeypatch):
    errors = dict.fromkeys(JOINT_NAMES, JointError(1.0, share, 0.5))
    result = Evaluation(errors, 9, "joint", "", (), (), ())
    monkeypatch.setattr("dvrk_gravity.identification.evaluate", lambda *_: result)
    model = tmp_path / "model.yaml"
    replace(TorqueModel(ARM, ()), verdict=claimed).save(model)
    arguments = ["run.csv", "--model", str(model)]
    monkeypatch.setattr("dvrk_gravity.recording.load_excerpt", lambda *_, **given: None)
    assert command_line.run("dvrk_gravity.cli.evaluate", arguments) == status
    said = "\n".join(evaluation_text(result, TorqueModel.load(model)))
    assert ("do not compensate with this" in said) == bool(status)


@pytest.fixture
def clock(monkeypatch):
    class Clock:
        now = 0.0

    monkeypatch.setattr("dvrk_gravity.command_line.time.monotonic", lambda: Clock.now)
    return Clock


@pytest.mark.parametrize("terminal", [False, True])
def test_progress_says_how_long_is_left_and_where_it_is_no_terminal_every_ten_seconds(
    terminal, clock, capsys, monkeypatch
):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: terminal, raising=False)
    with Progress("excite", 100) as progress:
        for second in range(61):
            clock.now = float(second)
            progress.update(round(100 * second / 60))
    said = capsys.readouterr().err
    lines = said.replace("\r\033[K", "\n").strip().splitlines()
    assert "excite: 50 %, about 30 s left" in lines
    assert said.endswith("\r\033[K" if terminal else "excite: 100 %\n")
    # Of the pace nothing is known at first; a terminal shows that it has begun.
    assert lines[0] == ("excite: 0 %" if terminal else "excite: 17 %, about 50 s left")
    assert terminal or len(lines) == 6
