"""Which watchdog a compensator believes, by what the watchdogs say of themselves."""

from __future__ import annotations

import pytest

from dvrk_gravity.compensate import UNWATCHED, Watchdogs, unseen_commands
from dvrk_gravity.compensate import WatchdogStatus as Status

OURS, DEFAULT, HOLD = "/ARM/effort_controller/commands", "/ARM/servo_jf", "/ARM/hold"
NODE, US = "/ARM/watchdog", "0a1b"
HEARD = frozenset((US, "ff00"))
NOW = 50.0


def obstacle(*said: Status, timeout: float = 0.1, active: bool = False) -> str:
    watchdogs = Watchdogs(OURS, HOLD)
    for each in said:
        watchdogs.note(each, NOW)
    watchdogs.look({each.node for each in said}, {US})
    return watchdogs.obstacle(timeout, NOW, active)


@pytest.mark.parametrize("active", [False, True])
def test_a_watchdog_that_watches_another_topic_or_holds_another_arm_is_refused_with_both(active):
    for topic, hold in ((DEFAULT, HOLD), (OURS, "/OTHER/hold"), (f"{OURS}/", HOLD)):
        refused = obstacle(Status(NODE, topic, hold, 0.1), active=active)
        assert "\n" not in refused
        for token in (NODE, topic, hold, OURS, HOLD, "output_topic"):
            assert token in refused


def test_one_that_watches_our_topic_is_enough_whatever_others_watch():
    other = Status("/ARM/another", DEFAULT, HOLD, 0.002)
    assert obstacle(other, Status(NODE, OURS, HOLD, 0.1, HEARD)) == ""


def test_our_time_out_must_not_be_longer_than_that_of_any_watchdog_of_ours():
    said = Status(NODE, OURS, HOLD, 0.4, HEARD), Status("/ARM/another", OURS, HOLD, 0.2, HEARD)
    assert obstacle(*said, timeout=0.2) == ""
    assert "0.2 s" in obstacle(*said, timeout=0.3, active=True)


def test_without_a_watchdog_the_arm_is_commanded_and_that_is_said():
    watchdogs = Watchdogs(OURS, HOLD, appear=NOW)
    assert "watchdog" in watchdogs.obstacle(0.1, NOW - 1.0, active=False)
    assert watchdogs.obstacle(0.1, NOW - 1.0, active=True) == ""
    assert watchdogs.obstacle(0.1, NOW, active=False) == ""
    assert watchdogs.unwatched_reason(NOW).endswith(f"{OURS}: {UNWATCHED}")
    watchdogs.note(Status(NODE, OURS, HOLD, 0.1, HEARD), NOW)
    watchdogs.look({NODE}, {US})
    assert watchdogs.unwatched_reason(NOW) == ""
    watchdogs.look((), {US})  # it has ended: what it said holds no arm
    assert UNWATCHED in watchdogs.unwatched_reason(NOW)
    watchdogs.look({NODE}, {US})  # another one of that name
    assert UNWATCHED in watchdogs.unwatched_reason(NOW)
    assert "watchdog" in watchdogs.obstacle(0.1, NOW, active=False)


def test_one_that_has_fallen_silent_is_believed_no_longer_though_it_is_there():
    """A process that is suspended keeps its topics, and what it has latched."""
    watchdogs = Watchdogs(OURS, HOLD)
    watchdogs.note(Status(NODE, OURS, HOLD, 0.1, HEARD), NOW)
    watchdogs.look({NODE}, {US})
    assert watchdogs.unwatched_reason(NOW + 3.0) == ""
    for token in (NODE, UNWATCHED):
        assert token in watchdogs.unwatched_reason(NOW + 6.0)
    watchdogs.note(Status(NODE, OURS, HOLD, 0.1, HEARD), NOW + 7.0)
    assert watchdogs.unwatched_reason(NOW + 8.0) == ""


def test_one_that_has_not_spoken_yet_is_waited_for_but_not_in_flight():
    watchdogs = Watchdogs(OURS, HOLD)
    watchdogs.look({NODE}, {US})
    assert "watchdog" in watchdogs.obstacle(0.1, NOW, active=False)
    assert watchdogs.obstacle(0.1, NOW, active=True) == ""
    assert UNWATCHED in watchdogs.unwatched_reason(NOW)


def test_one_that_our_first_command_would_not_reach_yet_is_waited_for():
    deaf = Status(NODE, OURS, HOLD, 0.1, frozenset(("ff00",)))
    assert OURS in obstacle(deaf)
    assert obstacle(deaf, active=True) == ""
    watchdogs = Watchdogs(OURS, HOLD)
    watchdogs.note(deaf, NOW)
    watchdogs.look({NODE}, {US})
    assert UNWATCHED in watchdogs.unwatched_reason(NOW)
    watchdogs.note(Status(NODE, OURS, HOLD, 0.1, HEARD), NOW)
    assert watchdogs.unwatched_reason(NOW) == ""
    watchdogs.look({NODE}, ())  # we do not know our own publisher yet
    assert watchdogs.obstacle(0.1, NOW, active=False)


def test_what_it_says_replaces_what_one_of_its_name_said_before():
    first, second = Status(NODE, DEFAULT, HOLD, 0.1), Status(NODE, OURS, HOLD, 0.1, HEARD)
    assert obstacle(first, second) == ""
    assert DEFAULT in obstacle(second, first)


def test_what_it_publishes_is_read_as_it_was_and_nothing_else_is_believed():
    said = Status(NODE, OURS, HOLD, 0.1, HEARD)
    assert Status.of(NODE, said.values()) == said
    for key, value in (
        ("timeout s", "nan"), ("timeout s", "-1"), ("timeout s", "inf"), ("timeout s", "soon"),
        ("topic", None), ("hold", None), ("timeout s", None), ("heard", None),
    ):  # fmt: skip
        values = said.values() | {key: value}
        assert Status.of(NODE, {k: v for k, v in values.items() if v is not None}) is None


def test_a_watchdog_says_that_compensators_command_where_it_does_not_watch():
    unseen = unseen_commands(DEFAULT, {"/ARM/compensator": [OURS], "/ARM/echo": []})
    for token in (DEFAULT, OURS, "/ARM/compensator", "output_topic"):
        assert token in unseen
    assert unseen_commands(OURS, {"/ARM/compensator": [OURS]}) == ""
    assert unseen_commands(OURS, {"/ARM/one": [OURS], "/ARM/two": [DEFAULT]}) == ""
    assert unseen_commands(OURS, {}) == ""
    assert unseen_commands(OURS, {"/ARM/echo": []}) == ""
