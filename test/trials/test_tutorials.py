"""The tutorials print what they show, and their commands work as they stand."""

from __future__ import annotations

import importlib.util
import itertools
import os
import subprocess
import sys

import pytest
from support import REPOSITORY

PAGES = REPOSITORY / "docs" / "tutorials"
SPEC = importlib.util.spec_from_file_location("play", PAGES / "play.py")
play = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(play)

# Those that show figures, each with those that go on in its folder.
SHOWN = [
    ["first_hour", "read_a_report"], ["recover_a_known_truth"], ["weigh_a_tool"], ["my_urdf"],
    ["add_an_effect"],
]  # fmt: skip
BRIEF = "--simulated --duration 12"
# Those that a simulated arm carries out in a shorter time, and a file that they leave.
SHORTER = {
    "calibrate_my_mtm": ({"--simulated": BRIEF}, "gc-MTMR-12345.json"),
    "which_arm_first": ({}, "results/history.html"),
    "calibrate_with_one_command": (
        {"--arm mtmr --simulated": f"--arm ecm --simulated {BRIEF} --time 1 --poses 1"},
        "calibration/certificate.html",
    ),
}


@pytest.mark.parametrize("pages", SHOWN, ids=" ".join)
def test_a_page_has_the_figures_that_its_commands_print(pages, tmp_path):
    words = [sys.executable, PAGES / "play.py", *pages, "--out", tmp_path]
    environment = os.environ | {"PYTHONPATH": str(REPOSITORY)}
    played = subprocess.run(
        words, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert played.returncode == 0, played.stderr


@pytest.mark.parametrize("page", SHORTER)
def test_an_arm_is_moved_and_calibrated_by_the_commands_of_a_page(page, tmp_path):
    shorter, file = SHORTER[page]
    play.play(PAGES / f"{page}.md", tmp_path, shorter)
    assert (tmp_path / file).is_file()


def test_every_tutorial_is_played_here():
    assert {page.stem for page in PAGES.glob("*.md")} == {*itertools.chain(*SHOWN), *SHORTER}
