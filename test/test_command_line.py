"""Bad input on the command line: one clear line, status 2, nothing half-written."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from types import SimpleNamespace

import pytest
from support import CONFIG, MODEL_FILE, REPOSITORY

from dvrk_gravity import command_line
from dvrk_gravity.__main__ import main
from dvrk_gravity.command_line import VERBS
from dvrk_gravity.files.resources import shipped
from dvrk_gravity.ros import processes


def refused(*arguments: str) -> str:
    """Run a command that has to be refused, forked as nodes are; return its one line."""
    process = processes.subprocess.Popen(
        [sys.executable, "-m", "dvrk_gravity", *arguments], stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace",
        start_new_session=True, preexec_fn=None,
    )  # fmt: skip
    try:
        status = process.wait(60.0)
    finally:
        process.kill()
    with process.stdout as output:
        said = output.read()
    assert status == 2, said
    (line,) = said.strip().splitlines()
    return line


@pytest.fixture
def model_with(tmp_path):
    def write(find: str, replacement: str):
        text = MODEL_FILE.read_text()
        assert find in text
        path = tmp_path / "changed.yaml"
        path.write_text(text.replace(find, replacement, 1))
        return path

    return write


def help_of(verb: str, capsys) -> str:
    """Return what ``VERB --help`` prints; that it is installed so, another test sees."""
    with pytest.raises(SystemExit) as ended:
        main([verb, "--help"])
    assert ended.value.code == 0
    return capsys.readouterr().out


@pytest.mark.parametrize("verb", sorted(VERBS))
def test_help_shows_an_example(verb, capsys):
    assert "example:" in help_of(verb, capsys)


def test_an_output_that_nobody_reads_any_more_ends_quietly(tmp_path):
    description = tmp_path / "long.py"
    description.write_text(
        "'Count.'\n"
        "import sys\n"
        "from dvrk_gravity import command_line\n"
        "NAME = EXAMPLE = 'long'\n"
        "add_arguments = lambda parser: None\n"
        "def run(arguments):\n"
        "    for line in range(100000):\n"
        "        print(line)\n"
        "    return 0\n"
        "if __name__ == '__main__':\n"
        "    sys.exit(command_line.run('long'))\n"
    )
    with subprocess.Popen(
        [sys.executable, str(description)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env=os.environ | {"PYTHONPATH": f"{REPOSITORY}{os.pathsep}{tmp_path}"},
    ) as process:  # fmt: skip
        assert process.stdout.readline() == "0\n"
        process.stdout.close()
        assert process.stderr.read() == ""
        assert process.wait(timeout=60) == 128 + signal.SIGPIPE


@pytest.mark.parametrize(
    ("signalled", "status"), [(KeyboardInterrupt(), 130), (SystemExit(143), 143)]
)
def test_a_signal_within_compiled_code_ends_as_that_and_an_error_of_its_own_does_not(
    monkeypatch, signalled, status
):
    """rclpy makes a TypeError of an interrupt that comes while it builds a message."""

    def verb(cause: BaseException) -> SimpleNamespace:
        def work(arguments) -> int:
            raise TypeError("Unable to convert function return value") from cause

        return SimpleNamespace(
            NAME="made-up", EXAMPLE="", add_arguments=lambda parser: None, run=work
        )

    before = signal.getsignal(signal.SIGINT)
    try:
        monkeypatch.setitem(sys.modules, "interrupted", verb(signalled))
        assert command_line.run("interrupted", []) == status
        monkeypatch.setitem(sys.modules, "broken", verb(ValueError()))
        with pytest.raises(TypeError):
            command_line.run("broken", [])
    finally:
        signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize("verb", ["identify", "diagnose", "excite"])
def test_help_names_every_arm_that_there_is(verb, capsys):
    assert f"{', '.join(shipped('arms'))}, or" in " ".join(help_of(verb, capsys).split())


def test_an_unknown_verb_names_those_that_exist():
    line = refused("compensate")
    assert "compensator" in line


NODE = ("compensator", "--ros-args", "--params-file")


def test_an_unknown_key_is_named_with_the_one_that_was_meant(model_with):
    path = model_with("gravity_enabled:", "gravity_enable:")
    line = refused(*NODE, str(path))
    assert str(path) in line
    assert "gravity_enable" in line
    assert "did you mean gravity_enabled?" in line


def test_beta_of_nine_numbers_is_refused(domain, tmp_path):
    path = tmp_path / "nine.yaml"
    path.write_text("/**:\n  ros__parameters:\n    beta: [1.0, 2., 3., 4., 5., 6., 7., 8., 9.]\n")
    line = refused(*NODE, str(path))
    assert f"{path}: beta: got '9 numbers', expected 10" in line


def test_a_negative_limit_is_refused_with_its_joint_s_index(domain, model_with):
    path = model_with("arm: mtmr", "arm: mtmr\n    effort_limit: [1., 1., -1., 1., 1., 1., 1.]")
    line = refused(*NODE, str(path))
    assert f"{path}: effort_limit[2]: got -1.0" in line


def test_a_console_s_file_as_parameters_names_what_makes_a_model_of_it(domain, tmp_path):
    path = tmp_path / "gc-MTMR-28002.json"
    path.write_text('{"ARM_NAME": "MTMR"}')
    assert f"`convert {path} gc-MTMR-28002.yaml`" in refused(*NODE, str(path))


def test_a_missing_parameter_file_is_named(domain):
    assert "/no/such/model.yaml: got 'no such file'" in refused(*NODE, "/no/such/model.yaml")


def test_a_tab_in_a_parameter_file_is_found_with_its_line(domain, tmp_path):
    path = tmp_path / "tab.yaml"
    path.write_text("/**:\n\tros__parameters:\n")
    assert f"{path}: line 2" in refused(*NODE, str(path))


def test_a_compensator_without_beta_says_where_it_comes_from(domain):
    assert "--params-file" in refused("compensator")


def test_an_unknown_arm_is_refused(domain):
    line = refused("compensator", "--ros-args", "-p", "arm:=mtmx", "-p", f"beta:={[0.1] * 10}")
    assert "mtmr" in line


def test_a_watchdog_with_a_negative_time_is_refused(domain):
    line = refused("watchdog", "--ros-args", "-p", "watchdog_timeout:=-1.0")
    assert "watchdog_timeout: got -1.0" in line


@pytest.mark.parametrize(
    ("bag", "said"), [("missing", "no such file"), ("empty", ""), ("text.csv", "")]
)
def test_a_bag_that_is_none_is_refused_and_no_answer_is_written(tmp_path, bag, said):
    (tmp_path / "empty").mkdir()
    (tmp_path / "text.csv").write_text("time\n1\n")
    out = tmp_path / "answers"
    line = refused("replay", str(tmp_path / bag), "--model", str(MODEL_FILE), "--out", str(out))
    assert str(tmp_path / bag) in line
    assert said in line
    assert sorted(path.name for path in tmp_path.iterdir()) == ["empty", "text.csv"]


def test_a_replay_does_not_touch_a_bag_that_exists(tmp_path):
    (tmp_path / "answers").mkdir()
    line = refused("replay", str(tmp_path / "bag"), "--model", str(MODEL_FILE), "--out",
                   str(tmp_path / "answers"))  # fmt: skip
    assert "exists already" in line


def test_the_arm_files_and_the_example_model_are_installed_and_found():
    from dvrk_gravity import TorqueModel
    from dvrk_gravity.files.resources import config_path

    assert TorqueModel.load(config_path("mtmr_28002.yaml")).arm.name == "mtmr"
    assert config_path("arms/mtml.yaml").read_text() == (CONFIG / "arms/mtml.yaml").read_text()
    with pytest.raises(FileNotFoundError):
        config_path("../setup.py")


@pytest.mark.parametrize("given", [None, "3"])
def test_a_command_computes_in_one_thread_unless_told_otherwise(given, monkeypatch):
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    if given is not None:
        monkeypatch.setenv("OPENBLAS_NUM_THREADS", given)
    script = (
        "import builtins, os, sys\n"
        "find = builtins.__import__\n"
        "def told(name, *rest):\n"
        "    if name == 'numpy' and name not in sys.modules:\n"  # which reads it then
        "        print(os.environ.get('OPENBLAS_NUM_THREADS'))\n"
        "    return find(name, *rest)\n"
        "builtins.__import__ = told\n"
        "import dvrk_gravity.command_line\n"  # as `ros2 run` does first
    )
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert run.stdout.splitlines()[0] == (given or "1")


@pytest.mark.parametrize("name", ["newton-euler", "renamed", "identify"])
def test_an_installed_executable_runs_its_verb_under_any_name(name, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", [f"/lib/dvrk_gravity/{name}", "--help"])
    with pytest.raises(SystemExit):
        command_line.executables.newton_euler()
    assert "usage: dvrk_gravity newton-euler" in capsys.readouterr().out
