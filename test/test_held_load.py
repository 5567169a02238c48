"""Torque that depends on where other joints are: one pose and many give the same."""

from __future__ import annotations

import numpy as np
import pytest
from known_poses import truth

from dvrk_gravity.model import TorqueModel


@pytest.fixture(scope="module")
def static_model(tmp_path_factory) -> TorqueModel:
    """A model with every term that static poses give, and two functions of several joints."""
    path = tmp_path_factory.mktemp("static") / "model.yaml"
    truth(
        **{
            "held_load.orders": (0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 1, 2, 0, 0),
            "held_load.mean.elbow_pitch": (0.01, 0.03),
            "held_load.difference.elbow_pitch": (0.01, -0.02),
            "held_load.mean.shoulder_pitch": (0.02, -0.01),
            "held_load.difference.shoulder_pitch": (0.0, 0.01),
            "shown_torque.lower": (-0.1, -0.4, -0.2, -0.06, -0.03, -0.01, 0.0),
            "shown_torque.upper": (0.1, 0.4, 0.2, 0.06, 0.03, 0.01, 0.0),
        }
    ).save(path)
    return TorqueModel.load(path)


@pytest.mark.parametrize("known", ["nothing", "direction", "velocity"])
def test_one_pose_gives_what_many_give(static_model, known):
    rng = np.random.default_rng(3)
    q = rng.uniform(-0.5, 0.5, (20, 7))
    motion = {"nothing": {}, "direction": {"direction": np.sign(q)}, "velocity": {"qd": q}}[known]
    many = static_model.torque(q, **motion)
    assert np.abs(many).max() > 0.05
    for i in range(len(q)):
        single = static_model.torque(q[i], **{name: array[i] for name, array in motion.items()})
        np.testing.assert_allclose(single, many[i], atol=1e-12)
