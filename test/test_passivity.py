"""Friction compensation that is too large stays bounded; one that is right is left alone."""

from __future__ import annotations

import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from support import MODEL_FILE

from dvrk_gravity import TorqueModel
from dvrk_gravity.arms import JOINT_NAMES
from dvrk_gravity.compensate import (
    SETTINGS,
    PassivityObserver,
    SampleReader,
    Settings,
    SpeedGuard,
    Status,
    Supervisor,
    speed_guard,
)
from dvrk_gravity.effects import DirectionalCable, State
from dvrk_gravity.simulate import SimulatedArm

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmark"))
import passivity as benchmark

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


@pytest.mark.parametrize("delay", [pytest.param(0.0, marks=pytest.mark.slow), 0.03])
@pytest.mark.parametrize("excess", [pytest.param(0.5, marks=pytest.mark.slow), 1.0])
@pytest.mark.parametrize(("frequency", "mass"), [(0.7, 0.0), (3.0, 0.0), (1.5, 10.0), (0.0, 0.0)])
def test_in_a_passive_hand_or_in_none_no_joint_gets_beyond_the_bound(
    frequency, mass, excess, delay
):
    speeds = swing(observer(), excess, delay, frequency, mass)
    assert (speeds.max(axis=0) <= bound(excess, delay, frequency, mass)).all()


def test_without_the_observer_the_same_joints_run_away():
    for frequency, excess in ((0.0, 0.5), (3.0, 1.0)):
        speeds = swing(None, excess, 0.03, frequency, 0.0)
        beyond = speeds[-3000:].max(axis=0) > 3 * bound(excess, 0.03, frequency, 0.0)
        assert beyond[3:6].all()


def test_an_arm_that_is_pushed_off_and_let_go_comes_to_rest():
    for delay in (0.0, 0.03):
        late = swing(observer(), 0.5, delay, 0.0, 0.0)[-3000:]
        assert late[:, 3:].max() == 0.0  # the first three joints take longer to get anywhere


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


