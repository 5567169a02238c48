"""A plan at 1 kHz, ways to it that leave a limit, and joints without stops."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from path_driver import PathDriver, at_beginning, go, once, plan_of
from urdf_texts import a_joint, urdf

from dvrk_gravity.arms import Arm
from dvrk_gravity.calibration import CheckedDriver
from dvrk_gravity.collecting import MotionStoppedError
from dvrk_gravity.compensate import MotionError
from dvrk_gravity.effects import State
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.planning import (
    Basis,
    Box,
    FourierMotion,
    Plan,
    PlanLimits,
    link_origins,
    tip,
)


def test_no_sample_at_1_khz_is_beyond_a_limit_from_an_approach_to_a_motion_taken_up_again(
    tmp_path: Path,
) -> None:
    plan = plan_of("mtmr", seed=3)
    limits = plan.limits
    outside = limits.upper + 0.02 * plan.arm.scale  # further out than a plan goes: inwards only
    stop = once("motion, recorded", 2.3, MotionError("a hand"))
    driver = PathDriver(plan.arm, outside, stop, step=1e-3)
    for resume in (False, True):
        with nullcontext() if resume else pytest.raises(MotionStoppedError):
            go(driver, tmp_path / "bag", plan, resume=resume)
    position, velocity, acceleration = (
        np.array(driver.commanded)[:, k] @ limits.rows.T for k in range(3)
    )
    low, high = limits.range
    inside = np.minimum(position - low, high - position)
    far = np.flatnonzero((inside < -1e-9).any(axis=1))
    assert (np.diff(inside[: len(far) + 1], axis=0)[inside[:-1][: len(far)] < -1e-9] >= -1e-9).all()
    np.testing.assert_array_equal(far, np.arange(len(far)))  # at the very beginning alone
    assert (np.abs(velocity) <= limits.rates[0] + 1e-9).all()
    assert (np.abs(acceleration) <= limits.rates[1] + 1e-9).all()


def tightened(limits: PlanLimits) -> PlanLimits:
    return replace(limits, acceleration=0.5 * limits.acceleration)


@pytest.mark.parametrize("rehearse", [True, False], ids=["before the rehearsal", "the motion"])
def test_limits_that_are_tightened_in_an_approach_are_kept_after_it(
    tmp_path: Path, rehearse: bool
) -> None:
    plan = plan_of("ecm")
    driver = at_beginning(plan, away=0.2)
    with pytest.raises(MotionStoppedError, match="acceleration"):
        go(driver, tmp_path / "bag", plan, rehearse=rehearse,
           limits=lambda: tightened(plan.limits) if driver.commanded else plan.limits)  # fmt: skip
    assert driver.phases[1:] == ["approach"]


# --- ways that leave them ------------------------------------------------------------------


def test_an_approach_through_a_box_is_refused(tmp_path: Path) -> None:
    plan = plan_of("ecm", size=0.1)
    arm, start = plan.arm, plan.at(0.0)[0]
    where = start + np.array([0.8, 0.0, 0.0, 0.0])
    half = link_origins(arm, (tip(arm),), (0.5 * (start + where))[None])[0, 0]
    box = Box("post", tuple(half - 0.01), tuple(half + 0.01), (tip(arm),))
    driver = PathDriver(arm, where)
    with pytest.raises(MotionStoppedError, match="post"):
        go(driver, tmp_path / "bag", plan, limits=lambda: replace(plan.limits, boxes=(box,)))
    assert not driver.commanded


def sprung(plan: Plan, stiffness: float, inertia: float = 0.0) -> TorqueModel:
    """Return a model of a spring about the middle of the first joint, and of its inertia."""
    middle, name = float(plan.motion.middle[0]), plan.arm.joint_names[0]
    values = {
        f"elastic_cable.{name}": (-stiffness * middle, stiffness),
        "rotor_inertia.motor": (inertia, 0.0, 0.0, 0.0),
    }
    return TorqueModel.from_parameters(values, plan.arm)


def test_an_approach_that_takes_more_than_the_motors_have_is_refused(tmp_path: Path) -> None:
    plan = plan_of("ecm", size=0.3)
    far = np.abs(plan.at(np.linspace(0.0, 4.0, 400))[0][:, 0] - plan.motion.middle[0]).max()
    model = sprung(plan, float(plan.limits.effort[0]) / (far + 0.1))
    driver = at_beginning(plan)
    driver.at = plan.motion.middle + np.array([far + 0.2, 0.0, 0.0, 0.0])
    with pytest.raises(MotionError, match="effort of yaw's motor"):
        go(driver, tmp_path / "bag", plan, model=model, rehearse=False)
    assert not driver.commanded
    driver.at = plan.at(0.0)[0]  # moved there by hand
    go(driver, tmp_path / "bag", plan, model=model, rehearse=False, resume=True)


def test_a_rehearsal_that_takes_more_than_the_motors_have_is_refused(tmp_path: Path) -> None:
    """At its full speed the motion is the oscillation of a spring: slowly it must be held."""
    plan = plan_of("ecm")
    size = np.radians([[0.0] * 4, [3.0, 0.0, 0.0, 0.0]])
    motion = FourierMotion(Basis(np.array([0.5]), 3.0, 10.0), plan.motion.middle, size)
    plan, stiffness = replace(plan, motion=motion), 100.0
    model = sprung(plan, stiffness, 0.7 * stiffness / (2.0 * np.pi * 0.5) ** 2)
    at = plan.at(np.linspace(0.0, 10.0, 999))
    fast = np.abs(model.torque_at(State(*at))[:, 0]).max()
    slow = np.abs(model.torque(at[0])[:, 0]).max()
    effort = plan.limits.effort.copy()
    effort[0] = 0.5 * (fast + slow)
    plan = replace(plan, limits=replace(plan.limits, effort=effort))
    driver = at_beginning(plan)
    with pytest.raises(MotionError, match=r"pace .* effort of yaw's motor"):
        go(driver, tmp_path / "bag", plan, model=model)
    assert not driver.commanded
    go(driver, tmp_path / "other", plan, model=model, rehearse=False)


# --- a joint without stops -----------------------------------------------------------------


@pytest.fixture
def endless(tmp_path: Path) -> Arm:
    limit = '<limit effort="10" velocity="5"/>'
    turn = a_joint("turn", "a", "b", "continuous", limit, "0 1 0")
    return Arm.load(urdf(tmp_path, turn, links="ab"))


def about_its_back(endless: Arm, size: float) -> Plan:
    limits = replace(PlanLimits.of(endless), lower=np.radians([160.0]), upper=np.radians([200.0]))
    wave = np.radians([[0.0], [size]])
    return Plan(endless, FourierMotion(Basis(np.array([0.5]), 0.8, 4.0), np.array([np.pi]), wave),
                limits)  # fmt: skip


@pytest.mark.parametrize(("at", "turns"), [(-175.0, -1), (170.0, 0), (549.0, 1), (-540.0, -2)])
def test_an_endless_joint_goes_the_short_way_to_limits_about_its_back_or_is_not_calibrated(
    tmp_path: Path, endless: Arm, at: float, turns: int
) -> None:
    plan = about_its_back(endless, 3.0)
    driver = PathDriver(endless, np.radians([at]))
    go(driver, tmp_path / "bag", plan, rehearse=False)
    went = np.degrees(np.array(driver.commanded)[:, 0, 0])
    middle = 180.0 + 360.0 * turns
    assert np.abs(went - middle).max() <= max(abs(at - middle), 5.0) + 1e-6
    kept = CheckedDriver(PathDriver(endless, np.radians([at])), plan.limits, endless)
    with pytest.raises(MotionError, match="turn") if turns else nullcontext():
        kept.connect()
