"""Which messages are answered: fields, joints, stamps, positions that a joint can have reached."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from supervisor_loop import ARM, AT_ONCE, HELD, MODEL, MS, Q, SupervisorInLoop, target

from dvrk_gravity.arms import FASTEST, JOINT_NAMES, N_JOINTS, UNTIMED_STEP, Arm
from dvrk_gravity.compensate import DroppedSampleError, MotionCheck, Sample, SampleReader, Status

# --- fields ----------------------------------------------------------------------------------

BAD = {
    "no stamp": ({"stamp": 0}, "no_stamp"),
    "joint missing": ({"name": [*JOINT_NAMES[:6], "gripper"]}, "missing_joint"),
    "no names": ({"name": [], "position": [], "velocity": [], "effort": []}, "missing_joint"),
    "joint twice": ({"name": [*JOINT_NAMES, JOINT_NAMES[2]]}, "duplicate_joint"),
    "no position": ({"position": []}, "wrong_length"),
    "eight positions": ({"position": [*Q, 0.0]}, "wrong_length"),
    "six velocities": ({"velocity": [0.0] * 6}, "wrong_length"),
    "position inf": ({"position": [np.inf, *Q[1:]]}, "not_finite"),
    "velocity nan": ({"velocity": [0.0, np.nan, 0, 0, 0, 0, 0]}, "not_finite"),
    "stamp before the last": ({"stamp": 4_000 * MS}, "stamp_backwards"),
    "another pose": ({"position": Q + 1.0}, "position_jump"),
}


def test_a_bad_message_gives_no_command_and_only_such_ones_end_in_a_hold():
    for case, (fields, cause) in BAD.items():
        loop = SupervisorInLoop(**AT_ONCE)
        assert loop.first() is not None
        assert loop.send(**fields) is None, case
        assert loop.cause == cause, case
        assert loop.supervisor.dropped[cause] == sum(loop.supervisor.dropped.values()) == 1
        np.testing.assert_array_equal(loop.send(), target(loop))
        assert loop.holds == 0
        for _ in range(60):
            assert loop.send(**fields) is None
            loop.supervisor.check_input(loop.now)
            loop.settle()
        assert (loop.status, loop.holds) == (Status.FAULT, 1), case


def test_a_message_without_velocity_or_usable_effort_is_answered():
    for fields in ({"velocity": []}, {"effort": []}, {"effort": [np.nan] * 7}):
        loop = SupervisorInLoop(**AT_ONCE)
        loop.first()
        for _ in range(5):
            np.testing.assert_array_equal(loop.send(**fields), target(loop))


def test_without_velocity_no_friction_is_compensated():
    loop = SupervisorInLoop(**AT_ONCE)
    loop.first()
    moving = np.full(7, 0.3)
    settings = loop.supervisor.settings
    with_friction = settings.torque(Q, moving)
    assert np.abs(with_friction - settings.torque(Q, None)).max() > 1e-3
    np.testing.assert_allclose(loop.send(velocity=moving), with_friction, atol=1e-12)
    loop.run(0.1, velocity=[])
    np.testing.assert_allclose(loop.send(velocity=[]), MODEL.torque(Q), atol=1e-12)


# --- joints ----------------------------------------------------------------------------------


def test_joints_are_found_by_name_in_any_order_among_any_others():
    expected = target(SupervisorInLoop(**AT_ONCE))
    rng = np.random.default_rng(0)
    loop = SupervisorInLoop(**AT_ONCE)
    loop.first()
    for _ in range(20):
        order = rng.permutation(N_JOINTS + 2)
        names = np.array([*JOINT_NAMES, "gripper", "gripper"])[order]
        position = np.array([*Q, np.nan, 7.0])[order]  # what the others read is no concern
        effort = np.array([*HELD, np.nan, 7.0])[order]
        zeros = np.zeros(N_JOINTS + 2)
        command = loop.send(name=names, position=position, velocity=zeros, effort=effort)
        np.testing.assert_array_equal(command, expected)
    loop = SupervisorInLoop()
    first = loop.first(name=names, position=position, velocity=zeros, effort=effort)
    np.testing.assert_allclose(first, HELD, atol=1e-15)


def test_a_message_with_bad_names_does_not_change_how_good_ones_are_read():
    loop = SupervisorInLoop(**AT_ONCE)
    loop.first(name=JOINT_NAMES[::-1], position=Q[::-1])
    assert loop.send(name=["a"] * 7) is None
    np.testing.assert_array_equal(loop.send(name=JOINT_NAMES[::-1], position=Q[::-1]), target(loop))
    np.testing.assert_array_equal(loop.send(), target(loop))


def test_joints_of_a_psm_are_not_answered_for_an_ecm_whose_names_they_hold():
    psm, ecm = Arm.load("psm"), Arm.load("ecm")
    reader = SampleReader(ecm)
    still = np.zeros(psm.n)
    own = reader.read(1, ecm.joint_names, still[: ecm.n], (), ())
    assert own.position.tolist() == [0.0] * ecm.n
    with pytest.raises(DroppedSampleError, match="psm") as refused:
        reader.read(2, psm.joint_names, still, (), ())
    assert refused.value.cause == "other_arm"
    beside = (*ecm.joint_names, "camera_button")
    assert reader.read(3, beside, np.zeros(ecm.n + 1), (), ()).stamp == 3


def test_efforts_in_amperes_become_torques_and_a_joint_that_is_held_fixed_must_be_there():
    gains = [2.0, 10.0, 5.0, 4.0]
    reader = SampleReader(
        Arm.load("ecm").with_drive_gains(gains).with_held_joints({"insertion": 0.1})
    )
    names = ("insertion", "roll", "pitch", "yaw")
    sample = reader.read(1, names, [0.1, 0.7, 0.5, 0.3], (), [9.0, 3.0, 4.0, 1.0])
    assert sample.position.tolist() == [0.3, 0.5, 0.7]
    np.testing.assert_array_equal(sample.effort, [2.0, 40.0, 12.0])
    with pytest.raises(DroppedSampleError, match=r"insertion.*0\.2.*0\.1") as refused:
        reader.read(2, names, [0.2, 0.7, 0.5, 0.3], (), ())
    assert refused.value.cause == "not_held"


def test_positions_outside_what_is_allowed_name_the_joint_the_value_and_the_range():
    ecm = Arm.load("ecm")
    margin = np.array([0.1, 0.1, 0.01, 0.1])
    reader, names = SampleReader(ecm, margin), ecm.joint_names
    lowest, highest = ecm.lower - margin, ecm.upper + margin
    for edge in (lowest, highest):
        np.testing.assert_array_equal(reader.read(1, names, edge, (), ()).position, edge)
    slides, turns = np.eye(4)[2], np.eye(4)[0]
    for position, tokens in (
        (slides * 2.5, ("insertion", "2.5 m", f"{lowest[2]:.4g} to {highest[2]:.4g}")),
        (turns * -4.5, ("yaw", "-4.5 r")),
    ):
        with pytest.raises(DroppedSampleError) as refused:
            reader.read(1, names, position, (), ())
        assert refused.value.cause == "out_of_range"
        assert all(token in str(refused.value) for token in tokens)


# --- stamps beside the node's clock --------------------------------------------------------------


def test_a_stamp_too_far_from_the_node_s_clock_is_refused_if_asked_for():
    loop = SupervisorInLoop(max_stamp_age=0.05, **AT_ONCE)
    loop.late = 50 * MS
    assert loop.first() is not None
    for late, cause in ((51, "stamp_too_old"), (-51, "stamp_ahead")):
        loop.late = late * MS
        assert loop.send() is None
        assert loop.cause == cause
    loop.late = -loop.stamp - 2 * MS  # simulated time, which nobody publishes
    assert loop.send() is None
    assert loop.cause == "no_clock"
    unasked = SupervisorInLoop(max_stamp_age=0.0, **AT_ONCE)
    unasked.late = 10_000 * MS
    assert unasked.first() is not None


# --- positions and velocities that can be true -----------------------------------------------


def test_a_joint_goes_as_far_as_the_fastest_and_a_step_and_no_further():
    step, arm = 0.004, Arm.load("ecm")
    for joint in (0, 2):  # it turns; it slides
        for part, believed in ((0.99, True), (1.01, False), (-1.01, False)):
            check = MotionCheck(arm)
            position = np.zeros(4)
            check.check(Sample(0, position, None, None), 10.0, 0.1)
            moved = position.copy()
            moved[joint] = part * (UNTIMED_STEP + FASTEST * step) * arm.scale[joint]
            later = Sample(round(step * 1e9), moved, None, None)
            if believed:
                assert check.check(later, 10.0 + step, 0.1) is later
            else:
                with pytest.raises(DroppedSampleError, match=arm.joint_names[joint]) as refused:
                    check.check(later, 10.0 + step, 0.1)
                assert refused.value.cause == "position_jump"
                with pytest.raises(DroppedSampleError):  # until the time-out has passed
                    check.check(replace(later, stamp=later.stamp + 1), 10.09, 0.1)
                check.check(replace(later, stamp=later.stamp + 2), 10.2, 0.1)


def test_a_velocity_that_contradicts_the_positions_drives_no_joint():
    loop = SupervisorInLoop(**AT_ONCE)
    loop.first()
    at_rest = loop.send()
    wrong = [0.0, 3.0, 0.0, 0.0, 0.0, 0.0, 1e6]
    loop.run(0.05, velocity=wrong)
    np.testing.assert_allclose(loop.send(velocity=wrong), at_rest, atol=1e-9)
    assert loop.supervisor.doubtful.tolist() == [False, True, False, False, False, False, True]
    loop.run(0.5)
    assert not loop.supervisor.doubtful.any()


def test_positions_and_velocities_of_two_motions_end_in_a_hold():
    for velocity, drift in ((0.5, 0.0), (-0.5, 0.0), (0.0, 0.06), (0.0, -0.06)):
        loop = SupervisorInLoop(**AT_ONCE)
        loop.first()
        speed, position = velocity * np.eye(7)[1], Q.copy()
        answered = 0
        while loop.status is not Status.FAULT and answered < 1000:
            position[1] += 0.002 * drift
            answered += loop.send(position=position.copy(), velocity=speed) is not None
        assert (loop.status, loop.holds) == (Status.FAULT, 1)
        assert ARM.joint_names[1] in loop.reason
        assert 0.1 < 0.002 * answered < 1.0


def test_a_velocity_that_lags_or_is_half_as_large_again_is_no_contradiction():
    for factor, lag in ((1.4, 0.0), (0.7, 0.0), (1.0, 0.05)):
        loop = SupervisorInLoop(**AT_ONCE)
        loop.first()
        for k in range(2000):
            time = 0.002 * k
            position = Q + 0.2 * (1.0 - np.cos(3.0 * time)) * np.eye(7)[1]
            speed = factor * 0.6 * np.sin(3.0 * max(time - lag, 0.0)) * np.eye(7)[1]
            assert loop.send(position=position, velocity=speed) is not None, (factor, lag)


def test_reported_and_observed_velocity_may_differ_by_half_of_the_larger():
    """The joint moves at 2 rad/s; 0.5 rad/s are encoders' ripple."""
    step, speed = 0.002, 2.0
    for factor, wrong in (
        (0.0, True), (0.3, False), (1.0, False), (2.4, False), (2.6, True), (-1.0, True),
        (57.3, True),
    ):  # fmt: skip
        check = MotionCheck(ARM)
        for k in range(400):
            velocity, position = np.full(7, factor * speed), np.full(7, k * step * speed)
            sample = Sample(round(k * step * 1e9), position, velocity, None)
            believed = check.check(sample, 10.0 + k * step, 0.1)
        assert check.doubtful.tolist() == [wrong] * 7, factor
        assert believed.velocity[0] == pytest.approx(0.0 if wrong else factor * speed)
        assert check.velocity[0] == pytest.approx(speed if wrong else factor * speed, rel=1e-3)