def test_what_the_arm_s_friction_surely_takes_may_be_compensated_at_any_speed():
    factors = moved(observer(part=SETTINGS.sure), 5.0 * np.sin(2 * np.pi * TIME))
    # It owes nothing: what is asked for is the time to see it.
    assert factors.mean() > 0.9
    assert factors[len(TIME) // 4 :].min() == 1.0


def test_what_was_fed_is_paid_before_the_hand_is_believed():
    watch, friction = observer(), np.full(7, 0.02)
    speeds = np.concatenate([np.linspace(0.1, 0.5, 400), np.full(600, 0.6)])
    factors = np.array(
        [watch.update(np.full(7, v), friction, k * DT)[0] for k, v in enumerate(speeds)]
    )
    sure = SETTINGS.sure / RATIO
    net = np.cumsum((factors - sure) * 0.02 * speeds) * DT
    low = int(np.flatnonzero(factors < 1.0)[0])
    back = low + int(np.flatnonzero(np.diff(factors[low:]) > 0)[0])
    assert net[low] > 0.0
    assert net[back] < 0.02 * net[low]
    assert back - low >= SETTINGS.settling / DT
    assert factors[-1] == 1.0


def test_joints_that_share_motors_have_one_factor():
    coupled = np.array([0, 1, 1, 1, 0, 0, 0], dtype=bool)
    watch = observer(coupled=coupled)
    velocity = np.array([0.1, 0.1, 2.0, 0.1, 0.1, 0.1, 0.1])
    for k in range(40):
        factor = watch.update(velocity, 0.01 * ONES, k * DT)
    np.testing.assert_array_equal(factor == 1.0, ~coupled)
    assert np.ptp(factor[coupled]) == 0.0


def test_without_velocities_nothing_is_reckoned():
    watch = observer()
    for k in range(100):
        np.testing.assert_array_equal(watch.update(None, 0.0 * ONES, k * DT), ONES)


# --- the whole arm ---------------------------------------------------------------------------


@pytest.mark.parametrize("hand", [benchmark.Hand(0.0), benchmark.Hand(3.0)])
def test_the_whole_arm_with_twice_its_friction_stays_within_the_bound_in_a_passive_hand(hand):
    allowed = benchmark.bound(hand, 0.03, 1.0)
    with_it = benchmark.in_hand(hand, 1.0, 0.03, True, 1.5).max(axis=0)
    without = benchmark.in_hand(hand, 1.0, 0.03, False, 1.5).max(axis=0)
    assert (with_it <= allowed).all()
    assert (without > allowed).any()


# --- friction inside a directional cable -----------------------------------------------------


def shipped(**changes) -> Settings:
    values = TorqueModel.load(MODEL_FILE).parameters()
    return Settings.from_parameters(values | changes)


POSE = np.array([-0.2, 0.15, 0.1, 0.5, 1.0, 0.1, 0.0])


def cable() -> DirectionalCable:
    term = shipped().model.term("directional_cable")
    assert isinstance(term, DirectionalCable)
    return term


def test_a_directional_cable_is_its_elastic_part_and_its_friction():
    state = State(POSE, np.linspace(-0.3, 0.3, 7))
    both = cable().elastic().torque(state) + cable().scaled(ONES).torque(state)
    np.testing.assert_allclose(both, cable().torque(state), atol=1e-15)


def test_half_of_a_cable_s_friction_is_the_asked_part_or_the_console_s_if_that_is_less():
    state = State(POSE, np.full(7, 0.3))
    whole = replace(cable(), ratio=ONES)
    asked = np.array([0.1, 0.1, 0.6, 0.1, 0.9, 0.0, 0.5])
    expected = np.minimum(asked, cable().ratio) * whole.scaled(ONES).torque(state)
    np.testing.assert_allclose(cable().scaled(asked).torque(state), expected, atol=1e-15)


def test_friction_compensation_s_ratio_and_dead_band_hold_inside_a_directional_cable():
    for blend in ("linear", "sine"):
        off = {"friction_compensation.ratio": [0.0] * 7, "directional_cable.blend": blend}
        still = shipped().torque(POSE, None)
        np.testing.assert_allclose(shipped(**off).torque(POSE, 0.3 * ONES), still, atol=1e-14)
        band = {"friction_compensation.dead_band": [0.2] * 7, "directional_cable.blend": blend}
        np.testing.assert_allclose(shipped(**band).torque(POSE, 0.19 * ONES), still, atol=1e-14)
        moving = shipped(**band).torque(POSE, 0.21 * ONES)
        assert np.abs(moving - still)[:6].min() > 1e-5


def test_the_two_parts_of_a_torque_make_it_up():
    settings = shipped(**{"viscous_friction.joint": [0.01] * 7})
    qd = np.linspace(-0.5, 0.5, 7)
    conservative, friction = settings.parts(POSE, qd)
    np.testing.assert_allclose(conservative + friction, settings.torque(POSE, qd), atol=1e-15)
    np.testing.assert_allclose(conservative, settings.torque(POSE, None), atol=1e-14)
    assert friction[6] == pytest.approx(0.7 * 0.01 * 0.5)


def test_the_part_that_is_compensated_is_the_largest_of_a_joint_s_frictions():
    cables = np.minimum(0.7, cable().ratio)
    cables[1:4] = cables[1:4].max()  # they share motors
    np.testing.assert_allclose(shipped().friction_part, cables)
    rubs = shipped(**{"viscous_friction.joint": [0.01] * 7})
    np.testing.assert_allclose(rubs.friction_part, 0.7)


# --- the guard of speed ----------------------------------------------------------------------

NAMES = tuple(f"joint{j}" for j in range(1, 8))


def guarded(speeds, command):
    """Return the first reason and its time along (N,) speeds of joint 2."""
    guard = SpeedGuard(NAMES, np.full(7, 4.0))
    for k, speed in enumerate(speeds):
        velocity = np.zeros(7)
        velocity[1] = speed
        reason = guard.check(velocity, np.full(7, command), k * DT)
        if reason is not None:
            return reason, k * DT
    return None, None


def test_a_joint_that_the_command_drives_beyond_its_limit_is_told():
    reason, when = guarded(np.linspace(3.0, 6.0, 600), 0.01)
    assert "joint2 runs away" in reason
    assert "at most 4" in reason
    assert when == pytest.approx(0.2 + speed_guard.WINDOW, abs=0.003)
    assert guarded(-np.linspace(3.0, 6.0, 600), -0.01)[0] is not None


def test_a_joint_that_moves_against_the_command_is_not_the_compensator_s_doing():
    assert guarded(np.linspace(3.0, 6.0, 600), -0.01) == (None, None)


def test_a_joint_that_was_thrown_and_slows_down_is_left_alone():
    assert guarded(np.linspace(8.0, 3.0, 600), 0.01) == (None, None)
    flick = 6.0 * np.sin(np.pi * np.arange(0, 0.16, DT) / 0.16)
    assert guarded(flick, 0.01) == (None, None)


def test_the_limit_must_be_passed_without_a_break():
    speeds = np.full(1000, 5.0)
    speeds[::90] = 3.9
    assert guarded(speeds, 0.01) == (None, None)


def test_growth_is_what_its_name_says():
    assert 1.0 < SETTINGS.growth < 1.5


# --- in the supervisor -------------------------------------------------------------------------


def supervised_swing(supervisor, changes=(), each=50) -> np.ndarray:
    """Return the (N, 7) speeds of an arm in undamped springs, let go once it is commanded.

    Every ``each`` ms the supervisor gets the next of the settings in ``changes``.
    """
    plant = benchmark.TRUTH.plant()
    plant.reset(benchmark.POSE)
    stiffness = np.diag(plant.mass_matrix()) * (2 * np.pi * 2.0) ** 2
    arm = SimulatedArm(plant, benchmark.TRUTH.sensors, builtin_compensation=False, dt=DT)
    reader, speeds = SampleReader(JOINT_NAMES), []
    away = benchmark.POSE + benchmark.SPEED / (2 * np.pi * 2.0)
    for step in range(6000):
        arm.step()
        measured = arm.measure()
        stamp = (step + 1) * 1_000_000
        if changes and supervisor.active and step % each == 0:
            supervisor.configure(changes[step // each % len(changes)], stamp * 1e-9)
        velocity = np.round(measured.velocity / 0.05) * 0.05
        sample = reader.read(stamp, JOINT_NAMES, measured.position, velocity, [])
        command = supervisor.command(sample, stamp * 1e-9, stamp)
        if command is not None:
            arm.servo_jf(command)
            arm.push(stiffness * (away - plant.q), 2 * DT)
        speeds.append(np.abs(plant.v))
    return np.array(speeds)


@cache
def of_the_right_model() -> np.ndarray:
    """Return the (7,) largest speeds under friction compensation that is right."""
    return supervised_swing(Supervisor(benchmark.settings_of(0.0))).max(axis=0)


def test_the_supervisor_keeps_friction_that_is_half_as_much_again_from_growing():
    right = of_the_right_model()
    settings = benchmark.settings_of(0.5)
    speeds = supervised_swing(Supervisor(settings))
    bound = benchmark.HIDDEN * np.maximum(SETTINGS.growth * right, settings.allowance)
    assert (speeds.max(axis=0) < bound).all()


def test_without_the_observer_the_same_arm_runs_into_the_guard_of_speed(monkeypatch):
    monkeypatch.setattr(PassivityObserver, "update", lambda *_: ONES)
    supervisor = Supervisor(benchmark.settings_of(1.0))
    supervised_swing(supervisor)
    assert supervisor.status is Status.FAULT
    assert "runs away" in supervisor.reason


@pytest.mark.parametrize(
    "name", ["friction_compensation.ratio", pytest.param("speed_limit", marks=pytest.mark.slow)]
)
def test_parameters_that_keep_changing_make_neither_observer_nor_guard_forget(name):
    """As of a person who drags a slider; friction is taken to be twice what it is."""
    right = of_the_right_model()
    values = benchmark.model_with(1.0).parameters() | {"friction_compensation.ratio": [0.7] * 7}
    start = Settings.from_parameters(values)
    before = {"friction_compensation.ratio": start.friction_ratio, "speed_limit": start.speed_limit}
    changes = [
        Settings.from_parameters(values | {name: (part * before[name]).tolist()}, start)
        for part in (0.999, 1.0)
    ]
    speeds = supervised_swing(Supervisor(start), changes)
    bound = benchmark.HIDDEN * np.maximum(SETTINGS.growth * right, start.allowance)
    assert (speeds.max(axis=0) < bound).all()


def test_the_guard_s_time_runs_on_where_its_limits_change():
    guard = SpeedGuard(NAMES, np.full(7, 4.0))
    reason = None
    for k in range(200):
        reason = reason or guard.check(np.full(7, 5.0), np.ones(7), k * DT)
        guard.limit(np.full(7, 4.0 + 0.001 * (k % 2)))
    assert reason is not None


@pytest.mark.parametrize("told", [lambda v: [], lambda v: 0.0 * v], ids=["absent", "zero"])
def test_an_arm_that_tells_no_speed_is_watched_by_its_positions(told):
    """With gravity upside down by a change of parameters the arm falls upwards."""
    values = benchmark.TRUTH.model.parameters() | {"speed_limit": [0.5] * 7}
    values |= {"start_tolerance": 2.0}  # or it would be held before it moves
    right = Settings.from_parameters(values)
    wrong = Settings.from_parameters(values | {"beta": (-np.array(values["beta"])).tolist()}, right)
    plant = benchmark.TRUTH.plant()
    plant.reset(benchmark.POSE)
    arm = SimulatedArm(plant, benchmark.TRUTH.sensors, builtin_compensation=False, dt=DT)
    supervisor, reader = Supervisor(right), SampleReader(JOINT_NAMES)
    for step in range(1, 5000):
        arm.step()
        measured, now = arm.measure(), step * DT
        stamp = round(now * 1e9)
        velocity = told(measured.velocity)
        sample = reader.read(stamp, JOINT_NAMES, measured.position, velocity, measured.effort)
        command = supervisor.command(sample, now, stamp)
        if supervisor.status is Status.COMMANDING and supervisor.settings is right:
            supervisor.configure(wrong, now)
        if supervisor.hold_due:
            break
        if command is not None:
            arm.servo_jf(command)
    assert "runs away" in supervisor.reason
