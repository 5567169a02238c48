"""A model file of the last version loads, means the same, and loses nothing."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from dvrk_gravity import TorqueModel
from dvrk_gravity.compensate import Settings

FILES = Path(__file__).resolve().parents[1] / "files"
MODEL = FILES / "model_0_1_0.yaml"
KNOWN = json.loads((FILES / "model_0_1_0.json").read_text())  # what that version made of it


def test_it_has_the_torque_that_it_had():
    model = TorqueModel.load(MODEL)
    moving = model.torque(KNOWN["q"], KNOWN["qd"], KNOWN["qdd"])
    np.testing.assert_allclose(moving, KNOWN["torque"], rtol=0.0, atol=1e-12)
    posed = model.torque(KNOWN["q"], direction=np.sign(KNOWN["qd"]))
    np.testing.assert_allclose(posed, KNOWN["at_poses"], rtol=0.0, atol=1e-12)


def test_nothing_of_it_is_lost_when_it_is_saved_again(tmp_path):
    model = TorqueModel.load(MODEL)
    assert sorted(model.parameters()) == KNOWN["parameters"]
    model.save(tmp_path / "again.yaml")
    assert TorqueModel.load(tmp_path / "again.yaml").parameters() == model.parameters()


def test_the_compensator_takes_it():
    Settings.from_parameters(TorqueModel.load(MODEL).parameters())
