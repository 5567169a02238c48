"""Any arm is simulated, and has poses, a push and a model for its demonstration."""

from __future__ import annotations

import numpy as np
import pytest
from made_up_arm import made_up_arm
from robots import PANDA, UR5
from support import MODEL_FILE

from dvrk_gravity.__main__ import main
from dvrk_gravity.arms import Arm
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.ros import BEARABLE, MODEL, Stage
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


def test_the_model_that_comes_with_the_package_is_taken_and_otherwise_the_plant_s(tmp_path):
    assert Stage.of(Arm.load("mtmr"), "", None, tmp_path).model.name == "mtmr_28002.yaml"
    assert not (tmp_path / MODEL).exists()
    assert Stage.of(Arm.load("mtml"), "", None, tmp_path).model == tmp_path / MODEL
    with pytest.raises(ConfigError, match=r"^plant: got .*ur5"):
        Stage.of(Arm.load(str(UR5)), "mtmr_28002", None, tmp_path)
    # A URDF's arm is its own, whatever its name.
    text = UR5.read_text().replace('<robot name="ur5"', '<robot name="mtmr"')
    (tmp_path / "arm.urdf").write_text(text)
    named = Arm.load(str(tmp_path / "arm.urdf"))
    assert named.name == "mtmr"
    assert Stage.of(named, "", None, tmp_path).own_model


def test_what_the_compensator_or_the_simulator_refuses_is_refused_before_anything_starts(
    tmp_path, capsys
):
    model = TorqueModel.load(MODEL_FILE)
    for given in (
        {"reading.effort_scale": (1.3,) * 7},
        {"identification.verdict": "do_not_compensate"},
    ):
        changed = TorqueModel.from_parameters(model.parameters() | given, model.arm)
        changed.save(tmp_path / "model.yaml")
        with pytest.raises(ConfigError, match=rf"model\.yaml: .*{next(iter(given))}"):
            Stage.of(model.arm, "", tmp_path / "model.yaml", tmp_path)
    for scale in ("-0.1", "1e9", "nan"):
        assert main(["demo", f"--friction-scale={scale}"]) == 2
        assert capsys.readouterr().err.count("\n") == 1
