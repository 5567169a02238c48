"""Motions at another pace, and rooms that were taught, over many cases."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from path_driver import plan_of

from dvrk_gravity.arms import Arm
from dvrk_gravity.collecting import PacedMotion, TaughtLimits
from dvrk_gravity.planning import (
    PlanLimits,
    load_limits,
    save_limits,
)


@pytest.mark.parametrize(
    ("speed", "begin", "ramp"), [(1.0, 2.0, 1.0), (0.1, 0.0, 0.0), (0.1, 1.5, 4.0)]
)
def test_between_points_of_its_grid_a_motion_at_another_pace_exceeds_no_more_than_it_says(
    speed: float, begin: float, ramp: float
) -> None:
    plan = plan_of("mtmr", seed=5)
    paced, rows = PacedMotion(plan.motion, speed, begin, ramp), plan.limits.rows
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


@pytest.fixture
def endless(tmp_path: Path) -> Arm:
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


@pytest.mark.parametrize(
    ("shown", "taught"),
    [
        ((-20.0, 20.0), (-18.0, 18.0)),
        ((350.0, 370.0), (-8.0, 8.0)),  # a turn further
        ((-560.0, -520.0), (162.0, 198.0)),  # about its back
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
