"""An arm of ros2_control, moved by goals."""

from __future__ import annotations

import numpy as np
from controlled import WAY, controlled, go_wrong
from driven_arm import POSE

from dvrk_gravity.arms import JOINT_NAMES


def test_a_path_is_one_goal_with_positions_velocities_and_accelerations(domain: int) -> None:
    recorded: list[bytes] = []
    with controlled() as (arm, controller, mover):
        np.testing.assert_allclose(mover.connect(), POSE)
        mover.follow(WAY.at, WAY.duration, recorded.append)
        (goal,) = controller.goals
        assert tuple(goal.joint_names) == JOINT_NAMES
        for point, moment in zip(goal.points, controller.times, strict=True):
            q, qd, qdd = WAY.at(moment)
            np.testing.assert_allclose(point.positions, q)
            np.testing.assert_allclose(point.velocities, qd, atol=1e-9)
            np.testing.assert_allclose(point.accelerations[:7], qdd, atol=1e-6)
        assert set(goal.points[-1].velocities) == {0.0}
        assert np.diff([0.0, *controller.times]).max() <= 0.05 + 1e-9
        assert len(recorded) > 50
        np.testing.assert_allclose(arm.position, POSE + 0.3, atol=1e-3)
    assert not controller.cancelled  # it came to its end
    assert not arm.told


def test_what_goes_wrong_cancels_the_goal_which_is_not_what_a_refusal_does(domain: int) -> None:
    assert go_wrong("watched", "a hand; sent hold")
    assert not go_wrong("ended", "path tolerance.*; sent hold")
    assert not go_wrong("not accepted", "accept")
