"""The tutorial of `calibrate` works as it is printed, on another arm and with shorter motions."""

from __future__ import annotations

import pytest
from test_tutorials import BRIEF, PAGES, play

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("four_folds", "blank_pictures")]


def test_an_arm_is_calibrated_with_one_command(tmp_path, capsys):
    shorter = {"--arm mtmr --simulated": f"--arm ecm --simulated {BRIEF} --time 1 --poses 1"}
    play.play(PAGES / "calibrate_with_one_command.md", tmp_path, shorter)
    assert (tmp_path / "calibration" / "certificate.html").is_file()
    assert "certified" in capsys.readouterr().out
