"""Any arm is simulated, and has poses, a push and a model for its demonstration."""

from __future__ import annotations

import pytest
from robots import UR5
from support import MODEL_FILE

from dvrk_gravity.__main__ import main
from dvrk_gravity.arms import Arm
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.ros import MODEL, Stage


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
