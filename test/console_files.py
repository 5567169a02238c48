"""Files of the console made for tests, and the torque of its own formula, written out here."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from dvrk_gravity import command_line
from dvrk_gravity.arms import JOINT_NAMES
from dvrk_gravity.compensate import Settings
from dvrk_gravity.console import ConsoleFile, check_file
from dvrk_gravity.model import TorqueModel


def convert(*words) -> int:
    """Run `convert` in this process and return its status."""
    return command_line.run("dvrk_gravity.cli.convert", [str(word) for word in words])


# --- the console's formula, written down from its definition, row by printed row -------------


def console_torque(document, q, qd):
    """Unclipped torque of the console at one pose, N·m."""
    section = document["GC_controller"]
    rows = console_regressor(q)
    up = rows @ np.array(section["gc_dynamic_params_pos"], float)
    down = rows @ np.array(section["gc_dynamic_params_neg"], float)
    alpha = [console_alpha(document, joint, speed) for joint, speed in enumerate(qd)]
    return alpha * up + (1 - np.array(alpha)) * down


def console_alpha(document, joint, speed):
    section = document["GC_controller"]
    if document["version"] == "1.0":
        amplitude = section["beta_vel_amplitude"][joint]
        if speed > amplitude:
            return 1.0
        if speed < -amplitude:
            return 0.0
        return 0.5 + 0.5 * math.sin(math.pi * speed / (2 * amplitude))
    band, full, ratio = (
        section[name][joint] for name in ("db_vel_vec", "sat_vec_vec", "fric_comp_ratio_vec")
    )
    if abs(speed) <= band:
        return 0.5
    part = 1.0 if abs(speed) >= full else (abs(speed) - band) / (full - band)
    return 0.5 + math.copysign(0.5 * ratio * part, speed)


def console_regressor(q):
    s2, s3, s4, s5, s6 = np.sin(q[1:6])
    c2, c3, c4, c5, c6 = np.cos(q[1:6])
    s23 = math.sin(q[1] + q[2])
    rows = np.zeros((7, 40))
    y2 = [
        s2,
        c2,
        c2 * c3 - s2 * s3,
        -c2 * s3 - c3 * s2,
        c2 * c3 * c4 - c4 * s2 * s3,
        s2 * s3 * s4 - c2 * c3 * s4,
        c4 * s2 * s3 * s5 - c3 * c5 * s2 - c2 * c3 * c4 * s5 - c2 * c5 * s3,
        c2 * c3 * c4 * c5 - c3 * s2 * s5 - c2 * s3 * s5 - c4 * c5 * s2 * s3,
        c2 * c3 * s4 * s6 + c2 * c6 * s3 * s5 + c3 * c6 * s2 * s5 - s2 * s3 * s4 * s6
        + c4 * c5 * c6 * s2 * s3 - c2 * c3 * c4 * c5 * c6,
        c2 * c3 * c6 * s4 - c6 * s2 * s3 * s4 - c2 * s3 * s5 * s6 - c3 * s2 * s5 * s6
        - c4 * c5 * s2 * s3 * s6 + c2 * c3 * c4 * c5 * s6,
    ]  # fmt: skip
    rows[1, :10] = y2
    rows[2, 2:10] = y2[2:]
    rows[3, 4:10] = [
        -s23 * s4,
        -s23 * c4,
        s23 * s4 * s5,
        -s23 * c5 * s4,
        s23 * (c4 * s6 + c5 * c6 * s4),
        s23 * (c4 * c6 - c5 * s4 * s6),
    ]
    pitch = [
        -(c2 * c3 * s5 - s2 * s3 * s5 + c2 * c4 * c5 * s3 + c3 * c4 * c5 * s2),
        -(c5 * s2 * s3 - c2 * c3 * c5 + c2 * c4 * s3 * s5 + c3 * c4 * s2 * s5),
    ]
    rows[4, 6:10] = [*pitch, -c6 * pitch[1], s6 * pitch[1]]
    rows[5, 8:10] = [
        c2 * c6 * s3 * s4 + c3 * c6 * s2 * s4 + c2 * c3 * s5 * s6 - s2 * s3 * s5 * s6
        + c2 * c4 * c5 * s3 * s6 + c3 * c4 * c5 * s2 * s6,
        c2 * c3 * c6 * s5 - c2 * s3 * s4 * s6 - c3 * s2 * s4 * s6 - c6 * s2 * s3 * s5
        + c2 * c4 * c5 * c6 * s3 + c3 * c4 * c5 * c6 * s2,
    ]  # fmt: skip
    rows[:, :10] *= 9.81
    for joint in range(6):
        rows[joint, 10 + 5 * joint : 15 + 5 * joint] = q[joint] ** np.arange(5)
    return rows


def assert_as_console(document, model) -> None:
    """Compare torques within the file's range, at speeds of the band, of the ramp and far above."""
    cable, rng = model.term("directional_cable"), np.random.default_rng(2)
    lower = np.maximum(cable.valid.lower, model.arm.lower)
    upper = np.minimum(cable.valid.upper, model.arm.upper)
    q = rng.uniform(lower, upper, (300, 7))
    qd = rng.choice([0.0, 0.005, 0.05, 0.5, 5.0, 30.0], q.shape) * rng.uniform(-1, 1, q.shape)
    expected = [console_torque(document, *row) for row in zip(q, qd, strict=True)]
    np.testing.assert_allclose(model.torque(q, qd), expected, rtol=0, atol=1e-9)
    # One pose at a time takes another way through the gravity term.
    np.testing.assert_allclose(model.torque(q[0], qd[0]), expected[0], rtol=0, atol=1e-9)
    rest = [console_torque(document, row, np.zeros(7)) for row in q]
    np.testing.assert_allclose(model.torque(q), rest, rtol=0, atol=1e-9)


