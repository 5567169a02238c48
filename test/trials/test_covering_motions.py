"""Motions that cover an arm's range, drawn by seeds."""

from __future__ import annotations

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.planning import (
    PlanLimits,
    covering_motion,
    exciting_motion,
)

STEP = 1e-3


SLACK = 1e-4  # rad, rad/s: limits are kept on a grid of 5 ms


def require_within(limits: PlanLimits, position: np.ndarray, velocity: np.ndarray) -> None:
    """Check what a motion is every ms against each limit."""
    assert (position > limits.lower - SLACK).all()
    assert (position < limits.upper + SLACK).all()
    assert (np.abs(velocity) < limits.velocity + SLACK).all()
    acceleration = np.diff(velocity, axis=0) / STEP
    assert (np.abs(acceleration) < 1.01 * limits.acceleration).all()
    if limits.pair is not None:
        both = position[:, limits.pair.first] + position[:, limits.pair.second]
        assert limits.pair.lower - SLACK < both.min()
        assert both.max() < limits.pair.upper + SLACK


def test_a_covering_motion_keeps_all_limits_and_another_one_stays_within_what_it_showed() -> None:
    limits = PlanLimits.of(Arm.load("mtmr"))
    time = np.arange(0.0, 40.0, STEP)
    shown, again = (covering_motion(limits, 40.0, seed).at(time) for seed in (1, 2))
    for states in (shown, again):
        require_within(limits, *states)
    lowest, highest = shown[0].min(axis=0), shown[0].max(axis=0)
    part = (highest - lowest) / (limits.used * (limits.upper - limits.lower))
    assert (part > 0.7).all()
    outside = ((again[0] < lowest) | (again[0] > highest)).mean(axis=0)
    assert (outside < 0.25).all()
    exciting = exciting_motion(limits, 40.0, 1).at(time)[0]
    assert (np.ptp(exciting, axis=0) <= (highest - lowest) + 0.1).all()
