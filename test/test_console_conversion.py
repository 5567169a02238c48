"""Any model as a console file: it commands what the compensator does, within the stated cost."""

from __future__ import annotations

import json
import os

import numpy as np
import pytest
from console_files import console_regressor, console_torque, convert, own_model

from dvrk_gravity.arms import JOINT_NAMES, Arm
from dvrk_gravity.compensate import Settings
from dvrk_gravity.console import convert_model
from dvrk_gravity.effects import State
from dvrk_gravity.model import TorqueModel

ARM = Arm.load("mtmr")
ZERO = (0.0,) * 7
BETA = (0.3, 0.4, 0.25, 0.15, 0.01, 0.2, -0.1, 0.01, 0.04, 0.001)
LOWER = tuple(np.radians([-40.0, -10, -30, -80, -80, -38, -90]).tolist())
UPPER = tuple(np.radians([30.0, 45, 30, 180, 170, 38, 90]).tolist())
CABLE = {
    "elastic_cable.outer_yaw": (0.01, 0.03, -0.02),
    "elastic_cable.wrist_platform": (0.02, 0.05, -0.03, 0.01),
    "elastic_cable.valid_lower": LOWER,
    "elastic_cable.valid_upper": UPPER,
}
PLAIN = {"arm": "mtmr", "beta": BETA} | CABLE


def tilted(degrees: float) -> dict:
    """Return the parameters of a base that is rolled."""
    angle = np.radians(degrees)
    vector = (0.0, 9.81 * float(np.sin(angle)), -9.81 * float(np.cos(angle)))
    return {"beta": (*BETA, 0.001, 0.0, 0.05, -0.03), "gravity_vector": vector}


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


def document_of(values: dict, folder) -> tuple[dict, dict]:
    """Convert a model on the command line; return the file and its costs."""
    TorqueModel.from_parameters(values).save(folder / "m.yaml")
    path = folder / "gc-MTMR-7.json"
    assert convert(folder / "m.yaml", path, "--json", folder / "cost.json") == 0
    return json.loads(path.read_text()), json.loads((folder / "cost.json").read_text())


@pytest.mark.parametrize("name", MODELS)
def test_the_file_commands_what_the_compensator_does_within_the_stated_cost(name, tmp_path):
    values = PLAIN | MODELS[name]
    document, costs = document_of(values, tmp_path)
    settings = Settings.from_parameters(values)
    lower, upper = np.array([costs["range_rad"][joint] for joint in JOINT_NAMES]).T
    random = np.random.default_rng(11)
    q = random.uniform(lower, upper, (800, 7))
    full = np.array(document["GC_controller"]["sat_vec_vec"])
    moving = full * random.choice([-1.0, 1.0], q.shape)
    for state, qd in (("rest", np.zeros(q.shape)), ("moving", moving)):
        expected = [settings.torque(*row) for row in zip(q, qd, strict=True)]
        given = [console_torque(document, *row) for row in zip(q, qd, strict=True)]
        error = np.abs(np.subtract(given, expected))
        for joint, residual in zip(JOINT_NAMES, error.T, strict=True):
            cost = costs["joints"][joint]
            rms = float(np.sqrt(np.mean(residual**2)))
            # 800 poses determine an RMS to a few per cent.
            assert rms == pytest.approx(cost[f"{state}_rms"], rel=0.1, abs=1e-8), (state, joint)
            assert residual.max() <= 1.01 * cost[f"{state}_max"] + 1e-8, (state, joint)


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


def test_a_model_in_the_console_s_form_comes_through_number_by_number(tmp_path):
    values = own_model()
    beside = {"rotor_inertia.motor": (0.01,) * 7, "torque_offset": (0.001,) * 7}
    document, costs = document_of(values, tmp_path)
    (tmp_path / "other").mkdir()
    other, also = document_of(values | beside, tmp_path / "other")
    assert document == other
    assert costs["exact"]
    assert also["exact"]
    assert "torque_offset, rotor_inertia" in also["notes"][0]
    assert all(cost["moving_max"] == 0.0 for cost in costs["joints"].values())


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


def mirrored() -> dict:
    values = own_model()
    beta = list(values["beta"])
    beta[5] = -beta[5]
    return values | {"beta": tuple(beta)}


def beyond_the_limits() -> dict:
    lower = (LOWER[0], np.radians(-40.0), *LOWER[2:])
    return PLAIN | {"elastic_cable.valid_lower": lower}


UNSAFE = {
    "a base that lies on its side": (PLAIN | tilted(40.0), "at rest"),
    "the other arm side": (mirrored(), "beta6"),
    "the other arm side, not in the form": (
        mirrored() | {"viscous_friction.joint": (0.1,) * 7}, "beta6",
    ),
    "a range that the arm does not have": (beyond_the_limits(), "shoulder_pitch"),
    "a torque that no arm has": (
        PLAIN | {"elastic_cable.elbow_pitch": (0.0, 1e308)}, "elbow_pitch",
    ),
    "ranges apart": (
        PLAIN | {"directional_cable.positive.outer_yaw": (0.1,),
                 "directional_cable.negative.outer_yaw": (0.1,),
                 "directional_cable.valid_lower": (1.0,) * 7,
                 "directional_cable.valid_upper": (1.1,) * 7}, "outer_yaw",
    ),
}  # fmt: skip


def test_what_would_be_unsafe_is_refused_by_its_rule(tmp_path, capsys):
    for case, (values, named) in UNSAFE.items():
        TorqueModel.from_parameters(values).save(tmp_path / "m.yaml")
        assert convert(tmp_path / "m.yaml", tmp_path / "gc-MTMR-7.json") == 2, case
        error = capsys.readouterr().err
        assert named in error, case
        assert error.count("\n") == 1, case
        assert os.listdir(tmp_path) == ["m.yaml"], case
