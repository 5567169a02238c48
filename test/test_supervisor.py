"""When the compensator commands, and how every end of it asks for exactly one hold."""

from __future__ import annotations

import numpy as np
import pytest
from supervisor_loop import AT_ONCE, MS, Q, SupervisorInLoop, target

from dvrk_gravity.compensate import Status

BOTH = pytest.mark.parametrize("resume", ["explicit", "automatic"])
ON, GONE = [0.1] * 7, [0.0] * 7

# --- input that stops ------------------------------------------------------------------------


def test_input_that_stops_ends_in_one_hold_within_the_timeout_and_a_quarter():
    loop = SupervisorInLoop(timeout=0.1, **AT_ONCE)
    loop.run(0.3)
    begin = loop.now
    while not loop.holds and loop.now < begin + 1.0:
        loop.wait(0.025)
    assert 0.1 < loop.now - begin <= 0.1251
    loop.wait(5.0)
    assert (loop.status, loop.holds) == (Status.FAULT, 1)
    assert "0.1 s" in loop.reason


def test_slow_and_doubled_input_within_the_timeout_is_followed():
    loop = SupervisorInLoop(timeout=0.1, **AT_ONCE)
    loop.first()
    for _ in range(20):
        loop.wait(0.05)
        assert loop.send(after=0.04) is not None
        np.testing.assert_array_equal(loop.send(after=0.0), target(loop))
    assert loop.holds == 0


def test_a_message_after_a_gap_that_no_timer_has_seen_is_not_answered_either():
    """The process itself stood still: the message may have waited in a queue."""
    loop = SupervisorInLoop(timeout=0.1, **AT_ONCE)
    loop.run(0.3)
    assert loop.send(after=0.2) is None
    assert loop.cause == "after_gap"
    assert (loop.status, loop.holds) == (Status.FAULT, 1)


def test_an_answer_that_took_longer_than_the_timeout_is_not_sent():
    """The process stood still between the message and its answer."""
    loop = SupervisorInLoop(timeout=0.1, **AT_ONCE)
    assert loop.first() is not None
    assert loop.supervisor.in_time(loop.now + 0.09)
    assert not loop.supervisor.in_time(loop.now + 0.11)
    loop.settle()
    assert (loop.status, loop.holds) == (Status.FAULT, 1)


def test_after_a_fault_nothing_is_commanded_until_enabled():
    loop = SupervisorInLoop(timeout=0.1, **AT_ONCE)
    loop.run(0.3)
    loop.wait(0.2)
    assert not loop.supervisor.starts_automatically
    assert loop.run(1.0) == [None] * 500
    loop.supervisor.enable()
    assert loop.supervisor.starts_automatically
    np.testing.assert_array_equal(loop.first(), target(loop))


def test_automatic_resumes_with_good_input_but_not_on_its_first_message():
    loop = SupervisorInLoop(timeout=0.1, resume="automatic", **AT_ONCE)
    loop.run(0.3)
    loop.wait(0.5)
    assert loop.holds == 1
    assert loop.supervisor.starts_automatically
    assert loop.send() is None
    assert loop.cause == "after_gap"
    assert loop.first() is not None
    assert loop.holds == 1


# --- stamps that do not go on ------------------------------------------------------------------


@BOTH
def test_a_stamp_that_stands_still_counts_as_no_input(resume):
    loop = SupervisorInLoop(timeout=0.1, resume=resume, **AT_ONCE)
    loop.first()
    frozen, begin = loop.stamp, loop.now
    while not loop.holds and loop.now < begin + 1.0:
        command = loop.send(stamp=frozen)
        assert command is not None or loop.holds
    assert loop.now - begin == pytest.approx(0.1, abs=0.003)
    assert loop.run(1.0, stamp=frozen) == [None] * 500
    assert loop.cause in ("stamp_repeated", "stamp_too_old")
    assert loop.holds == 1
    loop.supervisor.enable()  # which makes such a stamp no better
    assert loop.run(0.5, stamp=frozen) == [None] * 250
    assert loop.first() is not None


def test_stamps_that_creep_are_input_that_stands_still():
    """A tenth of real time is slow motion in simulation; nanoseconds a message are not."""
    for pace, followed in ((0.12, True), (0.05, False), (1e-6, False)):
        loop = SupervisorInLoop(timeout=0.1, max_stamp_age=0.0, **AT_ONCE)
        loop.first()
        begin = loop.stamp
        for k in range(1, 200):
            loop.send(stamp=begin + int(k * pace * 2 * MS))
        assert (loop.holds == 0) is followed, pace


