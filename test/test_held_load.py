"""Torque that depends on where other joints are: one pose and many give the same."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import MODEL_FILE

from dvrk_gravity.identification import identify
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Recording


@pytest.fixture(scope="module")
def static_model(measured_data, tmp_path_factory) -> TorqueModel:
    files = [measured_data / f"mtmr28002_static_{way}.csv" for way in ("pos", "neg")]
    path = tmp_path_factory.mktemp("static") / "model.yaml"
    identify([Recording.load(file) for file in files], TorqueModel.load(MODEL_FILE).arm).model.save(
        path
    )
    return TorqueModel.load(path)


@pytest.mark.parametrize("known", ["nothing", "direction", "velocity"])
def test_one_pose_gives_what_many_give(static_model, known):
    rng = np.random.default_rng(3)
    q = rng.uniform(-0.5, 0.5, (20, 7))
    motion = {"nothing": {}, "direction": {"direction": np.sign(q)}, "velocity": {"qd": q}}[known]
    many = static_model.torque(q, **motion)
    assert np.abs(many).max() > 0.05
    for i in range(len(q)):
        one = static_model.torque(q[i], **{name: array[i] for name, array in motion.items()})
        np.testing.assert_allclose(one, many[i], atol=1e-12)
