"""What a start measures, begins with and refuses, and its way to the model's torque."""

from __future__ import annotations

import numpy as np
import pytest
from robots import UR5
from supervisor_loop import (
    ARM,
    AT_ONCE,
    BASE,
    HELD,
    OFF,
    STICKY,
    Q,
    SupervisorInLoop,
    settings_of,
    target,
)

from dvrk_gravity.arms import Arm
from dvrk_gravity.compensate import (
    CONSIDERABLE,
    CommandRefusedError,
    SampleReader,
    Settings,
    Status,
    Supervisor,
    require_within,
)
from dvrk_gravity.effects import stated_weight
from dvrk_gravity.model import TorqueModel

# --- what is measured ------------------------------------------------------------------------


def test_a_tenth_of_a_second_is_measured_and_the_first_command_is_the_mean_effort():
    loop = SupervisorInLoop()
    rng = np.random.default_rng(0)
    efforts, answer = [], None
    begin = loop.now
    assert loop.status is Status.WAITING
    while answer is None and loop.now < begin + 1.0:
        efforts.append(HELD + 0.003 * rng.standard_normal(7))
        answer = loop.send(effort=efforts[-1])
        assert answer is not None or loop.status is Status.STARTING
    assert 0.1 <= loop.now - begin <= 0.11
    np.testing.assert_allclose(answer, np.mean(efforts, axis=0), atol=1e-12)
    assert loop.status is Status.RAMPING


def test_no_more_of_the_measured_effort_is_begun_with_than_friction_can_hold():
    """What is beyond would throw the joint if the model is right."""
    friction = 0.02
    without = {name: value for name, value in BASE.items() if "cable" not in name}
    values = without | {"coulomb_friction.joint_positive": [friction] * 7}
    loop = SupervisorInLoop(Settings.from_parameters(values))
    model = target(loop)
    first = loop.first(effort=np.add(model, [0.3, -0.3, 0.001, 0.05, 0.0, 0.0, 0.0]))
    part = 0.7 * friction  # what of it is compensated
    np.testing.assert_allclose(first - model, [part, -part, 0.001, part, 0, 0, 0], atol=1e-9)


def test_an_arm_that_moves_is_not_started_until_it_rests():
    loop = SupervisorInLoop(**AT_ONCE)
    for k in range(200):
        moving = Q + 1.0 * k * 0.002 * np.eye(7)[1]
        assert loop.send(position=moving, velocity=np.eye(7)[1]) is None
    assert loop.status is Status.STARTING
    assert loop.first(position=moving) is not None


@pytest.mark.parametrize(
    "effort", [[], [np.nan] * 7, [0.1] * 6, [0.0] * 7], ids=["none", "nan", "six", "zeros"]
)
def test_an_arm_without_usable_efforts_starts_with_the_model_s_torque(effort):
    loop = SupervisorInLoop()
    np.testing.assert_array_equal(loop.first(effort=effort), target(loop))
    assert loop.status is Status.COMMANDING


def test_efforts_count_from_half_of_the_samples_on():
    """Less of them bears no mean: the start is the model's."""
    for usable, measured in ((0.4, False), (0.6, True)):
        loop = SupervisorInLoop()
        answer = None
        for k in range(60):
            given = HELD if (k * usable) % 1.0 < usable else []
            answer = loop.send(effort=given)
            if answer is not None:
                break
        expected = HELD if measured else target(loop)
        np.testing.assert_allclose(answer, expected, atol=1e-12)


# --- refusals --------------------------------------------------------------------------------


@pytest.mark.parametrize("effort", [1e3 * HELD, [1e300] + [0.0] * 6, -5 * HELD])
def test_an_effort_that_the_model_contradicts_is_a_refusal_until_enabled_again(effort):
    loop = SupervisorInLoop()
    assert loop.first(effort=effort) is None
    assert (loop.status, loop.holds) == (Status.FAULT, 0)
    assert "start_tolerance" in loop.reason
    loop.supervisor.enable()
    assert loop.first() is not None


def test_measured_and_modelled_effort_may_differ_by_start_tolerance_of_the_limit():
    tolerance = 0.2
    for part, accepted in ((0.98, True), (1.02, False)):
        for sign in (1.0, -1.0):
            loop = SupervisorInLoop(**AT_ONCE, start_tolerance=tolerance)
            effort = target(loop)
            effort[2] += sign * part * tolerance * ARM.effort_limit[2]
            assert (loop.first(effort=effort) is not None) is accepted
            assert accepted or "elbow_pitch" in loop.reason