@BOTH
def test_a_stamp_that_steps_back_and_then_stands_still_is_never_answered(resume):
    loop = SupervisorInLoop(timeout=0.1, resume=resume, **AT_ONCE)
    loop.run(0.3)
    frozen = loop.stamp - 1000 * MS
    assert loop.run(0.5, stamp=frozen) == [None] * 250
    loop.supervisor.enable()
    assert loop.run(0.5, stamp=frozen) == [None] * 250
    assert loop.holds == 1


@BOTH
def test_a_stamp_that_moves_on_after_standing_still_ends_in_a_hold_all_the_same(resume):
    """A fault found by the very message that would end it: it gets no command."""
    loop = SupervisorInLoop(timeout=0.1, resume=resume, **AT_ONCE)
    loop.first()
    loop.run(0.099, stamp=loop.stamp)
    assert loop.holds == 0
    assert loop.send(after=0.01) is None
    assert (loop.cause, loop.holds) == ("after_gap", 1)
    assert (loop.first() is not None) == (resume == "automatic")


@pytest.mark.parametrize("step", [-3600.0, 3600.0])
@BOTH
def test_a_step_of_the_arm_s_clock_is_survived(step, resume):
    loop = SupervisorInLoop(timeout=0.1, resume=resume, **AT_ONCE)
    loop.run(0.3)
    loop.stamp += int(step * 1e9)
    loop.run(0.5)
    if step < 0:  # a hold, for until then they might be old messages
        assert loop.holds == 1
        if resume == "explicit":
            assert loop.status is Status.FAULT
            loop.supervisor.enable()
    assert loop.first() is not None
    assert loop.status is Status.COMMANDING


# --- on and off ------------------------------------------------------------------------------


def test_disabling_holds_a_commanded_arm_once_and_no_other():
    loop = SupervisorInLoop(enabled=False, **AT_ONCE)
    assert loop.run(0.3) == [None] * 150
    loop.supervisor.disable()
    loop.settle()
    assert (loop.status, loop.holds) == (Status.DISABLED, 0)
    loop.supervisor.enable()
    assert loop.first() is not None
    for _ in range(3):
        loop.supervisor.disable()
        loop.settle()
    assert loop.run(0.5) == [None] * 250
    loop.wait(1.0)
    assert (loop.status, loop.holds) == (Status.DISABLED, 1)


def test_the_parameter_switches_on_and_off_too_and_leads_out_of_a_fault():
    loop = SupervisorInLoop(**AT_ONCE)
    loop.first()
    loop.configure(enabled=False, **AT_ONCE)
    assert (loop.status, loop.holds, loop.send()) == (Status.DISABLED, 1, None)
    loop.configure(enabled=True, **AT_ONCE)
    assert loop.first() is not None
    loop.supervisor.fail("broken")
    loop.configure(enabled=False, **AT_ONCE)
    assert loop.status is Status.DISABLED
    loop.configure(enabled=True, **AT_ONCE)
    assert loop.first() is not None


# --- errors of our own -----------------------------------------------------------------------


@BOTH
def test_an_error_of_our_own_holds_and_only_enabling_leads_out(resume):
    loop = SupervisorInLoop(resume=resume, **AT_ONCE)
    loop.first()
    loop.supervisor.fail("broken")
    loop.settle()
    assert (loop.status, loop.reason, loop.holds) == (Status.FAULT, "broken", 1)
    assert loop.run(0.5) == [None] * 250
    loop.wait(1.0)
    assert loop.run(0.5)[1:] == [None] * 249
    loop.supervisor.enable()
    assert loop.first() is not None


def test_a_torque_that_is_not_finite_is_an_error_that_names_the_joint():
    cable = {"elastic_cable.wrist_roll": [0.0, 0.0, 0.0, 1e307]}
    loop = SupervisorInLoop(**cable, **AT_ONCE)
    near, far = Q.copy(), Q.copy()
    near[6], far[6] = 0.0, 3.0
    assert loop.first(position=near, velocity=[]) is not None
    assert np.isfinite(loop.send(after=0.09, position=Q, velocity=[])).all()
    assert loop.send(after=0.09, position=far - 0.6 * np.eye(7)[6], velocity=[]) is not None
    assert loop.send(after=0.09, position=far, velocity=[]) is None
    assert (loop.status, loop.holds) == (Status.FAULT, 1)
    assert "wrist_roll" in loop.reason
    assert loop.send() is None