def test_a_pose_five_degrees_outside_the_limits_is_reported():
    for way, edge in ((1.0, ARM.upper), (-1.0, ARM.lower)):
        for beyond, outside in ((0.08, False), (0.095, True)):
            loop = SupervisorInLoop(**AT_ONCE)
            position = Q.copy()
            position[5] = edge[5] + way * beyond
            assert loop.first(position=position) is not None
            assert loop.supervisor.compensation.outside.tolist() == [*[False] * 5, outside, False]


def test_messages_that_come_later_and_later_are_stale_though_clocks_may_drift_apart():
    for growth, held in ((0.1, True), (5e-4, False)):  # s of delay in each s
        loop = SupervisorInLoop(**AT_ONCE)
        loop.first()
        for _ in range(1000):
            loop.late += int(growth * 0.02 * 1e9)
            loop.send(after=0.02)
            if loop.cause:
                break
        assert bool(loop.cause) is held
    assert loop.holds == 0
    loop.late += int(0.2 * 1e9)
    loop.send()
    assert loop.cause == "stamp_too_old"
    while not loop.holds:
        assert loop.send() is None
        loop.supervisor.check_input(loop.now)
        loop.settle()
    assert loop.status is Status.FAULT
    loop.supervisor.enable()  # a delay that stays may be that of two clocks
    assert loop.first() is not None
