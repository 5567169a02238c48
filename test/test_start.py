"""Starts of a simulated arm with the shipped plant's noise: no joint moves."""

from __future__ import annotations

import sys

import numpy as np
from supervisor_loop import ARM
from support import REPOSITORY

sys.path.insert(0, str(REPOSITORY / "benchmark"))
from starts import largest_motion

READINGS = {
    "an offset": lambda effort: effort + 0.1 * ARM.effort_limit,
    "too large": lambda effort: 1.3 * effort,
    "steps": lambda effort: np.round(effort / 0.03) * 0.03,
}


def test_no_start_moves_a_joint_by_two_degrees():
    assert largest_motion(0, 200) < 2.0


def test_neither_wrong_readings_nor_a_model_that_changes_meanwhile_throw_a_joint():
    for kind, reading in READINGS.items():
        assert largest_motion(1, 200, reading) < 2.0, kind
    for part in (0.5, 1.6):
        assert largest_motion(1, 200, models=(part, 1.0)) < 2.0, part
