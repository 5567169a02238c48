"""The first start of a model with a constant torque in doubt: what the arm does not feel moves it.

A simulated arm in a closed loop, with a clock of its own: nothing in it takes time.
"""

from __future__ import annotations

import numpy as np
import pytest
from first_starts import FARTHEST, FASTEST, NAMES, POSE, SHIPPED, Loop, check_held

from dvrk_gravity.compensate import HANDS_OFF, ConstantCheck, Sample, Status

LIMIT = SHIPPED.arm.effort_limit.tolist()


@pytest.mark.parametrize(("part", "reads"), [(0.09, True), (-0.09, False), (0.2, False)])
@pytest.mark.parametrize("joint", range(3), ids=NAMES)
def test_a_constant_that_the_arm_does_not_feel_is_held_before_it_moves_the_joint(
    joint, part, reads
):
    check_held(joint, part, reads)


def test_a_constant_that_hardly_exceeds_friction_is_held_as_slowly_as_it_moves():
    loop = Loop(2, 0.032, feels=False, reads=True).run(5.0)

    assert loop.supervisor.status is Status.FAULT
    assert np.degrees(loop.farthest) < FARTHEST


@pytest.mark.parametrize(("joint", "part"), [(0, -0.2), (1, 0.09), (2, -0.2)])
def test_a_spring_is_compensated_once_it_was_seen_to_move_nothing(joint, part):
    loop = Loop(joint, part * SHIPPED.arm.effort_limit[joint], feels=True, reads=False).run(1.5)
    assert HANDS_OFF in loop.supervisor.reason

    loop.run(1.5)

    assert loop.supervisor.status is Status.COMMANDING
    assert HANDS_OFF not in loop.supervisor.reason
    assert np.degrees(loop.farthest) < 0.5

    loop.push(0.3, 0.3)
    loop.run(1.0)
    assert np.degrees(loop.farthest) > 1.0, "a hand moves it"
    assert loop.supervisor.status is Status.COMMANDING

    loop.supervisor.disable()
    loop.run(0.5)
    loop.supervisor.enable()
    loop.run(0.5)
    assert loop.supervisor.active
    assert HANDS_OFF not in loop.supervisor.reason, "of the same model only the first start"


def test_a_hand_during_the_first_start_ends_in_a_hold_and_the_next_start_checks_again():
    loop = Loop(1, 0.3, feels=True, reads=False).run(0.4)
    loop.push(0.4, 0.3)
    loop.run(1.0)
    assert loop.supervisor.status is Status.FAULT

    loop.supervisor.enable()
    loop.run(0.5)
    assert HANDS_OFF in loop.supervisor.reason
    loop.run(3.0)
    assert loop.supervisor.status is Status.COMMANDING


def test_a_constant_that_is_added_meanwhile_is_watched_too():
    felt, added = 0.09 * SHIPPED.arm.effort_limit * np.eye(7)[1:3]
    loop = Loop(1, felt[1], feels=True, reads=False).run(1.5)
    assert HANDS_OFF in loop.supervisor.reason

    loop.configure(
        **{
            "elastic_cable.elbow_pitch": [added[2]],
            "identification.constant": (felt + added).tolist(),
        }
    )
    loop.run(3.0)
    assert loop.supervisor.status is Status.FAULT
    assert "elbow_pitch" in loop.supervisor.reason
    assert "--bias-is" in loop.supervisor.reason


def unfelt(changes: list[tuple[float, float]]) -> Loop:
    """Return an arm after changes of a constant that it does not feel, at first none.

    Args:
        changes: Part of the constant, and how long it is in force, s.
    """
    constant = 0.09 * SHIPPED.arm.effort_limit * np.eye(7)[2]

    def given(part: float) -> dict[str, object]:
        changed = part * constant
        return {
            "elastic_cable.elbow_pitch": [changed[2]],
            "identification.constant": changed.tolist(),
        }

    loop = Loop(2, constant[2], feels=False, reads=False, **given(0.0)).run(2.0)
    for part, seconds in changes:
        if loop.supervisor.active:
            loop.configure(**given(part))
        loop.run(seconds)
    return loop


@pytest.mark.parametrize(
    "changes",
    [
        [(1.0, 0.02), (0.0, 2.5), (1.0, 3.0)],  # taken back before the arm has felt it
        [*((part, 0.01) for part in np.linspace(0.1, 1.0, 150)), (1.0, 3.0)],  # by a slider
    ],
)
def test_a_constant_that_comes_again_or_little_by_little_is_watched(changes):
    loop = unfelt(changes)
    assert loop.supervisor.status is Status.FAULT
    assert "pushes elbow_pitch" in loop.supervisor.reason
    assert np.degrees(loop.farthest) < FARTHEST


def test_an_arm_whose_clock_is_slow_is_watched_for_as_long_as_it_takes_to_move():
    loop = Loop(2, 0.032, feels=False, reads=True, slow=8, max_stamp_age=0.0, timeout=1.0)
    loop.run(5.0)

    assert loop.supervisor.status is Status.FAULT
    assert np.degrees(loop.farthest) < FARTHEST


def test_a_joint_is_watched_until_it_has_all_of_the_torque():
    """A limit cuts the constant, and is raised."""
    lowered = [LIMIT[0], 0.58, *LIMIT[2:]]
    loop = Loop(1, 0.2, feels=False, reads=False, effort_limit=lowered).run(2.5)
    assert loop.supervisor.active
    loop.configure(effort_limit=LIMIT)
    loop.run(4.0)

    assert loop.supervisor.status is Status.FAULT
    assert "pushes shoulder_pitch" in loop.supervisor.reason
    assert np.degrees(loop.fastest) < FASTEST
    assert np.degrees(loop.farthest) < FARTHEST


def test_a_model_without_that_parameter_starts_as_before():
    loop = Loop(1, 0.3, feels=True, reads=False, known=False).run(0.5)

    assert loop.supervisor.active
    assert HANDS_OFF not in loop.supervisor.reason


def read(
    check: ConstantCheck, position: np.ndarray, now: float, whole: bool = True, pace: float = 1.0
) -> str:
    sample = Sample(round(pace * now * 1e9), position, None, None)
    return check.check(sample, np.zeros(7), now, np.full(7, whole))


def test_a_joint_at_its_stop_is_watched_until_it_has_left_it():
    arm = SHIPPED.arm
    at = 0.5 * (arm.lower + arm.upper)
    at[1] = arm.upper[1] - 0.01
    check = ConstantCheck(arm, 0.3 * np.eye(7)[1], at)
    for now in np.arange(0.0, 20.0, 0.1):
        assert not read(check, at, now)
        assert not check.finished
    assert "shoulder_pitch" in read(check, at - 0.04 * np.eye(7)[1], 20.0)


def test_a_ramp_and_a_slew_limit_do_not_count():
    at = POSE
    check = ConstantCheck(SHIPPED.arm, 0.3 * np.eye(7)[1], at)
    for now in np.arange(0.0, 20.0, 0.1):
        assert not read(check, at, now, whole=False)
        assert not check.finished
    for now in np.arange(20.0, 21.5, 0.1):
        assert not read(check, at, now)
    assert check.finished


def test_stamps_that_run_fast_do_not_end_the_watch():
    check = ConstantCheck(SHIPPED.arm, 0.3 * np.eye(7)[1], POSE)
    for now in np.arange(0.0, 0.9, 0.1):
        assert not read(check, POSE, now, pace=10.0)
    assert not check.finished
