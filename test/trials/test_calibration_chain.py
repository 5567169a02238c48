"""What a calibration does in its motions, step by step."""

from __future__ import annotations

import numpy as np
from path_driver import at_beginning, plan_of

from dvrk_gravity.arms import Arm
from dvrk_gravity.calibration import (
    CheckedDriver,
    SimulatedRig,
)
from dvrk_gravity.collecting import collect
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.simulate import PlantFile

ECM = Arm.load("ecm")


def test_a_simulated_arm_drifts_with_a_model_that_is_too_weak_and_hardly_with_its_own(tmp_path):
    plant = PlantFile.of(ECM)
    model, pose = plant.model, 0.5 * (ECM.lower + ECM.upper) + 0.3 * ECM.scale
    model.save(tmp_path / "own.yaml")
    weak = {
        name: tuple(0.3 * np.array(value)) if name.startswith("link_weight") else value
        for name, value in model.parameters().items()
    }
    TorqueModel.from_parameters(weak, ECM).save(tmp_path / "weak.yaml")
    rig = SimulatedRig(plant, 1, 0.1)
    own, fallen = (rig.release(tmp_path / name, pose, 0.5) for name in ("own.yaml", "weak.yaml"))
    assert (own < np.radians(0.5) * ECM.scale).all()
    assert (fallen > np.radians(2.0) * ECM.scale).any()


def test_nothing_that_takes_long_is_done_between_an_approach_and_its_motion(tmp_path):
    for rehearse in (False, True):
        plan = plan_of("ecm")
        driver = at_beginning(plan, away=0.1)
        kept, done = CheckedDriver(driver, plan.limits, ECM), []
        driver.stop = lambda phase, time, done=done: done.append("follow") if time == 0.0 else None

        def look(path, duration, kept=kept, done=done):
            done.append("look")
            kept.look(path, duration)

        collect(plan, kept, tmp_path / f"bag{rehearse}", rehearse=rehearse, look=look,
                report=driver.report)  # fmt: skip
        assert done == ["look", "look", "follow", "follow"] * (1 + rehearse)