def test_a_model_that_holds_next_to_nothing_of_the_arm_is_a_refusal():
    without = {name: value for name, value in BASE.items() if "directional_cable" not in name}
    for part, accepted in ((0.05, False), (0.5, True)):
        weak = without | {"beta": tuple(part * np.array(BASE["beta"]))}
        loop = SupervisorInLoop(Settings.from_parameters(weak | {"start_tolerance": 2.0}))
        loop.ramps = False
        answer = loop.first(effort=1.0 / part * target(loop) * np.eye(7)[1])
        assert (answer is not None) is accepted
        assert accepted or ("shoulder_pitch" in loop.reason and "5.0 %" in loop.reason)


def test_what_limits_could_not_hold_and_where_this_arm_cannot_be_is_not_started():
    """A left master's wrist_platform goes where a right one's does not."""
    left = Q.copy()
    left[3] = np.radians(-170.0)
    for position, limits, tokens in (
        (left, {}, ("wrist_platform", "-170 deg", "75 deg", "mtmr")),
        (Q, {"effort_limit": [5, 0.01, 5, 5, 5, 5, 5]}, ("shoulder_pitch",)),
    ):
        loop = SupervisorInLoop(**AT_ONCE, **limits)
        assert loop.first(position=position) is None
        assert (loop.status, loop.holds) == (Status.FAULT, 0)
        assert all(token in loop.reason for token in tokens)


def test_twenty_degrees_outside_the_limits_may_be_a_wrong_zero_and_more_is_another_arm():
    for joint in (0, 3):
        for limit, way in ((ARM.upper, 1.0), (ARM.lower, -1.0)):
            position = Q.copy()
            position[joint] = limit[joint] + way * np.radians(20.0)
            require_within(ARM, position)
            position[joint] = limit[joint] + way * np.radians(20.2)
            with pytest.raises(CommandRefusedError, match=ARM.joint_names[joint]):
                require_within(ARM, position)


UR5_POSE = np.array([0.2, -0.8, 1.1, -0.4, 0.5, 0.1])
BALANCED = np.array([0.2, -np.pi / 2, 0.0, -np.pi / 2, 0.5, 0.1])


def started_with_weight(factor: float, pose: np.ndarray = UR5_POSE, **further) -> Supervisor:
    """Start a UR5 whose model and whose reading are both of one scale."""
    stated = TorqueModel.from_arm(UR5)
    values = {
        name: tuple(factor * np.array(value)) if name.startswith("link_") else value
        for name, value in stated.parameters().items()
    }
    settings = Settings.from_parameters(values | further)
    supervisor, reader = Supervisor(settings), SampleReader(settings.model.arm)
    weight = factor * stated_weight(Arm.load(UR5), pose)
    for k in range(60):
        stamp = 10**12 + k * 2_000_000
        sample = reader.read(stamp, settings.model.arm.joint_names, pose, np.zeros(6), weight)
        supervisor.command(sample, 100.0 + k * 0.002, stamp)
    return supervisor


@pytest.mark.parametrize("factor", [0.1, 3.0])
def test_a_model_that_agrees_with_a_wrong_reading_is_refused_by_the_stated_masses(factor):
    refused = started_with_weight(factor)
    assert refused.status is Status.FAULT
    assert f"{factor:g} times" in refused.reason
    # Where it is balanced, the weight over its range counts.
    balanced = started_with_weight(factor, BALANCED)
    assert balanced.status is Status.FAULT
    joints = refused.settings.model.arm.joint_names
    named = [[name for name in joints if name in each.reason] for each in (refused, balanced)]
    assert (len(named[0]), len(named[1])) == (1, 0)  # where it bears weight, the joint is named


def test_efforts_that_are_said_to_be_in_newton_metres_overrule_the_stated_masses():
    for factor, further in ((1.0, {}), (0.3, {"effort_unit": "N·m"})):
        assert started_with_weight(factor, **further).active
        assert started_with_weight(factor, BALANCED, **further).active


# --- from the first command to the model's torque --------------------------------------------


