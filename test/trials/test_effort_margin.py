"""The margin of the watch of efforts, on arms that nobody disturbs."""

from __future__ import annotations

import pytest

from dvrk_gravity.arms import Arm
from dvrk_gravity.collecting import EffortSettings, EffortWatch, SimulatedDriver
from dvrk_gravity.compensate import MotionError
from dvrk_gravity.planning import covering_plan
from dvrk_gravity.simulate import PlantFile


def test_an_undisturbed_arm_needs_half_of_the_margin() -> None:
    """An MTM needs the most; where its margin is too small, it is stopped."""
    for name in ("mtmr", "psm", "ecm"):
        plant, plan = PlantFile.of(Arm.load(name)), covering_plan(Arm.load(name), 8.0, 3)
        half = EffortSettings(margin=0.5 * EffortSettings().margin)
        watch = EffortWatch(plan.at, plan.arm, plan.limits.effort, plant.model, half)
        with SimulatedDriver(plant, at=plan.at(0.0)[0]) as driver:
            driver.connect()
            driver.follow(plan.at, 6.0, watch=watch)
        none = EffortSettings(margin=1e-3)
        strict = EffortWatch(plan.at, plan.arm, plan.limits.effort, plant.model, none)
        with SimulatedDriver(plant, at=plan.at(0.0)[0]) as driver:
            driver.connect()
            with pytest.raises(MotionError, match="motor"):
                driver.follow(plan.at, 6.0, watch=strict)
