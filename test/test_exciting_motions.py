"""Motions that excite an arm, drawn by a seed, and the limits that they keep."""

from __future__ import annotations

import numpy as np
import pytest
from urdf_texts import a_joint, urdf

from dvrk_gravity.arms import Arm
from dvrk_gravity.planning import (
    Move,
    Multisine,
    PlanLimits,
    careful_limits,
    covering_plan,
    exciting_motion,
    slacks,
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


def test_an_exciting_motion_keeps_all_limits_and_goes_as_far_or_as_hard_as_they_let_it() -> None:
    arm = Arm.load("mtmr")
    limits = PlanLimits.of(arm)
    assert (arm.lower < limits.lower).all()
    assert (limits.upper < arm.upper).all()
    assert np.degrees([limits.pair.lower, limits.pair.upper]) == pytest.approx([-9.0, 39.0])
    for seed, duration in ((1, 60.0), (2, 8.0)):
        motion = exciting_motion(limits, duration, seed)
        position, velocity = motion.at(np.arange(0.0, duration, STEP))
        require_within(limits, position, velocity)
        if duration == 60.0:
            far = np.ptp(position, axis=0) / (limits.upper - limits.lower)
            hard = np.abs(np.diff(velocity, axis=0) / STEP).max(axis=0) / limits.acceleration
            assert (np.maximum(far, hard)[[0, 2, 3, 4, 5, 6]] > 0.7).all()
            assert far[1] > 0.25  # the shoulder shares its limits with the elbow


def test_it_begins_and_ends_at_rest_in_the_same_place_by_the_derivative_of_its_positions() -> None:
    motion = exciting_motion(PlanLimits.of(Arm.load("mtmr")), 20.0, 5)
    for moment in (0.0, 20.0, 30.0):
        position, velocity = motion.at(moment)
        np.testing.assert_allclose(position, motion.middle, atol=1e-12)
        np.testing.assert_allclose(velocity, 0.0, atol=1e-12)
    position, velocity = motion.at(np.arange(0.0, 20.0, STEP))
    np.testing.assert_allclose(np.gradient(position, STEP, axis=0)[1:-1], velocity[1:-1], atol=2e-3)


def test_one_seed_is_one_motion_now_and_as_of_old() -> None:
    """Recordings by seed, of tests and of the documentation's figures, stay what they were."""
    arm = Arm.load("mtmr")
    first, again, other = (exciting_motion(PlanLimits.of(arm), 20.0, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.at(7.0)[0], again.at(7.0)[0])
    assert np.abs(first.at(7.0)[0] - other.at(7.0)[0]).max() > 0.1
    for moment, yaw, roll_speed in (
        (2.5, -0.5924698652202719, -0.22707961444104924),
        (0.5, -0.2883279324424135, 0.6310056843544205),
    ):
        position, velocity = Multisine.draw(arm, 3).at(moment)
        assert position[0] == pytest.approx(yaw, abs=1e-12)
        assert velocity[6] == pytest.approx(roll_speed, abs=1e-12)


def test_a_velocity_limit_in_the_arm_s_file_binds(tmp_path) -> None:
    joints = [
        a_joint(*names, inner=f'<limit lower="-2" upper="2" effort="10" velocity="{fastest}"/>')
        for names, fastest in ((("slow", "a", "b"), 0.1), (("fast", "b", "c"), 5.0))
    ]
    arm = Arm.load(urdf(tmp_path, *joints, links="abc"))
    limits = PlanLimits.of(arm)
    np.testing.assert_allclose(limits.velocity, [0.1, np.radians(60.0)])
    _, velocity = exciting_motion(limits, 30.0, 1).at(np.arange(0.0, 30.0, STEP))
    assert np.abs(velocity[:, 0]).max() < 0.1 + SLACK
    assert np.abs(careful_limits(arm)[0][0]) <= 0.1


def test_a_move_is_as_quick_as_the_limits_that_it_is_given() -> None:
    limits = PlanLimits.of(Arm.load("mtmr"))
    start = np.array([0.0, 0.2, 0.1, 0.0, 1.5, 0.0, 0.0])
    move = Move(start, start + 0.4, limits.velocity, limits.acceleration)
    time = np.linspace(0.0, move.duration, 2000)
    position, velocity = (np.array(each) for each in zip(*map(move.at, time), strict=True))
    np.testing.assert_allclose(position[[0, -1]], [start, start + 0.4], atol=1e-9)
    np.testing.assert_allclose(np.gradient(position, time, axis=0)[1:-1], velocity[1:-1], atol=1e-3)
    acceleration = np.diff(velocity, axis=0) / (time[1] - time[0])
    assert (np.abs(velocity) <= limits.velocity).all()
    assert (np.abs(acceleration) <= limits.acceleration).all()
    assert np.max(np.abs(acceleration) / limits.acceleration) > 0.99


def test_excite_s_plan_keeps_the_arm_s_limits_between_grid_points_and_covers_its_range() -> None:
    plan = covering_plan(Arm.load("ecm"), 30.0, 1)
    assert all(slack.left >= 0.0 for slack in slacks(plan.motion, plan.limits, plan.arm))
    q = plan.at(np.linspace(0.0, 30.0, 3000))[0]
    assert (np.ptp(q, axis=0) > 0.6 * (plan.limits.upper - plan.limits.lower)).all()
    for moment in (0.0, 30.0):
        np.testing.assert_allclose(plan.at(moment)[1:], 0.0, atol=1e-12)