# --- the arm's own compensation --------------------------------------------------------------


@pytest.mark.parametrize("effort", [[0.1] + [0.0] * 6, [np.nan] * 7, [0.0] * 6 + [-1e-9]])
def test_while_the_builtin_compensation_is_on_nothing_is_commanded(effort):
    loop = SupervisorInLoop(**AT_ONCE)
    assert not loop.builtin(*effort)  # not ours to switch off
    assert loop.run(0.2) == [None] * 100
    assert (loop.status, loop.holds) == (Status.WAITING, 0)
    assert "use_gravity_compensation" in loop.reason
    assert "disable_builtin" in loop.reason
    assert loop.supervisor.builtin_active
    loop.builtin(*GONE)
    assert not loop.supervisor.builtin_active
    assert loop.first() is not None


def test_a_builtin_compensation_that_is_switched_on_while_commanding_ends_in_a_fault():
    """Which is not one of the input, even after such a one."""
    loop = SupervisorInLoop(resume="automatic", timeout=0.1, **AT_ONCE)
    loop.run(0.3)
    loop.wait(0.2)
    assert loop.run(0.2)[-1] is not None
    loop.builtin(*ON)
    assert (loop.status, loop.holds) == (Status.FAULT, 2)
    assert "use_gravity_compensation" in loop.reason
    loop.builtin(*ON)
    loop.supervisor.enable()  # overrules nothing
    assert loop.run(0.2) == [None] * 100
    loop.supervisor.fail("made up")
    loop.builtin(*GONE)
    assert loop.run(0.2) == [None] * 100
    assert loop.holds == 2
    loop.supervisor.enable()
    assert loop.first() is not None


def test_one_that_we_may_switch_off_is_waited_for():
    loop = SupervisorInLoop(disable_builtin=True, enabled=False, **AT_ONCE)
    assert not loop.builtin(*ON)  # it may carry an arm that is not ours
    loop.builtin(*GONE)
    loop.supervisor.enable()
    loop.first()
    assert loop.builtin(*ON)
    assert (loop.status, loop.holds) == (Status.WAITING, 1)
    assert "disable_builtin" not in loop.reason
    assert loop.run(0.2) == [None] * 100
    loop.builtin(*GONE)
    assert loop.first() is not None


def test_whoever_switches_it_on_again_and_again_is_not_fought():
    loop = SupervisorInLoop(disable_builtin=True, **AT_ONCE)
    for fought, expected in ((True, Status.WAITING), (True, Status.WAITING), (False, Status.FAULT)):
        assert loop.first() is not None
        assert loop.builtin(*ON) is fought
        assert loop.status is expected
        loop.builtin(*GONE)


# --- what others do ----------------------------------------------------------------------------


def test_an_obstacle_keeps_it_from_starting_and_ends_commanding_in_a_fault():
    loop = SupervisorInLoop(resume="automatic", **AT_ONCE)
    loop.supervisor.obstruct("hold", "nobody listens")
    assert loop.run(0.5) == [None] * 250
    assert (loop.status, loop.reason) == (Status.WAITING, "nobody listens")
    loop.supervisor.obstruct("hold", "")
    assert loop.first() is not None
    loop.supervisor.obstruct("others", "somebody moves the arm")
    loop.settle()
    assert (loop.status, loop.holds) == (Status.FAULT, 1)
    assert loop.reason == "somebody moves the arm"
    loop.supervisor.obstruct("others", "")
    assert loop.run(0.5) == [None] * 250
    loop.supervisor.enable()
    assert loop.first() is not None


def test_of_several_obstacles_each_has_to_go():
    loop = SupervisorInLoop()
    loop.run(0.05)
    assert loop.status is Status.STARTING  # which begins anew
    loop.supervisor.obstruct("a", "one")
    assert (loop.status, loop.holds) == (Status.WAITING, 0)
    loop.supervisor.obstruct("b", "two")
    loop.supervisor.obstruct("a", "")
    assert loop.run(0.5) == [None] * 250
    assert loop.reason == "two"
    loop.supervisor.obstruct("b", "")
    assert loop.run(0.09) == [None] * 45
    assert loop.first() is not None
