"""Any arm is simulated, and gets to the poses of its demonstration."""

from __future__ import annotations

import numpy as np
import pytest
from made_up_arm import made_up_arm
from robots import PANDA, UR5

from dvrk_gravity.arms import Arm
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.ros import BEARABLE, Stage
from dvrk_gravity.simulate import PlantFile, SimulatedArm


def arms(folder) -> list[Arm]:
    return [made_up_arm(folder), *(Arm.load(str(name)) for name in (UR5, PANDA, "mtml", "mtmr"))]


def test_the_plant_of_any_arm_balances_under_its_own_terms_and_falls_without(tmp_path):
    for arm in arms(tmp_path):
        plant, model = PlantFile.of(arm).plant(friction_scale=0.0), PlantFile.of(arm).model
        start = np.mean(arm.range, axis=0)
        plant.reset(start)
        for _ in range(100):
            plant.step(model.torque(plant.q), dt=1e-3)
        np.testing.assert_allclose(plant.q, start, atol=1e-6, err_msg=arm.name)
        for _ in range(100):
            plant.step(np.zeros(arm.n), dt=1e-3)
        assert (np.abs(plant.q - start) / arm.scale).max() > 2e-3, arm.name
        model.save(tmp_path / "model.yaml")  # and is a model file of the arm
        again = TorqueModel.load(tmp_path / "model.yaml")
        here, there = (each.torque(start, arm.scale) for each in (model, again))
        np.testing.assert_array_equal(here, there, arm.name)


def test_a_simulated_arm_gets_to_every_pose_of_its_demonstration_and_stays(tmp_path):
    arm = made_up_arm(tmp_path)
    stage = Stage.of(arm, "", None, tmp_path)
    simulated = SimulatedArm(PlantFile.of(arm).plant(), dt=2.5e-3)
    for pose in stage.poses:
        assert ((pose > arm.lower) & (pose < arm.upper)).all()
        simulated.move_jp(pose)
        for _ in range(4800):
            simulated.step()
            away, speed = np.abs([simulated.plant.q - pose, simulated.plant.v]) / arm.scale
            if max(away) < np.radians(0.5) and max(speed) < 1e-3:
                break
        else:
            pytest.fail(f"{np.degrees(away)} deg away")
        weight = np.abs(simulated.plant.smooth_torque()) / arm.effort_limit
        assert weight.max() <= BEARABLE
    assert (np.abs(stage.push) <= arm.effort_limit).all()