# --- files ------------------------------------------------------------------------------------


def synthetic(version="2.0", seed=1):
    """Return a file of an MTMR with nothing wrong in it, numbers of every part at random."""
    rng = np.random.default_rng(seed)
    gravity = [0.03, 0.04, 0.02, 0.01, 0.001, 0.02, -0.005, -0.001, 0.0025, 0.0001]
    gravity = np.array(gravity) * rng.uniform(0.9, 1.1, 10)
    # Small, and smaller for higher powers: within the joints' limits they do not run away.
    scale = 0.01 * 0.3 ** np.arange(5) * np.array([5, 5, 5, 1, 0.3, 0.3])[:, None]
    scale[3:5, 2:] *= 0.1
    positive, negative = (rng.uniform(-1, 1, (6, 5)) * scale for _ in range(2))
    positive[1, 1] = negative[1, 1] = 0.45 - 9.81 * gravity[0]
    section = {
        "safe_upper_torque_limit": [0.03, 1.2, 0.9, 0.3, 0.09, 0.05, 0.001],
        "safe_lower_torque_limit": [-0.01, -0.5, -0.5, -0.3, -0.09, -0.05, -0.001],
        "GC_init_pos": [0, 0, 0, 0, 90, 0, 0],
        "gc_dynamic_params_pos": [*gravity.tolist(), *positive.ravel().tolist()],
        "gc_dynamic_params_neg": [*gravity.tolist(), *negative.ravel().tolist()],
    }
    if version == "1.0":
        section["beta_vel_amplitude"] = [2, 2, 1.5, 2, 10, 6, 2]
        section["amplitude_vec"] = [0.2, 0.4, 0.4, 0.2, 0.08, 0.08, 0.08]
    else:
        section["db_vel_vec"] = [0.02, 0.02, 0.02, 0.01, 0.008, 0.008, 0.01]
        section["sat_vec_vec"] = [0.2, 0.3, 0.2, 0.4, 0.2, 0.2, 0.7]
        section["fric_comp_ratio_vec"] = [0.7, 0.01, 0.5, 0.4, 0.2, 0.2, 1]
        section["joint_position_lower_limit"] = [-40, -14, -34, -80, -85, -40, -400]
        section["joint_position_upper_limit"] = [20, 33.7, 34, 190, 175, 40, 400]
    return {
        "ARM_NAME": "MTMR",
        "SN": "12345",
        "date_time": "Jänner-01",
        "lse": {"std_filter": 0.3, "g_constant": 9.81},
        "GC_controller": section,
        "version": version,
        "GC_Test": {"testing_sets": {"pos_1": [0, 0.5, None, True]}},
    }


def write(folder, document, name="gc-MTMR-12345.json"):
    path = folder / name
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


def own_model():
    """Return a model that never was a console file."""
    values = ConsoleFile.from_document(synthetic()).model().parameters()
    del values["console.document"]
    return values


# --- faults ------


def repaired(path, folder):
    """The file with the limits that the answer says, by hand."""
    document = json.loads(path.read_text())
    lines = [line.strip().rstrip(",") for line in check_file(path).answer.todo]
    new = json.loads("{" + ",".join(line for line in lines if line.startswith('"safe_')) + "}")
    assert len(new) == 2
    document["GC_controller"].update(new)
    return write(folder, document, path.name)


def edited(edit, **options):
    """Return a sound file that an edit has changed."""
    document = synthetic(**options)
    edit(document)
    return document


def scaled_gravity(beta1, total=0.45):
    """Move joint 2's torque between beta1 and the linear column, their sum kept."""

    def edit(document):
        for side in ("pos", "neg"):
            row = document["GC_controller"][f"gc_dynamic_params_{side}"]
            row[0], row[16] = beta1, total - 9.81 * beta1

    return edit


def both_sides(index, value):
    def edit(document):
        for side in ("pos", "neg"):
            document["GC_controller"][f"gc_dynamic_params_{side}"][index] = value

    return edit


def limits(joint, low, high):
    def edit(document):
        document["GC_controller"]["safe_lower_torque_limit"][joint] = low
        document["GC_controller"]["safe_upper_torque_limit"][joint] = high

    return edit


def entry(name, index, value):
    def edit(document):
        document["GC_controller"][name][index] = value

    return edit


def position_range(joint, low, high):
    def edit(document):
        document["GC_controller"]["joint_position_lower_limit"][joint] = low
        document["GC_controller"]["joint_position_upper_limit"][joint] = high

    return edit


# --- models of any form -----

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


def document_of(values: dict, folder: Path) -> tuple[dict, dict]:
    """Convert a model on the command line; return the file and its costs."""
    TorqueModel.from_parameters(values).save(folder / "m.yaml")
    path = folder / "gc-MTMR-7.json"
    assert convert(folder / "m.yaml", path, "--json", folder / "cost.json") == 0
    return json.loads(path.read_text()), json.loads((folder / "cost.json").read_text())


def assert_within_the_stated_cost(values: dict, folder: Path) -> None:
    """The file commands what the compensator does, but for what converting says that it costs."""
    document, costs = document_of(values, folder)
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
