"""Starts of a simulated arm: all joints, sizes and wrong readings; some are in test/."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from first_starts import NAMES, check_held
from supervisor_loop import ARM
from support import REPOSITORY

sys.path.insert(0, str(REPOSITORY / "benchmark"))
from starts import largest_motion


@pytest.mark.parametrize("reads", [True, False], ids=["a bias", "a steady push"])
@pytest.mark.parametrize("part", [0.09, -0.09, 0.2])
@pytest.mark.parametrize("joint", range(3), ids=NAMES)
def test_a_constant_that_the_arm_does_not_feel_is_held_before_it_moves_the_joint(
    joint, part, reads
):
    check_held(joint, part, reads)


def test_no_start_moves_a_joint_by_two_degrees():
    for seed in (1, 2):
        assert largest_motion(seed, 200) < 2.0, seed


def test_neither_a_dead_joint_nor_efforts_that_are_not_read_throw_one():
    for reading in (lambda effort: effort * (np.arange(ARM.n) != 1), lambda _: []):
        assert largest_motion(1, 200, reading) < 2.0
