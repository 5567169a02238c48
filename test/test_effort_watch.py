"""A hand on an arm, or what is in its way, stops it by its efforts, its lag or its readings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from path_driver import plan_of

from dvrk_gravity.arms import Arm
from dvrk_gravity.collecting import EffortWatch, SimulatedDriver
from dvrk_gravity.compensate import LAG, FollowingErrorCheck, MotionError, Sample
from dvrk_gravity.effects import State
from dvrk_gravity.model import ModelUncertainty, TorqueModel, coefficients_of
from dvrk_gravity.planning import Plan, covering_plan
from dvrk_gravity.simulate import PlantFile

ECM = Arm.load("ecm")
SECOND = np.eye(ECM.n)[1]
LIMIT = ECM.actuator_effort_limit


def sample(plan: Plan, time: float, effort: np.ndarray | None) -> Sample:
    position, velocity, _ = plan.at(time)
    return Sample(round(1e9 * (1.0 + time)), position, velocity, effort)


def weightless(error: np.ndarray | None = None) -> TorqueModel:
    """Return a model whose torque is 0; with the RMS error that it states."""
    model = TorqueModel.from_parameters({"torque_offset": (0.0,) * ECM.n}, ECM)
    if error is None:
        return model
    return replace(model, uncertainty=known(model, *ECM.range, error))


def known(model: TorqueModel, lower, upper, error) -> ModelUncertainty:
    n = model.arm.n
    found = coefficients_of(model.terms)
    exact = {name: np.zeros((len(each), 0)) for name, each in found.items()}
    return ModelUncertainty(
        found, exact, np.zeros((n, 0)), np.zeros((3, 0)), error, 5.0, np.full(n, 0.1), lower, upper,
        np.full(n, 9.0),
    )  # fmt: skip


# --- efforts -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("model", "allowed"),
    [
        (weightless(), 0.1 * LIMIT),  # a tenth of the motor's greatest effort beside the model's
        (weightless(0.05 * LIMIT), (0.1 + 1.96 * 0.05) * LIMIT),  # and its 95 % band
        (weightless(9.0 * LIMIT), 1.1 * plan_of("ecm").limits.effort),
        (None, 1.1 * plan_of("ecm").limits.effort),
    ],
    ids=["exact", "uncertain", "vague", "no model"],
)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_effort_beyond_its_band_for_a_tenth_of_a_second_stops_the_arm(
    model: TorqueModel | None, allowed: np.ndarray, sign: float
) -> None:
    plan = plan_of("ecm")
    watch = EffortWatch(plan.at, ECM, plan.limits.effort, model)
    within, beyond = (sign * part * allowed * SECOND for part in (0.99, 1.01))
    for k in range(50):
        watch(sample(plan, 0.01 * k, within), 0.01 * k)
    for k in range(50, 59):
        watch(sample(plan, 0.01 * k, beyond), 0.01 * k)
    watch(sample(plan, 0.595, within), 0.595)  # it is let go of in time: counted anew
    watch(sample(plan, 0.6, beyond), 0.6)
    watch(sample(plan, 0.695, beyond), 0.695)
    with pytest.raises(MotionError, match="pitch's motor"):
        watch(sample(plan, 0.7, beyond), 0.7)


def test_efforts_that_are_missing_stop_an_arm_with_a_model_and_without_one() -> None:
    plan = plan_of("ecm")
    for model in (weightless(), None):
        watch = EffortWatch(plan.at, ECM, plan.limits.effort, model)
        watch(sample(plan, 0.0, None), 0.0)
        watch(sample(plan, 0.05, np.zeros(ECM.n)), 0.05)  # one alone may be lost
        watch(sample(plan, 0.1, None), 0.1)
        watch(sample(plan, 0.19, None), 0.19)
        with pytest.raises(MotionError, match="efforts"):
            watch(sample(plan, 0.2, None), 0.2)


@pytest.mark.parametrize("lacks", ["a weight", "a cable"])
def test_an_undisturbed_arm_is_not_stopped_where_its_model_was_not_identified(lacks: str) -> None:
    """A weight taken for a cable, or a cable held constant, is right within the range alone."""
    truth = PlantFile.of(ECM).model
    plan, values = covering_plan(ECM, 8.0, 3), truth.parameters()
    start, near = plan.at(0.0)[0], 0.02 * ECM.scale

    def with_cables(offset: np.ndarray, stiffness: np.ndarray) -> TorqueModel:
        cables = zip(ECM.joint_names, offset.tolist(), stiffness.tolist(), strict=True)
        return TorqueModel.from_parameters(
            values | {f"elastic_cable.{name}": (a, k) for name, a, k in cables}, ECM
        )

    none = np.zeros(ECM.n)
    if lacks == "a cable":
        stiff = 0.6 * ECM.effort_limit / ECM.scale
        truth = with_cables(-stiff * start, stiff)
    else:
        values |= {
            name: tuple(8.0 * np.array(value))
            for name, value in values.items()
            if name.startswith("link_weight")
        }
    weak = with_cables(truth.torque(start) - with_cables(none, none).torque(start), none)
    error = 0.01 * ECM.effort_limit

    def go_along(uncertainty: ModelUncertainty, push: float = 0.0) -> None:
        model = replace(weak, uncertainty=uncertainty)
        watch = EffortWatch(plan.at, ECM, plan.limits.effort, model)
        for moment in np.arange(0.0, plan.duration, 0.04).tolist():
            q, qd, qdd = (each[None] for each in plan.at(moment))
            effort = truth.torque_at(State(q, qd, qdd))[0] + push * ECM.effort_limit
            watch(Sample(round(1e9 * moment) + 1, q[0], qd[0], effort), moment)

    narrow = replace(known(weak, start - near, start + near, error), deviations={})
    everywhere = replace(narrow, lower=plan.limits.lower, upper=plan.limits.upper)
    go_along(narrow)
    with pytest.raises(MotionError):
        go_along(everywhere)
    with pytest.raises(MotionError):  # within the range, at first
        go_along(narrow, push=0.3)


# --- following -----------------------------------------------------------------------------


def followed(*positions: np.ndarray, arm: Arm = ECM, step: float = 0.01) -> FollowingErrorCheck:
    following = FollowingErrorCheck(arm)
    for k, position in enumerate(positions):
        following.add(Sample(round(1e9 * (1.0 + k * step)), position, None, None))
    return following


@pytest.mark.parametrize(
    ("name", "joint", "degrees"), [("ecm", 1, 8.0), ("ecm", 2, 8.0), ("mtmr", 6, 12.0)]
)
def test_a_set_point_may_be_ahead_by_the_following_error_and_the_lag_and_at_rest_by_2_deg(
    name: str, joint: int, degrees: float
) -> None:
    arm = Arm.load(name)
    axis, rest = np.eye(arm.n)[joint], np.zeros(arm.n)
    following = followed(rest, arm=arm)
    radian = 0.1 if arm.joints[joint].kind == "prismatic" else 1.0  # m that count as one
    for speed, first, allowed in (
        (0.0, True, radian * np.radians(2.0)),
        (0.0, False, radian * np.radians(degrees)),
        (-0.5, False, radian * np.radians(degrees) + LAG * 0.5),
    ):
        for sign in (1.0, -1.0):
            following.check(sign * 0.99 * allowed * axis, speed * axis, first)
            with pytest.raises(MotionError, match=arm.joint_names[joint]):
                following.check(sign * 1.01 * allowed * axis, speed * axis, first)
    with pytest.raises(MotionError):
        following.check(np.full(arm.n, np.nan), rest, False)


def test_a_joint_of_small_range_may_be_a_quarter_of_it_behind() -> None:
    short = replace(ECM.joints[1], lower=-0.1, upper=0.1)
    arm = replace(ECM, joints=(ECM.joints[0], short, *ECM.joints[2:]))
    following = followed(np.zeros(ECM.n), arm=arm)
    following.check(0.049 * SECOND, np.zeros(ECM.n), False)
    with pytest.raises(MotionError, match="pitch"):
        following.check(0.051 * SECOND, np.zeros(ECM.n), False)


def test_an_arm_that_moves_before_the_first_command_is_not_at_rest() -> None:
    noise = np.array([0.0, 3e-3, -3e-3, 0.0, 0.2])[:, None] * SECOND  # one reading is far off
    still = 0.1 + np.concatenate([noise, noise])
    np.testing.assert_allclose(followed(still[0]).rest_position(still), 0.1)
    step = np.where(np.arange(10) < 5, 0.0, 1.0)[:, None] * SECOND
    followed(still[0]).rest_position(still + np.radians(0.99) * step)
    for sign in (1.0, -1.0):
        with pytest.raises(MotionError, match="pitch"):
            followed(still[0]).rest_position(still + sign * np.radians(1.01) * step)
    both = np.repeat([[0.0] * 4, [0.0, 0.021, 0.0025, 0.0]], 5, axis=0)  # 1.2 deg, 2.5 mm: by scale
    with pytest.raises(MotionError, match="insertion"):
        followed(still[0]).rest_position(both)


def test_a_stopped_joint_goes_on_by_its_lag_and_no_further_than_its_set_point() -> None:
    """A console's hold keeps the set point: a stuck joint must not be pressed on for ever."""
    still, far, near, back = np.zeros((4, ECM.n))
    far[1], near[1], back[1] = 0.2, 0.01, -0.2
    following, speed = followed(*[still] * 5), 0.5 * SECOND
    place = following.resting_place
    np.testing.assert_allclose(place(far, speed, still), still)  # stuck
    np.testing.assert_allclose(place(far, speed, speed), LAG * speed)
    np.testing.assert_allclose(place(near, speed, speed), near)
    np.testing.assert_allclose(place(back, -speed, -speed), -LAG * speed)
    np.testing.assert_allclose(place(back, -speed, speed), still)  # away from the set point
    slips = followed(*[still] * 4, np.radians(30.0) * SECOND)
    np.testing.assert_allclose(slips.resting_place(far, speed, still)[1], 0.2)


