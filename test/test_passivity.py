"""Friction compensation that is too large stays bounded; one that is right is left alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from supervisor_loop import ARM, AT_ONCE, MODEL, Q, SupervisorInLoop, settings_of

from dvrk_gravity.compensate import SETTINGS, PassivityObserver, SpeedGuard, Status
from dvrk_gravity.effects import State

ONES = np.ones(7)
RATIO = 0.7
ALLOWANCE = np.full(7, 0.5)
ALONE = np.zeros(7, dtype=bool)
DT = 1e-3


def observer(part=RATIO, allowance=ALLOWANCE, coupled=ALONE) -> PassivityObserver:
    return PassivityObserver(np.full(7, part), np.asarray(allowance), coupled)


# --- seven oscillators: joints with dry friction in springy hands ----------------------------

START = 0.4  # rad/s
FRICTION = np.array([0.02, 0.04, 0.02, 0.04, 0.006, 0.002, 0.001])
INERTIA = np.array([0.06, 0.05, 0.03, 0.003, 0.0005, 0.0003, 0.00002])


def swing(watch, excess, delay, frequency, mass, damping=0.0, duration=9.0):
    """Return (N, 7) speeds of the joints, each in a hand of its own, pushed off with a speed.

    The velocity is rounded to 0.05 rad/s and comes late. Friction is dry; implicit in each step.
    """
    inertia = INERTIA * (1.0 + mass)
    omega = 2 * np.pi * frequency
    stiffness, damping = inertia * omega**2, 2 * damping * inertia * omega
    x, v = 0.0 * ONES, START * ONES
    random = np.random.default_rng(1)
    lag = round(delay / DT)
    past = [v] * (lag + 1)
    speeds = np.empty((round(duration / DT), 7))
    for step in range(len(speeds)):
        seen = past[-1 - lag] + 0.005 * random.standard_normal(7)
        seen = np.round(seen / 0.05) * 0.05
        friction = RATIO * (1.0 + excess) * FRICTION * np.sign(seen) * (np.abs(seen) > 0.04)
        factor = ONES if watch is None else watch.update(seen, friction, step * DT)
        momentum = inertia * v + DT * (factor * friction - stiffness * x - damping * v)
        v = np.sign(momentum) * np.maximum(np.abs(momentum) - DT * FRICTION, 0.0) / inertia
        x = x + DT * v
        past = [*past[-lag:], v] if lag else [v]
        speeds[step] = np.abs(v)
    return speeds


def bound(excess, delay, frequency, mass):
    """Return the (7,) speeds that a joint may reach.

    Until the last top it was within the allowance; then it gains what one swing feeds, of which the
    spring gives back after the allowance is passed, and what passes until the delayed velocity has
    shown it and the factor is down.
    """
    push = (RATIO * (1.0 + excess) - 1.0) * FRICTION / (INERTIA * (1.0 + mass))
    way = 2 * ALLOWANCE / (2 * np.pi * frequency) if frequency else 0.0
    return 1.15 * np.sqrt(ALLOWANCE**2 + 2 * push * way) + push * (delay + 0.025)


def test_in_a_passive_hand_or_in_none_no_joint_gets_beyond_the_bound():
    for excess, delay, frequency, mass in (
        (1.0, 0.03, 3.0, 0.0), (1.0, 0.03, 1.5, 10.0), (1.0, 0.03, 0.0, 0.0), (0.5, 0.0, 0.7, 0.0),
    ):  # fmt: skip
        speeds = swing(observer(), excess, delay, frequency, mass)
        beyond = speeds.max(axis=0) / bound(excess, delay, frequency, mass)
        assert (beyond <= 1.0).all(), (excess, delay, frequency, mass)


def test_without_the_observer_the_same_joints_run_away():
    for frequency, excess in ((0.0, 0.5), (3.0, 1.0)):
        speeds = swing(None, excess, 0.03, frequency, 0.0)
        beyond = speeds[-3000:].max(axis=0) > 3 * bound(excess, 0.03, frequency, 0.0)
        assert beyond[3:6].all()


def test_a_model_that_is_right_is_left_alone_in_a_passive_hand():
    watch = observer()
    factors = []
    update = watch.update
    watch.update = lambda *given: factors.append(update(*given)) or factors[-1]
    swing(watch, 0.0, 0.01, 1.0, 0.0)
    assert np.min(factors) == 1.0


# --- a hand that works -----------------------------------------------------------------------


def moved(watch, speeds):
    """Return (N, 7) factors along (N,) speeds of all joints, right friction compensated."""
    friction = RATIO * 0.01
    return np.array(
        [
            watch.update(np.full(7, v), np.full(7, friction * np.sign(v)), k * DT)
            for k, v in enumerate(speeds)
        ]
    )


TIME = np.arange(0.0, 8.0, DT)


def test_a_steady_motion_faster_than_the_allowance_has_all_of_its_compensation():
    factors = moved(observer(), 2.0 * np.sin(2 * np.pi * TIME))
    assert factors[: len(TIME) // 8].min() < 1.0  # it was asked for at the beginning …
    assert factors[len(TIME) // 4 :].min() == 1.0  # … and shown to be a hand's work


def test_a_slow_motion_is_never_asked_for_anything():
    assert moved(observer(), 0.49 * np.sin(2 * np.pi * TIME)).min() == 1.0


def test_what_was_fed_is_paid_before_the_hand_is_believed():
    watch, friction = observer(), np.full(7, 0.02)
    speeds = np.concatenate([np.linspace(0.1, 0.5, 400), np.full(600, 0.6)])
    factors = np.array(
        [watch.update(np.full(7, v), friction, k * DT)[0] for k, v in enumerate(speeds)]
    )
    sure = SETTINGS.certain_friction / RATIO
    net = np.cumsum((factors - sure) * 0.02 * speeds) * DT
    low = int(np.flatnonzero(factors < 1.0)[0])
    back = low + int(np.flatnonzero(np.diff(factors[low:]) > 0)[0])
    assert net[low] > 0.0
    assert net[back] < 0.02 * net[low]
    assert back - low >= SETTINGS.settling_time / DT
    assert factors[-1] == 1.0


def test_joints_that_share_motors_have_one_factor():
    coupled = np.array([0, 1, 1, 1, 0, 0, 0], dtype=bool)
    watch = observer(coupled=coupled)
    velocity = np.array([0.1, 0.1, 2.0, 0.1, 0.1, 0.1, 0.1])
    for k in range(40):
        factor = watch.update(velocity, 0.01 * ONES, k * DT)
    np.testing.assert_array_equal(factor == 1.0, ~coupled)
    assert np.ptp(factor[coupled]) == 0.0


# --- which part of the torque is friction, and how much of it is compensated -------------------

MOVING = np.linspace(-0.5, 0.5, 7)
CABLE = MODEL.term("directional_cable")


def test_the_two_parts_of_a_torque_make_it_up_and_friction_is_what_velocity_adds():
    settings = settings_of(**{"viscous_friction.joint": [0.01] * 7})
    conservative, friction = settings.parts(Q, MOVING)
    np.testing.assert_allclose(conservative + friction, settings.torque(Q, MOVING), atol=1e-15)
    np.testing.assert_allclose(conservative, settings.torque(Q, None), atol=1e-14)
    assert friction[6] == pytest.approx(0.7 * 0.01 * 0.5)


def test_of_a_cable_s_friction_the_asked_part_is_compensated_or_the_console_s_if_that_is_less():
    asked = np.array([0.1, 0.1, 0.6, 0.1, 0.9, 0.0, 0.5])
    settings = settings_of(**{"friction_compensation.ratio": asked.tolist()})
    whole = replace(CABLE, blend=replace(CABLE.blend, ratio=np.ones(7)))
    up, down = (whole.torque(State(Q, way * 0.3 * ONES)) for way in (1, -1))
    expected = np.minimum(asked, CABLE.blend.ratio) * 0.5 * (up - down)
    np.testing.assert_allclose(settings.parts(Q, 0.3 * ONES)[1], expected, atol=1e-15)


def test_friction_compensation_s_ratio_and_dead_band_hold_inside_a_directional_cable():
    still = settings_of().torque(Q, None)
    for blend in ({"directional_cable.blend": "linear"}, {"directional_cable.blend": "sine"}):
        off = settings_of(**blend, **{"friction_compensation.ratio": [0.0] * 7})
        np.testing.assert_allclose(off.torque(Q, 0.3 * ONES), still, atol=1e-14)
        band = settings_of(**blend, **{"friction_compensation.dead_band": [0.2] * 7})
        np.testing.assert_allclose(band.torque(Q, 0.19 * ONES), still, atol=1e-14)
        assert np.abs(band.torque(Q, 0.21 * ONES) - still)[:6].min() > 1e-5


def test_the_part_that_is_compensated_is_the_largest_of_a_joint_s_frictions():
    cables = np.minimum(0.7, CABLE.blend.ratio)
    cables[1:4] = cables[1:4].max()  # they share motors
    np.testing.assert_allclose(settings_of().friction_part, cables)
    rubs = settings_of(**{"viscous_friction.joint": [0.01] * 7})
    np.testing.assert_allclose(rubs.friction_part, 0.7)


# --- the guard of speed ----------------------------------------------------------------------


def guarded(speeds, command):
    """Return the first reason and its time along (N,) speeds of joint 2."""
    guard = SpeedGuard(ARM, np.full(7, 4.0))
    for k, speed in enumerate(speeds):
        velocity = np.zeros(7)
        velocity[1] = speed
        reason = guard.check(velocity, np.full(7, command), k * DT)
        if reason:
            return reason, k * DT
    return None, None


def test_a_joint_that_the_command_drives_beyond_its_limit_is_told():
    reason, when = guarded(np.linspace(3.0, 6.0, 600), 0.01)
    assert ARM.joint_names[1] in reason
    assert "rad/s" in reason
    assert when == pytest.approx(0.2 + 0.1, abs=0.003)  # it passes 4 rad/s at 0.2 s
    assert guarded(-np.linspace(3.0, 6.0, 600), -0.01)[0]


def test_a_joint_that_moves_against_the_command_is_not_the_compensator_s_doing():
    assert guarded(np.linspace(3.0, 6.0, 600), -0.01) == (None, None)


def test_a_joint_that_was_thrown_and_slows_down_or_pauses_is_left_alone():
    assert guarded(np.linspace(8.0, 3.0, 600), 0.01) == (None, None)
    flick = 6.0 * np.sin(np.pi * np.arange(0, 0.16, DT) / 0.16)
    assert guarded(flick, 0.01) == (None, None)
    pausing = np.full(1000, 5.0)
    pausing[::90] = 3.9
    assert guarded(pausing, 0.01) == (None, None)


# --- in the supervisor -------------------------------------------------------------------------


def rolled(loop: SupervisorInLoop, speed: float, velocity: float | None) -> list:
    """Return the answers to wrist_roll turning for half a second, whatever velocity it reports."""
    loop.first()
    position, answers = Q, []
    told = [] if velocity is None else velocity * np.eye(7)[6]
    for _ in range(250):
        position = position + 0.002 * speed * np.eye(7)[6]
        answers.append(loop.send(position=position, velocity=told))
    return answers


def test_a_joint_that_the_command_drives_along_is_held_whatever_it_says_of_its_speed():
    """A constant torque at wrist_roll, which its positions show to turn."""
    pushed = {"speed_limit": [2.0] * 7, "elastic_cable.wrist_roll": [0.005]}
    for speed, velocity, held in (
        (3.0, 3.0, True), (3.0, None, True), (3.0, 0.0, True), (1.5, 1.5, False),
        (-3.0, -3.0, False),
    ):  # fmt: skip
        loop = SupervisorInLoop(**AT_ONCE, **pushed)
        answers = rolled(loop, speed, velocity)
        assert (answers[-1] is None) is held, (speed, velocity)
        assert (loop.status is Status.FAULT, loop.holds) == (held, held)
        assert not held or "wrist_roll" in loop.reason


def test_friction_that_may_feed_the_motion_is_held_back_in_the_command_and_reported():
    """Faster than the allowance and than lately: for a while what is sure pays, and no more."""
    loop = SupervisorInLoop(**AT_ONCE, **{"viscous_friction.joint": [0.0] * 6 + [0.0005]})
    speed, settings = 4.0, loop.supervisor.settings
    assert speed > settings.allowance[6]
    answers = rolled(loop, speed, speed)
    friction = settings.parts(Q, speed * np.eye(7)[6])[1][6]
    added = [answer[6] - settings.torque(Q, None)[6] for answer in answers]
    assert added[0] == pytest.approx(friction)
    assert min(added) == pytest.approx(0.0, abs=1e-9)
    assert added[-1] == pytest.approx(friction)  # a hand's work
    assert not loop.supervisor.compensation.friction_held_back.any()


def test_parameters_that_keep_changing_do_not_make_the_guard_forget():
    values = {"speed_limit": [2.0] * 7, "elastic_cable.wrist_roll": [0.005]}
    loop = SupervisorInLoop(**AT_ONCE, **values)
    loop.first()
    position, answer = Q, None
    for k in range(250):
        position = position + 0.006 * np.eye(7)[6]
        answer = loop.send(position=position, velocity=3.0 * np.eye(7)[6])
        if k % 25 == 0 and loop.supervisor.active:
            limits = [2.0 + 0.001 * (k % 2)] * 7
            loop.configure(**AT_ONCE, **values | {"speed_limit": limits})
    assert answer is None
    assert loop.holds == 1
