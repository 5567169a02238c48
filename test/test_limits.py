"""Limits in joint and actuator space, and the way from one command to the next."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from dvrk_gravity.arms import Arm
from dvrk_gravity.compensate import EffortLimits, slew

ARM = Arm.load("mtmr")
STANDARD = EffortLimits(ARM, ARM.effort_limit, ARM.actuator_effort_limit)
SHOULDER, ELBOW, PLATFORM = 1, 2, 3
COUPLED = np.isin(np.arange(7), [SHOULDER, ELBOW, PLATFORM])
TOLERANCE = 1e-9  # N·m

TORQUES = arrays(float, 7, elements=st.floats(-5, 5))
ANY_FINITE = arrays(float, 7, elements=st.floats(allow_nan=False, allow_infinity=False))
LIMITS = st.builds(
    EffortLimits,
    st.just(ARM),
    arrays(float, 7, elements=st.just(0.0) | st.floats(0, 4)),
    arrays(float, 7, elements=st.just(0.0) | st.floats(0, 4)),
)
STEPS = arrays(float, 7, elements=st.just(math.inf) | st.floats(1e-3, 2))


def motor(torque: np.ndarray) -> np.ndarray:
    """Actuator torques, written out."""
    result = torque.copy()
    result[SHOULDER] = torque[SHOULDER] - torque[ELBOW] + 0.6697 * torque[PLATFORM]
    result[ELBOW] = torque[ELBOW] - 0.6697 * torque[PLATFORM]
    return result


def beyond(torque: np.ndarray, limits: EffortLimits) -> float:
    """How far the worst joint or motor is above its limit, N·m."""
    joint, actuator = np.abs(torque) - limits.joint, np.abs(motor(torque)) - limits.actuator
    return max(0.0, joint.max(), actuator.max())


@given(LIMITS, ANY_FINITE)
def test_a_clipped_torque_is_within_both_boxes(limits, torque):
    with np.errstate(over="ignore", invalid="ignore"):
        clipped = limits.clip(torque)
    assert np.isfinite(clipped).all()
    assert beyond(clipped, limits) <= TOLERANCE
    assert limits.contains(clipped)


def test_a_shoulder_at_its_motor_s_limit_keeps_the_elbow_s_torque():
    torque = np.array([0.0, 3.0, 0.5, 0.1, 0.02, 0.0, 0.0])
    assert motor(torque)[SHOULDER] > 1.464
    clipped = STANDARD.clip(torque)
    assert motor(clipped)[SHOULDER] == pytest.approx(1.464)
    np.testing.assert_allclose(motor(clipped)[2:], motor(torque)[2:], atol=1e-14)
    assert clipped[ELBOW] == pytest.approx(0.5)


def test_contains_looks_into_both_spaces():
    torque = np.zeros(7)
    torque[SHOULDER] = 1.5  # below the joint's 3.217, above its motor's 1.464
    assert not STANDARD.contains(torque)
    torque[ELBOW] = 0.2
    assert STANDARD.contains(torque)
    torque[0] = 1.87
    assert not STANDARD.contains(torque)


@given(LIMITS, TORQUES, TORQUES, STEPS)
def test_no_joint_changes_by_more_than_its_step(limits, previous, target, step):
    """Wherever the previous command is: limits may have been lowered under it."""
    target = limits.clip(target)
    command = slew(previous, target, step, limits)
    assert (np.abs(command - previous) <= step + 1e-12).all()


@given(LIMITS, TORQUES, TORQUES, STEPS)
def test_between_two_commands_within_limits_every_command_is(limits, previous, target, step):
    previous, target = limits.clip(previous), limits.clip(target)
    command = slew(previous, target, step, limits)
    assert beyond(command, limits) <= TOLERANCE
    between = (command - previous) * (target - command)
    assert (between >= -1e-12).all()  # no joint passes its target or turns back


@given(LIMITS, TORQUES, TORQUES, STEPS)
def test_above_lowered_limits_the_command_goes_further_above_in_neither_space(
    limits, previous, target, step
):
    command = slew(previous, limits.clip(target), step, limits)
    assert beyond(command, limits) <= max(beyond(previous, limits), TOLERANCE)


@given(LIMITS, TORQUES, TORQUES, STEPS)
def test_the_target_is_reached_in_as_many_steps_as_the_longest_way_needs(
    limits, previous, target, step
):
    target = limits.clip(target)
    needed = math.ceil(float((np.abs(target - previous) / step).max()) + 1e-6)
    command = previous
    for _ in range(min(needed, 30)):
        command = slew(command, target, step, limits)
    if needed <= 30:
        np.testing.assert_allclose(command, target, atol=1e-9)
    else:
        assert np.abs(target - command).max() < np.abs(target - previous).max()


def test_a_slow_wrist_does_not_slow_down_the_shoulder():
    """Not even where shoulder and elbow have to keep step, the shoulder's motor at its limit."""
    previous = ARM.joint_effort(np.array([0, 1.464, -1.753, 0, 0, 0, 0]))
    target = ARM.joint_effort(np.array([0, 1.464, 1.753, 0, 0, 0, 0.02]))
    step = np.array([0.1, 0.1, 0.05, 0.1, 0.1, 0.1, 1e-4])
    command = slew(previous, target, step, STANDARD)
    assert motor(command)[SHOULDER] == pytest.approx(1.464)
    np.testing.assert_allclose(command - previous, [0, 0.05, 0.05, 0, 0, 0, 1e-4], atol=1e-12)


def test_joints_that_are_all_too_far_go_by_their_steps_and_near_ones_arrive_at_once():
    step = np.linspace(0.001, 0.007, 7)
    np.testing.assert_allclose(slew(np.zeros(7), 2 * step, step, STANDARD), step, rtol=1e-12)
    np.testing.assert_array_equal(slew(np.zeros(7), 0.9 * step, step, STANDARD), 0.9 * step)