# --- a simulated arm -----------------------------------------------------------------------


@pytest.fixture(scope="module")
def ecm() -> PlantFile:
    return PlantFile.of(ECM)


def test_a_reading_that_jumps_commands_no_jump(ecm: PlantFile) -> None:
    """An encoder that slips on the way stops the arm; wrong readings at the start are not used."""
    plan = plan_of("ecm", size=0.5)
    start = plan.at(0.0)[0]
    for begin, end, error in ((0.0, 0.05, None), (3.0, 9.0, MotionError)):
        with SimulatedDriver(ecm, at=start) as driver:
            measure, commanded, servo = driver.arm.measure, [], driver.arm.servo_jp

            def slipped(measure=measure, driver=driver, begin=begin, end=end):
                read = measure()
                off = 1.0 if begin <= driver.arm.plant.time < end else 0.0
                return read._replace(position=read.position + off * SECOND)

            def told(q, servo=servo, commanded=commanded):
                commanded.append(np.array(q))
                servo(q)

            driver.arm.measure, driver.arm.servo_jp = slipped, told
            where = driver.connect()
            np.testing.assert_allclose(where, start, atol=2e-3)
            if error is None:
                driver.follow(plan.at, 1.0)
            else:
                with pytest.raises(error, match="pitch by 1 rad"):
                    driver.follow(plan.at, plan.duration)
        assert np.abs(np.diff(commanded, axis=0)).max() < 0.02
