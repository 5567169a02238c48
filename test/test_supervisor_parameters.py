"""Parameters that change while the arm is commanded: no jump, and nothing that no start accepts."""

from __future__ import annotations

import numpy as np
import pytest
from supervisor_loop import (
    ARM,
    AT_ONCE,
    BASE,
    OFF,
    TOLERANT,
    Q,
    SupervisorInLoop,
    settings_of,
    target,
)
from support import MODEL_FILE

from dvrk_gravity.compensate import CONSIDERABLE, Settings, Status

CHANGES = {
    "gravity off": {"gravity_enabled": False},
    "gravity turned": {"gravity_vector": [0.0, 9.81, 0.0]},
    "friction": {"coulomb_friction.joint_positive": [0.05] * 7},
    "ramp time": {"ramp_time": 0.8},
    "slew limit on": {"slew_limit": [50.0] * 7},
}
HEAVY = {"payload.mass": 0.25}  # more than the default start_tolerance accepts

# --- no jump -----------------------------------------------------------------------------------


def test_a_change_of_parameters_never_makes_the_torque_jump():
    moving = np.full(7, 0.015)  # slower than what no two sensors agree on
    options = {"ramp_time": 0.5, "effort_limit": [9.0] * 7, "actuator_effort_limit": [9.0] * 7}
    options |= OFF | TOLERANT | {"friction_compensation.dead_band": [0.0] * 7}
    for case, change in CHANGES.items():
        loop = SupervisorInLoop(**options)
        loop.run(0.7, velocity=moving)
        before = loop.send(velocity=moving)
        loop.configure(**(options | change))
        assert loop.status is Status.RAMPING, case
        largest = np.abs(target(loop, velocity=moving) - before).max()
        for _ in range(450):
            after = loop.send(velocity=moving)
            assert np.abs(after - before).max() <= largest * 0.002 / 0.5 + 1e-12, case
            before = after
        np.testing.assert_allclose(after, target(loop, velocity=moving), atol=1e-12)
        assert loop.holds == 0


def test_lowered_limits_are_approached_at_slew_rate_and_then_kept():
    """The torque under a person's hand does not jump, not even into its limits."""
    options = {"ramp_time": 0.0, "slew_limit": [2.0] * 7}
    loop = SupervisorInLoop(**options)
    loop.run(1.0)
    before = loop.send()
    low = np.maximum(np.abs(before) - 0.9 * CONSIDERABLE * ARM.effort_limit, 0.0)
    loop.configure(effort_limit=low.tolist(), **options)
    excess = np.maximum(np.abs(before) - low, 0).max()
    for _ in range(round(excess / (2.0 * 0.002)) + 1):
        after = loop.send()
        assert np.abs(after - before).max() <= 2.0 * 0.002 + 1e-12
        now = np.maximum(np.abs(after) - low, 0).max()
        assert now < excess or now < 1e-9
        before, excess = after, now
    assert excess < 1e-9


def test_a_command_that_slew_limit_keeps_from_what_is_asked_for_is_a_fault():
    loop = SupervisorInLoop(**AT_ONCE | {"slew_limit": [1e-3] * 7})
    loop.first()
    tolerance = loop.supervisor.settings.start_tolerance * ARM.effort_limit
    way = np.linspace(Q, Q - np.array([0.0, 0.5, 1.2, 0.0, 0.0, 0.0, 0.0]), 300)
    lagging = None
    for position in way:
        command = loop.send(position=position, velocity=[])
        if command is None:
            break
        if lagging is None and (np.abs(target(loop, position) - command) > tolerance).any():
            lagging = loop.now
    assert (loop.status, loop.holds) == (Status.FAULT, 1)
    assert "slew_limit" in loop.reason
    assert loop.now - lagging == pytest.approx(0.1, abs=0.003)


# --- the time-out, and what is not commanded -----------------------------------------------------


