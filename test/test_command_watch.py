"""The watchdog decides on a clock of the test's own when an arm has to be held."""

from __future__ import annotations

import pytest

from dvrk_gravity.compensate import CommandWatch

TIMEOUT = 0.1


def looked_at(watch: CommandWatch, begin: float, end: float) -> list[float]:
    """Look four times in a time-out, as the node's timer; return the times at which to hold."""
    count = round((end - begin) / (TIMEOUT / 4))
    times = [begin + k * TIMEOUT / 4 for k in range(1, count + 1)]
    return [now for now in times if watch.check(now) > 0.0]


def test_commands_that_stop_end_in_one_hold_within_the_time_out_and_a_quarter():
    watch = CommandWatch(TIMEOUT)
    for k in range(20):
        assert watch.note_command(10.0 + 0.01 * k) is (k == 0)
    (held,) = looked_at(watch, 10.19, 15.0)
    assert TIMEOUT < held - 10.19 <= 1.25 * TIMEOUT + 1e-9
    assert not watch.commanded


def test_a_silence_of_the_time_out_is_allowed_and_a_longer_one_is_returned_once():
    watch = CommandWatch(0.125)
    watch.note_command(10.0)
    assert watch.check(10.125) == 0.0
    assert watch.commanded
    assert watch.check(10.25) == pytest.approx(0.25)
    assert watch.check(10.3) == 0.0


def test_each_command_counts_from_its_own_time():
    watch = CommandWatch(TIMEOUT)
    for k in range(10):
        watch.note_command(10.0 + 0.09 * k)
        assert watch.check(10.0 + 0.09 * k + 0.08) == 0.0
    assert watch.commanded


def test_an_arm_that_was_never_commanded_is_left_alone():
    watch = CommandWatch(TIMEOUT)
    assert looked_at(watch, 10.0, 20.0) == []
    assert watch.note_hold() is False
    assert not watch.commanded


def test_commands_that_end_with_a_hold_need_no_other():
    watch = CommandWatch(TIMEOUT)
    watch.note_command(10.0)
    assert watch.note_hold() is True
    assert watch.note_hold() is False
    assert looked_at(watch, 10.0, 20.0) == []


def test_after_a_hold_the_next_commands_are_watched_again():
    watch = CommandWatch(TIMEOUT)
    watch.note_command(10.0)
    assert watch.check(11.0) > 0.0
    assert watch.note_command(12.0) is True
    assert watch.commanded
    assert len(looked_at(watch, 12.0, 13.0)) == 1
