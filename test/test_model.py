"""A model is the sum of its terms, and its file is read alike by everyone."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from robots import UR5
from support import CONFIG, MODEL_FILE

from dvrk_gravity import TorqueModel
from dvrk_gravity.arms import JOINT_NAMES
from dvrk_gravity.effects import Range, State
from dvrk_gravity.errors import ConfigError, ShapeError
from dvrk_gravity.files import yaml_file

BETA = "beta: [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0]"


MOTION = np.random.default_rng(3).uniform(-2, 2, (4, 20, 7))


def test_friction_in_one_direction_only_stays_so():
    values = {"coulomb_friction.joint_positive": [0.0] * 7,
              "coulomb_friction.joint_negative": [0.2] * 7}  # fmt: skip
    model = TorqueModel.from_parameters(values)
    again = TorqueModel.from_parameters(model.parameters())
    for qd, expected in ((1.0, 0.0), (-1.0, -0.2)):
        np.testing.assert_array_equal(again.torque(np.zeros(7), np.full(7, qd)), expected)


def test_a_range_known_for_some_joints_only_stays_so():
    model = TorqueModel.from_parameters(
        {f"elastic_cable.{joint}": [0.0, 1.0] for joint in JOINT_NAMES}
    )
    edge = np.array([1.0, 2.0, np.inf, np.inf, 3.0, np.inf, 0.5])
    held = replace(model.terms[0], valid=Range(-edge, edge))
    model = TorqueModel(model.arm, (held,))
    again = TorqueModel.from_parameters(model.parameters())
    q = np.full((1, 7), 9.0)
    np.testing.assert_array_equal(model.torque(q), np.minimum(q, edge))
    np.testing.assert_array_equal(again.torque(q), np.minimum(q, edge))
    np.testing.assert_array_equal(again.torque(-q), -np.minimum(q, edge))


def test_an_arm_of_one_s_own_stays_the_model_s_arm(tmp_path):
    """Even if its file calls it as a shipped one is called."""
    content = yaml.safe_load((CONFIG / "arms" / "mtmr.yaml").read_text())
    content["joints"][1]["a"] = 0.5
    file = tmp_path / "long.yaml"
    file.write_text(yaml.safe_dump(content))
    model = TorqueModel.from_parameters({"arm": str(file), "beta": [1.0] * 10})
    model.save(tmp_path / "model.yaml")
    assert TorqueModel.load(tmp_path / "model.yaml").arm.body("link2").frame.translation[1] == -0.5


def test_an_arm_s_file_is_looked_for_beside_the_model_s(tmp_path, monkeypatch):
    folder = tmp_path / "mine"
    folder.mkdir()
    (folder / "arm.yaml").write_text((CONFIG / "arms" / "mtmr.yaml").read_text())
    (folder / "model.yaml").write_text("/**: {ros__parameters: {arm: arm.yaml, " + BETA + "}}")
    monkeypatch.chdir(tmp_path)
    model = TorqueModel.load("mine/model.yaml")
    model.save(tmp_path / "copy.yaml")
    assert (
        yaml_file.load(tmp_path / "copy.yaml")["/**"]["ros__parameters"]["arm"] == "mine/arm.yaml"
    )
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    for path in (folder / "model.yaml", tmp_path / "copy.yaml"):
        again = TorqueModel.load(path)
        assert again.arm.joint_names == model.arm.joint_names
        again.save(folder / "again.yaml")
        assert TorqueModel.load(folder / "again.yaml").terms[0].NAME == "gravity"


def test_the_shipped_model_comes_back_whole(tmp_path):
    model = TorqueModel.load(MODEL_FILE)
    assert {term.NAME for term in model.terms} == {"gravity", "directional_cable"}
    assert json.loads(model.document)["SN"] == "28002"
    model.save(tmp_path / "copy.yaml", comment="A copy.\nTwo lines.")
    assert (tmp_path / "copy.yaml").read_text().startswith("# A copy.\n# Two lines.\n/**:")
    again = TorqueModel.load(tmp_path / "copy.yaml")
    assert again.parameters() == model.parameters()
    assert again.document == model.document


# --- torque ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def rich() -> TorqueModel:
    """The shipped model with every other term added."""
    values = TorqueModel.load(MODEL_FILE).parameters()
    values |= {"elastic_cable.elbow_pitch": [0.01, 0.02, 0.03]}
    values |= {"coulomb_friction.motor_positive": [0.05] * 7, "viscous_friction.joint": [0.01] * 7}
    return TorqueModel.from_parameters(values)


def test_torque_is_the_sum_of_the_terms(rich):
    q, qd, qdd, _ = MOTION
    parts = [term.torque(State(q, qd, qdd)) for term in rich.terms]
    assert len(parts) == 5
    np.testing.assert_allclose(rich.torque(q, qd, qdd), np.sum(parts, axis=0), atol=1e-15)
    np.testing.assert_array_equal(rich.torque([0.1] * 7), rich.torque(np.full(7, 0.1)))


@pytest.mark.parametrize("shape", [(7,), (4, 5, 7), (0, 7)])
def test_any_leading_shape_is_taken(rich, shape):
    count = int(np.prod(shape))
    q, qd = (array.ravel()[:count].reshape(shape) for array in MOTION[:2])
    torque = rich.torque(q, qd)
    assert torque.shape == shape
    rows = [rich.torque(*pair) for pair in zip(q.reshape(-1, 7), qd.reshape(-1, 7), strict=True)]
    np.testing.assert_allclose(torque.reshape(-1, 7), np.reshape(rows, (-1, 7)), atol=1e-14)


def test_arrays_that_are_not_seven_joints_are_refused(rich):
    for shape in ((), (6,), (7, 6), (0,)):
        with pytest.raises(ShapeError, match=r"q has shape .*, expected \(…, 7\)"):
            rich.torque(np.zeros(shape))
        with pytest.raises(ShapeError, match="qd has shape"):
            rich.torque(np.zeros((3, 7)), np.zeros(shape))


def test_a_model_without_terms_has_no_torque():
    model = TorqueModel.from_parameters({})
    np.testing.assert_array_equal(model.torque(MOTION[0]), np.zeros((20, 7)))


# --- files -----------------------------------------------------------------------------------


def document(*lines: str) -> str:
    return "\n".join(["/**:", "  ros__parameters:", *(f"    {line}" for line in lines)]) + "\n"


WRONG = {
    "unknown key": (document(BETA, "betta: 1.0"), "betta: got 1.0, expected the name of a param"),
    "beta of nine": (document("beta: [1, 2, 3, 4, 5, 6, 7, 8, 9]"), "beta: got '9 numbers', exp"),
    "not finite": (document("beta: [1, 2, 3, 4, 5, 6, 7, 8, 9, .nan]"), "beta[9]: got nan"),
    "limit negative": (document("effort_limit: [1, 1, 1, -1, 1, 1, 1]"), "effort_limit[3]: got -1"),
    "arm unknown": (document("arm: psm1"), "arm: got 'psm1', expected mtml, mtmr, psm, ecm, or"),
    "both spellings": (document("timeout: 0.1", "timeout: 0.2"), "key 'timeout' appears twice"),
    "alias": (document("effort_limit: &a [1, 1]", "slew_limit: *a"), "anchors and aliases"),
    "no parameters": ("/**:\n  other: 1\n", "`ros__parameters:` under it and nothing else"),
    "null": ("/**:\n  ros__parameters:\n", "/**.ros__parameters: got nothing, expected a mapping"),
    "not JSON": (document("console: {document: '{'}"), "console.document: got '{', expected JSON"),
}


def test_a_wrong_file_is_told_in_one_line_with_its_name(tmp_path):
    file = tmp_path / "model.yaml"
    for case, (text, told) in WRONG.items():
        file.write_text(text)
        with pytest.raises(ConfigError) as caught:
            TorqueModel.load(file)
        assert str(caught.value).startswith(f"{file}: "), case
        assert told in str(caught.value), case
        assert "\n" not in str(caught.value), case


def test_what_was_given_as_an_empty_list_is_left_out_of_the_file():
    """ROS cannot read an empty list."""
    model = TorqueModel.from_parameters({"beta": [1.0] * 10, "effort_limit": []})
    assert "effort_limit" not in model.parameters()


def test_a_file_whose_geometry_changed_under_a_model_is_no_longer_its_arm(tmp_path):
    """Another mesh, limit or mass is no matter: what was identified is in the model."""
    arm_file, model_file = tmp_path / "robot.urdf", tmp_path / "model.yaml"
    text = Path(UR5).read_text()
    arm_file.write_text(text)
    model = TorqueModel.load(arm_file)
    model.save(model_file)

    arm_file.write_text(text.replace('mass value="8.393"', 'mass value="9.0"'))
    np.testing.assert_array_equal(
        TorqueModel.load(model_file).torque(np.ones(6)), model.torque(np.ones(6))
    )
    longer = text.replace('xyz="0.0 0.0 0.39225"', 'xyz="0.0 0.0 0.3932"')
    assert longer != text
    arm_file.write_text(longer)
    with pytest.raises(ConfigError, match=r"its geometry has changed.*identify again"):
        TorqueModel.load(model_file)
