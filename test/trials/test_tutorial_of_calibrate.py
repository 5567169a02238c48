"""The tutorial of `calibrate` works as it is printed, on another arm and with shorter motions."""

from __future__ import annotations

import importlib.util

from support import REPOSITORY

PAGES = REPOSITORY / "docs" / "tutorials"


def test_an_arm_is_calibrated_with_one_command(tmp_path, capsys):
    spec = importlib.util.spec_from_file_location("play_calibrate", PAGES / "play.py")
    play = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(play)
    brief = "--arm ecm --simulated --duration 12 --time 1 --poses 1"
    play.play(PAGES / "calibrate_with_one_command.md", tmp_path, {"--arm mtmr --simulated": brief})
    assert (tmp_path / "calibration" / "certificate.html").is_file()
    assert "certified" in capsys.readouterr().out
