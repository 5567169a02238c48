"""Any model as a console file: it commands what the compensator does, within the stated cost."""

from __future__ import annotations

import os

import numpy as np
from console_files import (
    LOWER,
    PLAIN,
    assert_within_the_stated_cost,
    convert,
    document_of,
    own_model,
    tilted,
)

from dvrk_gravity.model import TorqueModel


def test_the_file_commands_what_the_compensator_does_within_the_stated_cost(tmp_path):
    """Of a rolled base, offsets of joints and friction of motors, for which it has no place."""
    friction = {
        "coulomb_friction.joint_positive": (0.03, 0.04, 0.01, 0.005, 0.003, 0.003, 0.001),
        "coulomb_friction.joint_negative": (0.02,) * 3 + (0.004,) * 4,
        "coulomb_friction.motor_positive": (0.0, 0.0, 0.05, 0.01, 0.0, 0.0, 0.0),
    }
    offset = {"joint_offset": (0.0, 0.01, -0.01, 0.02, 0.03, -0.02, 0.0)}
    assert_within_the_stated_cost(PLAIN | tilted(2.0) | offset | friction, tmp_path)


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
