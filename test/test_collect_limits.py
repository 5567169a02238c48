"""A plan, and every way to it and through it, keeps the limits of now, between points too."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from path_driver import WHOLE, at_beginning, go, plan_of

from dvrk_gravity.arms import Arm
from dvrk_gravity.collecting import MotionStoppedError, PacedMotion, TaughtLimits
from dvrk_gravity.compensate import MotionError
from dvrk_gravity.planning import PlanLimits, load_limits, save_limits, worst_violation

# --- limits that change --------------------------------------------------------------------


def tightened(limits: PlanLimits) -> PlanLimits:
    return replace(limits, acceleration=0.5 * limits.acceleration)


def test_a_limit_that_is_tightened_meanwhile_stops_what_does_not_keep_it(tmp_path: Path) -> None:
    plan, out = plan_of("ecm"), tmp_path / "bag"
    driver, now = at_beginning(plan), [plan.limits]

    def consent(question: str) -> bool:
        if question.startswith("rehearsed"):
            now[0] = tightened(plan.limits)
        return True

    with pytest.raises(MotionStoppedError, match=r"acceleration of \w+ by [\d.e-]+ (deg|m)/s²"):
        go(driver, out, plan, limits=lambda: now[0], consent=consent)
    assert driver.holds
    assert driver.phases[-1] == "rehearsal"
    before = len(driver.commanded)
    with pytest.raises(MotionError, match="acceleration"):  # and stays so
        go(driver, out, plan, limits=lambda: now[0], resume=True)
    assert len(driver.commanded) == before
    assert go(driver, out, plan, limits=lambda: plan.limits, resume=True).samples >= WHOLE - 2


def test_limits_that_were_raised_since_the_plan_was_made_raise_nothing(tmp_path: Path) -> None:
    plan = plan_of("ecm")
    raised = replace(
        plan.limits,
        velocity=3.0 * plan.limits.velocity,
        acceleration=9.0 * plan.limits.acceleration,
    )
    driver = at_beginning(plan, away=0.2)
    go(driver, tmp_path / "bag", plan, rehearse=False, limits=lambda: raised)
    speeds, accelerations = np.abs(np.array(driver.commanded)[:, 1:]).max(axis=0)
    assert (speeds <= plan.limits.velocity).all()
    assert (accelerations <= plan.limits.acceleration).all()


def test_a_plan_beyond_its_own_limits_is_not_saved_by_wider_ones(tmp_path: Path) -> None:
    plan = plan_of("ecm")
    driver = at_beginning(plan)
    with pytest.raises(MotionError, match="acceleration"):
        go(driver, tmp_path / "bag", replace(plan, limits=tightened(plan.limits)),
           limits=lambda: plan.limits)  # fmt: skip
    assert not driver.commanded


def test_a_motion_taken_up_within_limits_is_proven_to_keep_them() -> None:
    plan = plan_of("ecm", seed=3)
    assert worst_violation(PacedMotion(plan.motion, 1.0, 1.0, 0.2), plan.limits, plan.arm)
    assert worst_violation(PacedMotion(plan.motion, 0.1, 1.0, 1.0), plan.limits, plan.arm) is None


def test_a_taught_room_is_what_was_shown_less_a_margin(tmp_path: Path) -> None:
    arm = Arm.load("mtmr")
    own, room = PlanLimits.of(arm), TaughtLimits(arm)
    assert set(room.coverage.values()) == {0.0}
    random = np.random.default_rng(1).uniform(0.2, 0.8, (500, arm.n))
    shown = own.lower + random * (own.upper - own.lower)
    room.show(shown)
    assert 0.0 < room.coverage["outer_yaw"] <= 1.0
    margin = np.radians(1.0)
    save_limits(tmp_path / "limits.yaml", room.limits(margin), arm, "shown")
    limits = load_limits(tmp_path / "limits.yaml", arm)
    ways = shown @ own.rows.T
    low, high = limits.range
    assert (low >= ways.min(axis=0)).all()
    assert (high <= ways.max(axis=0)).all()
    np.testing.assert_allclose(low[:7], shown.min(axis=0) + margin, atol=1e-6)
    assert [each.name for each in limits.combinations] == ["shoulder_pitch + elbow_pitch"]
