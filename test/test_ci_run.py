"""What CI runs: it names each step that fails, and ends all of them when it is interrupted."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import time
from pathlib import Path

import pytest

RUN = Path(__file__).parents[1] / ".ci" / "run"
# Each step leaves its shell's number, and takes a while.
STEPS = """\
.PHONY: install/.done lint docs test
install/.done lint docs test:
\t@echo $$$$ > begun.$(notdir $@); test "$@" != "$(FAILS)" || exit 1; \\
\tcase $@ in install*) ;; *) sleep $(SECONDS_OF) ;; esac
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with a blank in its name, with steps that do nothing."""
    folder = tmp_path / "a clone"
    (folder / ".ci").mkdir(parents=True)
    shutil.copy(RUN, folder / ".ci" / "run")
    (folder / "Makefile").write_text(STEPS)
    return folder


def start(folder: Path, fails: str = "", seconds: float = 0.0) -> subprocess.Popen[str]:
    logs = folder / "logs"
    logs.mkdir()
    return subprocess.Popen(
        [folder / ".ci" / "run"], start_new_session=True, text=True, stderr=subprocess.PIPE,
        env=os.environ | {"FAILS": fails, "SECONDS_OF": str(seconds), "TMPDIR": str(logs)},
        stdout=subprocess.DEVNULL,
    )  # fmt: skip


@pytest.mark.parametrize("step", ["", "install/.done", "lint", "docs", "test"])
def test_a_step_that_fails_is_named_and_is_the_status(folder: Path, step: str) -> None:
    process = start(folder, fails=step)
    _, error = process.communicate(timeout=30.0)
    assert process.returncode == (1 if step else 0)
    assert (step in error.splitlines()[-1]) if step else not error
    assert not any((folder / "logs").iterdir())


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_an_interruption_leaves_no_process_and_no_file_behind(folder: Path, number: int) -> None:
    process = start(folder, seconds=60.0)
    begun = [folder / f"begun.{step}" for step in ("lint", "docs", "test")]
    while not all(each.exists() and each.read_text() for each in begun):
        assert process.poll() is None
        time.sleep(0.02)
    process.send_signal(number)
    process.communicate(timeout=30.0)
    assert process.returncode == -number
    assert not any((folder / "logs").iterdir())
    for each in begun:
        with pytest.raises(ProcessLookupError):
            os.kill(int(each.read_text()), 0)
