"""Streams of commanded positions: the simulated servo takes them at any rate, a recording too."""

from __future__ import annotations

import numpy as np
import pytest

from dvrk_gravity.simulate import (
    PlantFile,
    SetPointFilter,
    SimulatedArm,
)

DT = 1e-3
TRUTH = PlantFile.load("ecm")


def test_a_step_is_followed_without_overshoot_and_reached() -> None:
    steps = SetPointFilter(np.zeros(1), DT)
    path = [steps.step(np.ones(1)) for _ in range(1000)]
    position, velocity = (np.ravel(values) for values in zip(*path, strict=True))
    assert (np.diff(position) >= 0.0).all()
    assert position[-1] == pytest.approx(1.0)
    np.testing.assert_allclose(np.gradient(position, DT)[1:-1], velocity[1:-1], atol=0.05)


def test_ripple_of_100_commands_a_second_is_that_of_the_source_beside_the_lags() -> None:
    """The figure that chose the lags: 1 rad/s at 100 Hz leaves 0.05 rad/s^2 before the servo."""
    steps = SetPointFilter(np.zeros(1), DT)
    velocity = [steps.step(np.array([0.01 * (k // 10)]))[1][0] for k in range(3000)]
    acceleration = np.diff(velocity[2000:]) / DT
    assert np.abs(acceleration).max() == pytest.approx(0.05, rel=0.15)


def test_a_stream_that_ends_leaves_the_arm_at_its_last_set_point() -> None:
    arm = SimulatedArm(TRUTH.plant())
    goal = arm.plant.q + 0.1 * TRUTH.model.arm.scale
    arm.servo_jp(goal)
    for _ in range(1000):
        arm.step()
    assert arm.target is not None
    np.testing.assert_array_equal(arm.target, goal)
    np.testing.assert_allclose(arm.plant.q, goal, atol=0.02)
    arm.hold()
    held = arm.plant.q
    for _ in range(300):
        arm.step()
    np.testing.assert_allclose(arm.plant.q, held, atol=1e-3)
