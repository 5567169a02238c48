"""Models of many forms as console files: the stated cost, the nearest file, no push in motion."""

from __future__ import annotations

import numpy as np
import pytest
from console_files import (
    BETA,
    LOWER,
    PLAIN,
    UPPER,
    assert_within_the_stated_cost,
    console_regressor,
    tilted,
)

from dvrk_gravity.arms import Arm
from dvrk_gravity.console import convert_model
from dvrk_gravity.effects import State
from dvrk_gravity.model import TorqueModel

ARM = Arm.load("mtmr")

# Each is something that the console has no place for.
MODELS = {
    "twelve betas": {"beta": (*BETA, 0.002, -0.001)},
    "fourteen betas and a tilt": tilted(2.0),
    "zeros of joints and cables in both directions": {
        "joint_offset": (0.0, 0.01, -0.01, 0.02, 0.03, -0.02, 0.0),
        "directional_cable.positive.wrist_pitch": (0.02, 0.01, -0.01, 0.002, 0.001),
        "directional_cable.negative.wrist_pitch": (-0.01, 0.01, 0.01, -0.002, 0.0),
        "directional_cable.valid_lower": LOWER,
        "directional_cable.valid_upper": UPPER,
    },
    "one-sided friction": {
        "coulomb_friction.joint_positive": (0.03,) * 3 + (0.005,) * 4,
        "coulomb_friction.joint_negative": (0.02,) * 3 + (0.004,) * 4,
    },
    "friction of motors": {
        "coulomb_friction.joint_positive": (0.03, 0.04, 0.01, 0.005, 0.003, 0.003, 0.001),
        "coulomb_friction.motor_positive": (0.0, 0.0, 0.05, 0.01, 0.0, 0.0, 0.0),
    },
    "a cable of degree seven": {
        "elastic_cable.wrist_pitch": (0.01, -0.02, 0.0, 0.01, 0.0, -0.004, 0.0, 2e-4)
    },
    "load that stiction holds": {
        "held_load.orders": (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0),
        "held_load.mean.shoulder_pitch": (0.03,),
        "held_load.valid_lower": LOWER,
        "held_load.valid_upper": UPPER,
    },
}  # fmt: skip


@pytest.mark.parametrize("name", MODELS)
def test_each_file_commands_what_the_compensator_does_within_the_stated_cost(name, tmp_path):
    assert_within_the_stated_cost(PLAIN | MODELS[name], tmp_path)


# At rest, the most that is lost of what the console's form is near to, N·m.
MOST_AT_REST = {
    "twelve betas": 3.5e-3,
    "fourteen betas and a tilt": 15e-3,
    "zeros of joints and cables in both directions": 6e-3,
    "friction of motors": 1e-9,
    "a cable of degree seven": 12e-3,
    "load that stiction holds": 1e-9,
}


@pytest.mark.parametrize("name", MOST_AT_REST)
def test_at_rest_little_is_lost_and_no_other_console_file_is_nearer(name):
    model = TorqueModel.from_parameters(PLAIN | MODELS[name])
    result = convert_model(model, "7")
    assert max(cost.rest_max for cost in result.joints.values()) < MOST_AT_REST[name]
    q = np.random.default_rng(4).uniform(result.lower, result.upper, (800, 7))
    torque = model.torque(q) / ARM.effort_limit
    rows = np.array([console_regressor(pose) for pose in q]) / ARM.effort_limit[:, None]
    best = np.linalg.lstsq(rows.reshape(-1, 40), torque.ravel())[0]
    section = result.file.document["GC_controller"]
    sides = [np.array(section[f"gc_dynamic_params_{side}"]) for side in ("pos", "neg")]
    nearest, found = (
        np.sqrt(np.mean((rows @ parameters - torque) ** 2))
        for parameters in (best, np.mean(sides, axis=0))
    )
    if MOST_AT_REST[name] > 1e-4:  # else the form holds the model but for rounding
        assert found < 1.02 * nearest


@pytest.mark.parametrize("seed", range(3))
def test_in_no_motion_the_console_pushes_more_than_friction_takes(seed):
    random = np.random.default_rng(seed)
    levels = {
        f"coulomb_friction.{site}_{way}": tuple(
            (random.uniform(0.0, 0.05, 7) * random.choice([0.0, 1.0], 7)).tolist()
        )
        for site in ("joint", "motor")
        for way in ("positive", "negative")
    }
    values = PLAIN | levels
    model = TorqueModel.from_parameters(values)
    section = convert_model(model, "7").file.document["GC_controller"]
    up, down = (np.array(section[f"gc_dynamic_params_{side}"])[10::5] for side in ("pos", "neg"))
    pushed = np.append(0.5 * (up - down), 0.0) * section["fric_comp_ratio_vec"]
    # Motions of all kinds, and those in which motors stand still though their joints move.
    still = np.eye(7)[:, [1, 2, 3]] @ random.normal(size=(3, 3000))
    motions = np.concatenate(
        [random.normal(size=(3000, 7)), still.T, (ARM.actuator_to_joint @ still).T]
    )
    moving = State(np.zeros(motions.shape), 1e6 * motions)
    taken = np.sum(motions * model.term("coulomb_friction").torque(moving), axis=1)
    assert (np.abs(motions) @ pushed <= taken + 1e-12).all()
