"""Bad input on the command line: one line on standard error, status 2, nothing half-written."""

from __future__ import annotations

import json
import signal
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from support import MODEL_FILE

import dvrk_gravity
from dvrk_gravity import Recording, TorqueModel, command_line
from dvrk_gravity.__main__ import main
from dvrk_gravity.arms import JOINT_NAMES, Arm
from dvrk_gravity.command_line import VERBS
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import yaml_file
from dvrk_gravity.files.resources import shipped
from dvrk_gravity.parameters import unflatten


@pytest.fixture
def refused(capsys):
    """Return a function that runs a command that has to be refused, and returns its one line."""

    def run(*words) -> str:
        capsys.readouterr()
        assert main([str(word) for word in words]) == 2, words
        printed = capsys.readouterr()
        (line,) = printed.err.strip().splitlines()
        assert printed.out == ""
        return line

    return run


def help_of(verb: str, capsys) -> str:
    """Return what ``VERB --help`` prints."""
    with pytest.raises(SystemExit) as ended:
        main([verb, "--help"])
    assert ended.value.code == 0
    return capsys.readouterr().out


def test_every_help_shows_an_example_and_those_of_arms_name_every_arm(capsys):
    for verb in VERBS:
        shown = help_of(verb, capsys)
        assert "example:" in shown, verb
        if verb in ("identify", "diagnose", "excite"):
            assert f"{', '.join(shipped('arms'))}, or" in " ".join(shown.split()), verb
        if verb in ("compensator", "watchdog", "simulator"):  # nodes list their parameters
            assert "  arm (string, mtmr): " in shown, verb
    with pytest.raises(SystemExit):
        main(["identify", "--version"])
    assert capsys.readouterr().out == f"dvrk_gravity {dvrk_gravity.__version__}\n"


def test_an_installed_executable_runs_its_verb_under_any_name(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["/lib/dvrk_gravity/renamed", "--help"])
    with pytest.raises(SystemExit):
        command_line.executables.newton_euler()
    assert "usage: dvrk_gravity newton-euler" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("cause", "status"), [(KeyboardInterrupt(), 130), (SystemExit(143), 143), (ValueError(), None)]
)
def test_a_signal_within_compiled_code_ends_as_that_and_an_error_of_its_own_does_not(
    monkeypatch, cause, status
):
    """rclpy makes a TypeError of an interrupt that comes while it builds a message."""

    def work(arguments) -> int:
        raise TypeError("Unable to convert function return value") from cause

    verb = SimpleNamespace(NAME="made-up", EXAMPLE="", add_arguments=lambda parser: None, run=work)
    monkeypatch.setitem(sys.modules, "made_up", verb)
    before = signal.getsignal(signal.SIGINT)
    try:
        if status is None:
            with pytest.raises(TypeError):
                command_line.run("made_up", [])
        else:
            assert command_line.run("made_up", []) == status
    finally:
        signal.signal(signal.SIGINT, before)


def test_an_unknown_verb_names_those_that_exist(refused):
    assert "compensator" in refused("compensate")


def test_a_node_names_the_parameter_file_that_it_cannot_use(refused, tmp_path):
    console, tab = tmp_path / "gc-MTMR-28002.json", tmp_path / "tab.yaml"
    console.write_text('{"ARM_NAME": "MTMR"}')
    tab.write_text("/**:\n\tros__parameters:\n")
    for path, token in (
        ("/no/such/model.yaml", "no such file"),
        (console, f"convert {console} gc-MTMR-28002.yaml"),
        (tab, f"{tab}: line 2"),
    ):
        line = refused("compensator", "--ros-args", "--params-file", path)
        assert str(path) in line
        assert token in line


@pytest.mark.parametrize(
    "words",
    [["compensator"], ["demo", "--out", "new"], ["excite", "--arm", "mtmr", "--out", "new"]],
)
def test_what_needs_ros_says_so_in_one_line_where_there_is_none(
    words, tmp_path, monkeypatch, capsys
):
    monkeypatch.setitem(sys.modules, "rclpy", None)
    for name in [name for name in sys.modules if name.startswith("dvrk_gravity.ros")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr(signal, "signal", lambda *_: None)  # of this process
    monkeypatch.chdir(tmp_path)
    assert main(words) == 2
    shown = capsys.readouterr()
    assert shown.out == ""
    (line,) = shown.err.splitlines()
    assert line.startswith(f"dvrk_gravity {words[0]}: ")
    assert "rclpy" in line
    assert not list(tmp_path.iterdir())


def test_a_bag_that_is_none_is_refused_and_no_answer_is_written(refused, tmp_path):
    (tmp_path / "empty").mkdir()
    (tmp_path / "text.csv").write_text("time\n1\n")
    words = ("--model", MODEL_FILE, "--out")
    for bag in ("missing", "empty", "text.csv"):
        line = refused("replay", tmp_path / bag, *words, tmp_path / "answers")
        assert str(tmp_path / bag) in line
    assert str(tmp_path / "empty") in refused(
        "replay", tmp_path / "bag", *words, tmp_path / "empty"
    )
    assert sorted(path.name for path in tmp_path.iterdir()) == ["empty", "text.csv"]


def test_a_model_of_absurd_torques_is_refused(refused, tmp_path):
    model = TorqueModel.load(MODEL_FILE)
    q = np.random.default_rng(0).uniform(-0.3, 0.3, (60, 7))
    Recording(JOINT_NAMES, None, q, None, model.torque(q)).save(tmp_path / "poses.csv")
    file, values = tmp_path / "m.yaml", model.parameters()
    for verb, name, value in (
        ("evaluate", "beta", 1e308),
        ("evaluate", "elastic_cable.elbow_pitch", 1e29),
        ("diagnose", "directional_cable.positive.elbow_pitch", 1e13),
    ):
        changed = {**values, name: (value, *values.get(name, (0.0,))[1:])}
        file.write_text(yaml_file.dump({"/**": {"ros__parameters": unflatten(changed)}}))
        out = ["--out", tmp_path / "out"] if verb == "diagnose" else []
        assert str(file) in refused(verb, tmp_path / "poses.csv", "--model", file, *out)


def test_the_name_of_an_arm_may_be_in_any_case_and_a_model_has_it_in_small_letters(tmp_path):
    TorqueModel(Arm.load("Psm"), ()).save(tmp_path / "model.yaml")
    assert "arm: psm\n" in (tmp_path / "model.yaml").read_text()
    with pytest.raises(ConfigError, match="'MTMX'"):
        Arm.load("MTMX")


def test_a_console_file_has_the_name_of_its_own_arm(refused, tmp_path):
    model = tmp_path / "m.yaml"
    TorqueModel.load(MODEL_FILE).save(model)
    right, left = tmp_path / "gc-MTMR-5.json", tmp_path / "gc-MTML-5.json"
    line = refused("convert", model, left)
    assert "'MTMR'" in line
    assert "gc-MTMR-5.json" in line
    assert not left.exists()
    assert main(["convert", str(model), str(right)]) == 0
    left.write_text(right.read_text())
    assert str(left) in refused("convert", left, tmp_path / "left.yaml")
    anyone = tmp_path / "calibration.json"
    anyone.write_text(right.read_text())
    assert main(["convert", str(anyone), str(tmp_path / "anyone.yaml")]) == 0
    right.write_text(json.dumps(json.loads(right.read_text()) | {"ARM_NAME": "MTML"}))
    assert str(right) in refused("convert", right, tmp_path / "mirrored.yaml")