def test_the_ramp_goes_straight_to_the_model_s_torque_in_its_time():
    loop = SupervisorInLoop(ramp_time=0.3, **OFF)
    loop.first()
    begin, end = loop.now, target(loop)
    assert np.abs(end - HELD).max() > 0.1
    for _ in range(149):
        command = loop.send()
        part = (loop.now - begin) / 0.3
        np.testing.assert_allclose(command, (1 - part) * HELD + part * end, atol=1e-12)
    assert loop.status is Status.RAMPING
    loop.send()
    np.testing.assert_array_equal(loop.send(), end)
    assert loop.status is Status.COMMANDING


def test_an_arm_that_is_moved_during_the_ramp_feels_the_torque_of_where_it_is():
    loop = SupervisorInLoop(ramp_time=0.3, **OFF)
    loop.first()
    begin, difference = loop.now, HELD - target(loop)
    moved = Q + 0.5 * np.eye(7)[2]
    there = target(loop, moved)
    assert np.abs(there - target(loop)).max() > 0.05
    command = loop.send(after=0.02, position=moved)
    part = (loop.now - begin) / 0.3
    np.testing.assert_allclose(command, there + (1 - part) * difference, atol=1e-12)


def test_without_a_ramp_a_considerable_change_takes_a_fifth_of_a_second_all_the_same():
    loop = SupervisorInLoop(**AT_ONCE, **STICKY)
    first = loop.first(effort=HELD)
    end = target(loop)
    assert (np.abs(end - HELD) > CONSIDERABLE * ARM.effort_limit).any()
    np.testing.assert_allclose(first, HELD, atol=1e-12)
    half = loop.run(0.1)[-1]
    np.testing.assert_allclose(half, 0.5 * (HELD + end), atol=1e-9)
    np.testing.assert_array_equal(loop.run(0.11)[-1], end)
    assert loop.status is Status.COMMANDING


def test_a_small_change_without_a_ramp_is_made_at_once():
    loop = SupervisorInLoop(**AT_ONCE, **STICKY)
    near = target(loop) - 0.9 * CONSIDERABLE * ARM.effort_limit
    np.testing.assert_array_equal(loop.first(effort=near), target(loop))


def test_the_slew_limit_holds_from_the_first_command_on():
    loop = SupervisorInLoop(ramp_time=0.0, slew_limit=[0.2] * 7, **STICKY)
    near = target(loop) - 0.05 * ARM.effort_limit
    previous = loop.first(effort=near)
    assert np.abs(previous - near).max() <= 0.2 * 0.002 + 1e-9
    for _ in range(50):
        following = loop.send()
        assert np.abs(following - previous).max() <= 0.2 * 0.002 + 1e-12
        previous = following


def test_no_parameter_takes_a_joint_to_its_limit_in_less_than_a_fiftieth_of_a_second():
    for given in ([0.0] * 7, [1e4] * 7):
        np.testing.assert_allclose(
            settings_of(slew_limit=given).slew_limit * 0.02, ARM.effort_limit
        )


def test_a_hiccup_of_the_input_is_not_time_for_the_torque_to_run_on():
    loop = SupervisorInLoop(ramp_time=0.0, slew_limit=[0.2] * 7, **STICKY)
    before = loop.first(effort=target(loop) - 0.05 * ARM.effort_limit)
    after = loop.send(after=0.09)
    assert np.abs(after - before).max() == pytest.approx(0.2 * 0.02)


def test_what_the_limits_cut_is_reported_joint_by_joint_also_in_the_motors():
    loop = SupervisorInLoop(effort_limit=[5, 5, 5, 5, 0.02, 5, 5], **AT_ONCE)
    loop.first()
    assert loop.supervisor.compensation.saturated.tolist() == [False] * 4 + [True] + [False] * 2
    loop = SupervisorInLoop(**AT_ONCE)
    loop.first()
    loop.configure(actuator_effort_limit=[5, 0.05, 5, 5, 5, 5, 5], **AT_ONCE)
    loop.run(0.5)
    assert loop.supervisor.compensation.saturated.tolist() == [False, True] + [False] * 5


def test_limits_above_the_arm_s_own_are_the_arm_s_own():
    own = settings_of().limits
    for name in ("effort_limit", "actuator_effort_limit"):
        raised = settings_of(**{name: [10.0] * 7}).limits
        np.testing.assert_array_equal(raised.joint, own.joint)
        np.testing.assert_array_equal(raised.actuator, own.actuator)
    np.testing.assert_array_equal(own.joint, ARM.effort_limit)
    np.testing.assert_array_equal(own.actuator, ARM.actuator_effort_limit)