def test_the_timeout_is_that_of_the_last_settings():
    loop = SupervisorInLoop(timeout=0.1, **AT_ONCE)
    loop.run(0.3)
    loop.configure(timeout=1.0, **AT_ONCE)
    loop.wait(0.5)
    assert loop.status is not Status.FAULT
    loop.configure(timeout=0.1, **AT_ONCE)
    loop.wait(0.02)
    assert (loop.status, loop.holds) == (Status.FAULT, 1)
    loop.configure(timeout=0.2, **AT_ONCE)  # which starts nothing
    assert loop.run(0.1) == [None] * 50
    assert loop.status is Status.FAULT


def test_other_settings_keep_the_arm_and_an_unchanged_model(tmp_path):
    """Whatever becomes of the arm's file."""
    path = tmp_path / "arm.yaml"
    path.write_bytes((MODEL_FILE.parent / "arms" / "mtmr.yaml").read_bytes())
    given = BASE | {"arm": str(path)}
    first = Settings.from_parameters(given)
    path.rename(tmp_path / "elsewhere.yaml")
    second = Settings.from_parameters(given | {"ramp_time": 0.3}, first)
    assert second.model is first.model
    third = Settings.from_parameters(given | {"beta": [0.1] * 10}, second)
    assert third.model is not first.model
    assert third.model.arm is first.model.arm


# --- what a change says --------------------------------------------------------------------------


def test_a_tenth_of_an_effort_limit_is_a_change_of_support():
    loop = SupervisorInLoop(**AT_ONCE, **TOLERANT)
    loop.first()
    loaded, bare = settings_of(**{"payload.mass": 1e-3}), settings_of()
    per_gram = loaded.static_torque(Q) - bare.static_torque(Q)
    least = 1e-3 * CONSIDERABLE / (np.abs(per_gram) / ARM.effort_limit).max()
    for part, reported in ((0.95, False), (1.05, True)):
        loop.configure(**AT_ONCE, **TOLERANT, **{"payload.mass": part * float(least)})
        assert bool(loop.supervisor.change) is reported


# --- what no start would accept ------------------------------------------------------------------

BEYOND = {
    "a load that is not there": HEAVY,
    "a base turned round": {"gravity_vector": [0.0, 0.0, 9.81]},
    "a wrong zero": {"joint_offset": [0.0, 0.9, 0.0, 0.0, 0.0, 0.0, 0.0]},
    "no weight": {"gravity_enabled": False},
    "limits that let it fall": {"effort_limit": [0.0] * 7},
    "a limit that lets one joint fall": {"effort_limit": [9.0, 0.2, 9.0, 9.0, 9.0, 9.0, 9.0]},
}


def test_a_change_that_asks_for_what_no_start_would_accept_holds_the_arm():
    held = settings_of().static_torque(Q)
    for case, change in BEYOND.items():
        loop = SupervisorInLoop(**AT_ONCE)
        loop.first()
        loop.configure(**AT_ONCE, **change)
        assert (loop.status, loop.holds, loop.supervisor.active) == (Status.WAITING, 1, False), case
        assert loop.send(effort=held) is None
        assert loop.status is Status.STARTING
        answer = loop.first(effort=held)
        if case == "no weight":  # a wish with a flag of its own: it fades from what holds the arm
            np.testing.assert_allclose(answer, held, atol=1e-12)
            assert loop.supervisor.change
        else:
            assert answer is None, case
            assert loop.status is Status.FAULT


def test_friction_that_grows_beyond_what_a_start_may_differ_by_is_confirmed_by_hand():
    """More than `start_tolerance` of the effort limit of wrist_pitch, 0.097 N·m."""
    wrist = np.eye(7)[4]
    for name, size in (("coulomb_friction.joint_positive", 0.5), ("viscous_friction.joint", 1.0)):
        loop = SupervisorInLoop(**AT_ONCE)
        loop.first()
        loop.configure(**AT_ONCE, **{name: (size * wrist).tolist()})
        assert (loop.status, loop.holds) == (Status.FAULT, 1)
        assert "wrist_pitch" in loop.reason
        loop.supervisor.enable()
        assert loop.first() is not None
        loop.configure(**AT_ONCE)  # less of it moves nothing
        assert loop.send() is not None


