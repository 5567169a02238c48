"""A plan, and every way to it and through it, keeps the limits of now, between points too."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from test_collect import PathDriver, go, once, plan_of

from dvrk_gravity.arms import Arm
from dvrk_gravity.calibration import CheckedDriver
from dvrk_gravity.collecting import MotionStoppedError, Paced, TaughtLimits
from dvrk_gravity.compensate import MotionError
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.planning import (
    Basis,
    FourierMotion,
    Plan,
    PlanLimits,
    exceeded,
    load_limits,
    save_limits,
)
from dvrk_gravity.simulate import PlantFile


@pytest.fixture
def endless(tmp_path: Path) -> Arm:
    """A joint without stops."""
    file = tmp_path / "arm.urdf"
    link = (
        '<link name="{}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" '
        'ixz="0" iyz="0"/></inertial></link>'
    )
    file.write_text(
        f'<robot name="one">{link.format("a")}{link.format("b")}<joint name="turn" '
        'type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/>'
        '<limit effort="10" velocity="5"/></joint></robot>'
    )
    return Arm.load(file)


@pytest.mark.parametrize(("at", "turns"), [(-175.0, -1), (170.0, 0), (549.0, 1), (-540.0, -2)])
def test_an_endless_joint_goes_the_short_way_to_limits_about_its_back(
    tmp_path: Path, endless: Arm, at: float, turns: int
) -> None:
    limits = replace(PlanLimits.of(endless), lower=np.radians([160.0]), upper=np.radians([200.0]))
    wave = np.radians([[0.0], [3.0]])
    plan = Plan(endless, FourierMotion(Basis(np.array([0.5]), 0.8, 4.0), np.array([np.pi]), wave),
                limits)  # fmt: skip
    start = np.radians([at])
    driver = PathDriver(plan, start)
    go(driver, tmp_path / "bag", rehearse=False)
    went = np.degrees(np.array(driver.commanded)[:, 0, 0])
    middle = 180.0 + 360.0 * turns
    assert np.abs(went - middle).max() <= max(abs(at - middle), 5.0) + 1e-6


@pytest.mark.parametrize(("at", "refused"), [(-175.0, True), (170.0, False), (549.0, True)])
def test_an_endless_joint_is_calibrated_in_the_turn_of_its_limits(
    endless: Arm, at: float, refused: bool
) -> None:
    limits = replace(PlanLimits.of(endless), lower=np.radians([160.0]), upper=np.radians([200.0]))
    plan = Plan(endless, FourierMotion(Basis(np.array([0.5]), 0.8, 4.0), np.array([np.pi]),
                                       np.zeros((2, 1))), limits)  # fmt: skip
    kept = CheckedDriver(PathDriver(plan, np.radians([at])), limits, endless)
    with pytest.raises(MotionError, match="in another turn") if refused else nullcontext():
        kept.connect()


def test_the_widest_limits_of_an_endless_joint_are_read_again(tmp_path: Path, endless: Arm) -> None:
    (tmp_path / "limits.yaml").write_text("joints: {turn: {position: [-1.0e+9, 1.0e+9]}}")
    limits = load_limits(tmp_path / "limits.yaml", endless)
    save_limits(tmp_path / "again.yaml", limits, endless, "the same")
    again = load_limits(tmp_path / "again.yaml", endless)
    np.testing.assert_allclose([again.lower, again.upper], [limits.lower, limits.upper])


def test_a_joint_within_limits_that_are_wider_than_a_turn_is_where_it_is(endless: Arm) -> None:
    limits = replace(PlanLimits.of(endless), lower=np.array([-6.0]), upper=np.array([6.0]))
    assert limits.turns(endless, np.array([5.0])) == 0.0
    assert limits.turns(endless, np.array([7.0])) == 2.0 * np.pi


@pytest.mark.parametrize(
    ("shown", "taught"),
    [
        ((-20.0, 20.0), (-18.0, 18.0)),
        ((350.0, 370.0), (-8.0, 8.0)),  # a turn further
        ((170.0, 190.0), (172.0, 188.0)),  # about its back
        ((-560.0, -520.0), (162.0, 198.0)),
        ((0.0, 700.0), (2.0, 698.0)),
    ],
)
def test_of_an_endless_joint_no_room_is_taught_that_nobody_showed(
    tmp_path: Path, endless: Arm, shown: tuple[float, float], taught: tuple[float, float]
) -> None:
    room = TaughtLimits(endless)
    room.show(np.radians(np.linspace(*shown, 99))[:, None])
    save_limits(tmp_path / "limits.yaml", room.limits(np.radians(2.0)), endless, "taught")
    limits = load_limits(tmp_path / "limits.yaml", endless)
    found = np.degrees([limits.lower[0], limits.upper[0]])
    turns = np.round((np.mean(found) - np.mean(taught)) / 360.0)
    np.testing.assert_allclose(found - 360.0 * turns, taught, atol=1e-6)
    assert abs(np.mean(found)) <= 180.0 + 1e-6
    width = np.degrees(np.ptp(PlanLimits.of(endless).range))
    assert room.coverage["turn"] == pytest.approx(min((shown[1] - shown[0]) / width, 1.0))


def test_limits_that_were_raised_since_the_plan_was_made_raise_nothing(tmp_path: Path) -> None:
    plan = plan_of("ecm")
    start = plan.at(0.0)[0] + 0.2 * plan.arm.scale
    raised = replace(
        plan.limits,
        velocity=3.0 * plan.limits.velocity,
        acceleration=9.0 * plan.limits.acceleration,
    )
    driver = PathDriver(plan, start, once("motion, recorded", 2.3, MotionError("a hand")))
    with pytest.raises(MotionStoppedError):
        go(driver, tmp_path / "bag", rehearse=False, limits=lambda: raised)
    go(driver, tmp_path / "bag", limits=lambda: raised, resume=True, rehearse=False)
    speeds, accelerations = np.abs(np.array(driver.commanded)[:, 1:]).max(axis=0)
    assert (speeds <= plan.limits.velocity).all()
    assert (accelerations <= plan.limits.acceleration).all()


@pytest.mark.parametrize("rehearse", [True, False], ids=["before the rehearsal", "the motion"])
def test_limits_that_are_tightened_in_an_approach_are_kept_after_it(
    tmp_path: Path, rehearse: bool
) -> None:
    plan = plan_of("ecm")
    driver = PathDriver(plan, plan.at(0.0)[0] + 0.2 * plan.arm.scale)
    tight = replace(plan.limits, acceleration=0.5 * plan.limits.acceleration)
    with pytest.raises(MotionStoppedError, match="the plan exceeds the limit of") as stopped:
        go(driver, tmp_path / "bag", rehearse=rehearse,
           limits=lambda: tight if driver.commanded else plan.limits)  # fmt: skip
    assert driver.phases == ["approach"]
    assert "stopped in its approach to the" in str(stopped.value)


def test_limits_of_efforts_that_are_tightened_in_an_approach_stop_the_motion(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = plan_of("ecm")
    watched = []
    monkeypatch.setattr(
        "dvrk_gravity.collecting.run.EffortWatch",
        lambda path, arm, greatest, model: watched.append(greatest),
    )
    driver = PathDriver(plan, plan.at(0.0)[0] + 0.2 * plan.arm.scale)
    weak = replace(plan.limits, effort=0.5 * plan.limits.effort)
    go(driver, tmp_path / "bag", rehearse=False,
       limits=lambda: weak if driver.commanded else plan.limits)  # fmt: skip
    assert driver.phases == ["approach", "approach", "motion, recorded"]
    assert driver.holds == 2
    np.testing.assert_allclose(watched[-1], weak.effort)


def test_what_is_taken_up_after_a_false_stop_is_one_smooth_way_from_rest(tmp_path: Path) -> None:
    plan, limits = plan_of("ecm", seed=3), plan_of("ecm", seed=3).limits
    driver = PathDriver(plan, plan.at(0.0)[0], once("motion, recorded", 3.1, MotionError("busy")))
    with pytest.raises(MotionStoppedError):
        go(driver, tmp_path / "bag", rehearse=False)
    driver.commanded.clear()
    driver.step, rest = 1e-3, driver.at.copy()
    go(driver, tmp_path / "bag", rehearse=False, resume=True)
    assert driver.phases[-2:] == ["approach", "motion, recorded"]
    way = np.vstack([rest, *(each[0] for each in driver.commanded)])
    speed = np.diff(way, axis=0) / driver.step
    assert (np.abs(speed) <= 1.001 * limits.velocity).all()
    assert (np.abs(speed[[0, -1]]) <= 1e-3).all()
    # Between approach and motion a point comes twice: it is at rest there.
    change = np.diff(speed, axis=0) / driver.step
    assert (np.abs(change) <= 1.01 * limits.acceleration + 1e-6).all()


def test_a_plan_that_was_edited_beyond_its_own_limits_is_not_saved_by_wider_ones(
    tmp_path: Path,
) -> None:
    plan = plan_of("ecm")
    tight = replace(plan.limits, acceleration=0.5 * plan.limits.acceleration)
    edited = replace(plan, limits=tight)
    driver = PathDriver(edited, plan.at(0.0)[0])
    with pytest.raises(MotionError, match="the plan exceeds the limit of acceleration"):
        go(driver, tmp_path / "bag", limits=lambda: plan.limits)
    assert not driver.commanded


def test_an_acceleration_that_no_servo_follows_is_no_limit(tmp_path: Path) -> None:
    (tmp_path / "limits.yaml").write_text("joints: {yaw: {velocity: 50, acceleration: 1e5}}")
    with pytest.raises(ConfigError, match=r"yaw.acceleration: got 100000.0, expected at most"):
        load_limits(tmp_path / "limits.yaml", plan_of("ecm").arm)


def efforts(beyond: float, still: bool):
    """Return efforts: too large where speed is steady, or beyond a position of the first joint."""

    def of(model, state):
        steady = np.abs(state.qd).max(axis=1) > np.abs(state.qdd).max(axis=1)
        excess = steady & (state.qd != 0.0).any(axis=1) if still else state.q[:, 0] > beyond
        load = np.where(excess[:, None], 1.5, 0.1) * model.arm.actuator_effort_limit
        return load, np.zeros_like(load)

    return of


def test_an_approach_that_takes_more_than_the_motors_have_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = plan_of("ecm", size=0.3)
    far = plan.at(np.linspace(0.0, 4.0, 400))[0][:, 0].max()
    monkeypatch.setattr("dvrk_gravity.planning.keeping.efforts", efforts(far + 0.1, still=False))
    driver = PathDriver(plan, plan.at(0.0)[0] + np.array([far + 0.4, 0.0, 0.0, 0.0]))
    model = PlantFile.of(plan.arm).model
    says = r"straight way to the plan's beginning exceeds the limit of effort of \w+'s motor"
    with pytest.raises(MotionError, match=says):
        go(driver, tmp_path / "bag", model=model, rehearse=False)
    assert not driver.commanded
    driver.at = plan.at(0.0)[0]  # moved there by hand
    go(driver, tmp_path / "bag", model=model, rehearse=False, resume=True)


@pytest.mark.parametrize("name", ["ecm", "mtmr"])
@pytest.mark.parametrize(
    ("speed", "begin", "ramp"), [(1.0, 2.0, 1.0), (0.1, 0.0, 0.0), (0.1, 1.5, 4.0)]
)
def test_between_points_of_its_grid_a_motion_at_another_pace_exceeds_no_more_than_it_says(
    name: str, speed: float, begin: float, ramp: float
) -> None:
    plan = plan_of(name, seed=5)
    paced, rows = Paced(plan.motion, speed, begin, ramp), plan.limits.rows
    for step in (0.005, 0.1):
        times, extra = paced.grid(step, rows)
        assert times[0] == 0.0
        assert times[-1] == pytest.approx(paced.duration)
        assert (np.diff(times) >= 0.0).all()
        fine = np.linspace(0.0, paced.duration, 20011)
        after = np.clip(np.searchsorted(times, fine), 1, len(times) - 1)
        for k, (there, here) in enumerate(zip(paced.at(times), paced.at(fine), strict=True)):
            bound = np.maximum(*(np.abs(there @ rows.T)[after - end] for end in (0, 1)))
            more = np.maximum(*(extra[k][after - end] for end in (0, 1)))
            assert (np.abs(here @ rows.T) <= bound + more + 1e-12).all()


def test_a_motion_taken_up_within_limits_is_proven_to_keep_them() -> None:
    plan = plan_of("ecm", seed=3)
    assert exceeded(Paced(plan.motion, 1.0, 1.0, 0.2), plan.limits, plan.arm) is not None
    assert exceeded(Paced(plan.motion, 0.1, 1.0, 1.0), plan.limits, plan.arm) is None


def test_a_rehearsal_that_takes_more_than_the_motors_have_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where the motion's accelerations carry a load that the motors could not hold slowly."""
    plan = plan_of("ecm")
    monkeypatch.setattr("dvrk_gravity.planning.keeping.efforts", efforts(0.0, still=True))
    driver, model = PathDriver(plan, plan.at(0.0)[0]), PlantFile.of(plan.arm).model
    with pytest.raises(MotionError, match="the plan at this pace exceeds the limit of effort"):
        go(driver, tmp_path / "bag", model=model)
    assert not driver.commanded
    go(driver, tmp_path / "other", model=model, rehearse=False)
