"""Commands as processes of their own: closed outputs, threads, what a help loads, make."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import pytest
from recording_samples import wave
from support import REPOSITORY


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


@pytest.mark.parametrize(
    "name", ["x\x1b[2J\x1b[H.csv", "x\nwarning: y.csv", "\u202eevil\u2066.csv"]
)
def test_a_verb_prints_the_names_of_files_and_columns_printably(tmp_path, name):
    path = tmp_path / name
    wave(200).save(tmp_path / "bag")
    path.write_text("time,outer_yaw\x1b[2J.position\n0,1\n")
    ran = subprocess.run(
        [sys.executable, "-m", "dvrk_gravity", "identify", path, "--arm", "mtmr",
         "--out", tmp_path / "m.yaml"],
        cwd=REPOSITORY, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert ran.returncode == 2
    assert (ran.stdout + ran.stderr).replace("\n", "").isprintable()
    assert ran.stderr.count("\n") == 1