def test_what_changes_while_the_arm_is_held_for_another_reason_is_confirmed_too():
    options = AT_ONCE | {"resume": "automatic", "disable_builtin": True}
    for gap in (True, False):
        loop = SupervisorInLoop(**options)
        loop.first()
        loop.wait(0.3) if gap else loop.builtin(*[0.1] * 7)
        assert loop.holds == 1
        loop.configure(**options, **HEAVY)
        loop.builtin(*[0.0] * 7)
        assert loop.first() is None
        assert loop.status is Status.FAULT
        assert "~/enable" in loop.reason


def test_small_changes_do_not_add_up_neither_in_one_pause_after_another_nor_in_command():
    options = AT_ONCE | {"resume": "automatic"}
    loop = SupervisorInLoop(**options)
    loop.first()
    for mass in (0.08, 0.16, 0.24):
        loop.wait(0.3)
        loop.configure(**options, **{"payload.mass": mass})
        answer = loop.first()
    assert answer is None
    loop = SupervisorInLoop(**AT_ONCE)
    loop.first()
    reached = 0.0
    while not loop.holds:
        reached += 0.01
        loop.configure(**AT_ONCE, **{"payload.mass": reached})
        loop.send()
        assert reached < 0.25
    assert reached > 0.1


def test_a_change_that_what_is_measured_speaks_against_is_not_taken():
    """Within the tolerance, by an arm that is held as before: nobody has mounted anything."""
    loop = SupervisorInLoop(**AT_ONCE, start_tolerance=0.25)
    loop.first()
    loop.configure(**AT_ONCE, start_tolerance=2.0, **{"payload.mass": 0.19})
    assert loop.status is Status.WAITING
    assert loop.first(effort=settings_of().static_torque(Q)) is None
    assert loop.status is Status.FAULT


def test_a_load_that_is_there_is_taken_over_by_a_new_start():
    """Somebody mounts a tool, and then says so: the arm is held with its weight by then."""
    loop = SupervisorInLoop(**AT_ONCE)
    loop.first()
    loop.configure(**AT_ONCE, **HEAVY)
    assert loop.holds == 1
    with_tool = loop.supervisor.settings.static_torque(Q)
    np.testing.assert_allclose(loop.first(effort=with_tool), with_tool, atol=1e-9)
    loop.configure(**AT_ONCE, **HEAVY, timeout=0.2)
    assert loop.holds == 1  # this is what the last start accepted


def test_without_measured_efforts_a_change_has_to_be_confirmed_and_not_beforehand():
    loop = SupervisorInLoop(**AT_ONCE)
    loop.first()
    loop.supervisor.enable()  # of what is commanded already: it confirms nothing
    loop.configure(**AT_ONCE, **HEAVY)
    assert loop.first() is None
    assert loop.status is Status.FAULT
    loop.supervisor.enable()
    np.testing.assert_allclose(loop.first(), target(loop))


def test_what_a_change_asks_for_is_compared_wherever_the_arm_goes():
    """Folded, a load asks for little; stretched out for more than a start would have allowed."""
    loop = SupervisorInLoop(**AT_ONCE)
    folded = Q + np.array([0.0, 0.4, 0.3, 0.0, 0.0, 0.0, 0.0])
    loop.first(position=folded)
    loop.configure(**AT_ONCE, **{"payload.mass": 0.22})
    assert loop.send(position=folded) is not None
    way = np.linspace(folded, Q, 1000)
    answers = [loop.send(position=position) for position in way]
    assert loop.holds == 1
    assert 10 < sum(answer is not None for answer in answers) < 990


def test_a_tolerance_that_is_raised_is_for_the_next_start():
    loop = SupervisorInLoop(**AT_ONCE)
    loop.first()
    loop.configure(**AT_ONCE, **TOLERANT)
    assert loop.send() is not None
    loop.configure(**AT_ONCE, **TOLERANT, **HEAVY)
    assert (loop.status, loop.holds) == (Status.WAITING, 1)
