"""The console's files: torques as the console computes them, nothing lost, bad fields refused."""

from __future__ import annotations

import json
import os

import numpy as np
import pytest
from console_files import (
    assert_as_console,
    console_torque,
    convert,
    edited,
    entry,
    own_model,
    synthetic,
    write,
)

from dvrk_gravity.console import ConsoleFile, FormError, Use, check_file, export
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.model import TorqueModel


def model_of(document) -> TorqueModel:
    return ConsoleFile.from_document(document).model()


@pytest.mark.parametrize("version", ["1.0", "2.0"])
def test_torques_equal_the_consoles_formula(version, tmp_path):
    document = synthetic(version)
    path = write(tmp_path, document)
    assert convert(path, tmp_path / "model.yaml") == 0
    assert_as_console(document, TorqueModel.load(tmp_path / "model.yaml"))


def test_outside_the_calibrated_range_the_polynomials_are_held():
    document = synthetic()
    for side in ("pos", "neg"):
        document["GC_controller"][f"gc_dynamic_params_{side}"][:10] = [0] * 10
    model = model_of(document)
    edge, beyond = np.zeros(7), np.zeros(7)
    edge[0], beyond[0] = np.radians([20, 40])
    assert model.torque(beyond)[0] == model.torque(edge)[0]
    assert abs(console_torque(document, beyond, np.zeros(7))[0] - model.torque(edge)[0]) > 1e-4


def test_version_1_stays_full_above_its_amplitude():
    # The console's own code goes on along the sine there, and would be back at 0.5 at twice it.
    model = model_of(synthetic("1.0"))
    q = np.full(7, 0.2)
    at, twice = (model.torque(q, np.full(7, speed)) for speed in (10.0, 20.0))
    np.testing.assert_array_equal(at, twice)
    assert np.abs(twice - model.torque(q)).max() > 1e-3


def test_json_to_yaml_to_json_is_exact(tmp_path):
    document = synthetic()
    assert convert(write(tmp_path, document), tmp_path / "m.yaml") == 0
    assert convert(tmp_path / "m.yaml", tmp_path / "back.json") == 0
    assert json.loads((tmp_path / "back.json").read_text()) == document
    for side in ("pos", "neg"):  # and without cables
        document["GC_controller"][f"gc_dynamic_params_{side}"][10:] = [0.0] * 30
    again = TorqueModel.from_parameters(model_of(document).parameters())
    assert export(again).document == document


def test_a_model_of_ones_own_becomes_a_file_that_the_console_loads(tmp_path):
    model = TorqueModel.from_parameters(own_model() | {"ramp_time": 2.0})  # a setting is left out
    model.save(tmp_path / "m.yaml")
    assert convert(tmp_path / "m.yaml", tmp_path / "gc-MTMR-777.json") == 0
    document = json.loads((tmp_path / "gc-MTMR-777.json").read_text())
    assert (document["SN"], document["ARM_NAME"], document["version"]) == ("777", "MTMR", "2.0")
    section = document["GC_controller"]
    lengths = dict.fromkeys(("gc_dynamic_params_pos", "gc_dynamic_params_neg"), 40)
    lengths |= dict.fromkeys(
        ("safe_upper_torque_limit", "safe_lower_torque_limit", "db_vel_vec", "sat_vec_vec",
         "fric_comp_ratio_vec", "GC_init_pos"), 7,
    )  # fmt: skip
    assert {name: len(section[name]) for name in lengths} == lengths
    assert_as_console(document, model)
    found = check_file(tmp_path / "gc-MTMR-777.json").findings
    assert not [finding for finding in found if "limits" in finding.code]


WITHOUT_A_PLACE = [
    ({"coulomb_friction.joint_positive": (0.1,) * 7}, "coulomb_friction"),
    ({"elastic_cable.elbow_pitch": (0.0,) * 5 + (0.1,)}, "elastic_cable"),
    ({"directional_cable.positive.elbow_pitch": (0.0,) * 5 + (0.1,),
      "directional_cable.negative.elbow_pitch": (0.0,) * 5 + (0.1,)}, "elbow_pitch[5]"),
    ({"directional_cable.positive.wrist_roll": (0.1,)}, "wrist_roll"),
    ({"beta": (0.1,) * 12}, "beta[10]"),
    ({"gravity_vector": (0.0, 1.0, -9.7)}, "gravity_vector"),
    ({"elastic_cable.outer_yaw": (0.1,)}, "elastic_cable.valid_lower"),
]  # fmt: skip


def test_what_has_no_place_in_the_console_s_form_is_named():
    for change, named in WITHOUT_A_PLACE:
        with pytest.raises(FormError) as error:
            export(TorqueModel.from_parameters(own_model() | change), "1")
        assert named in str(error.value)


# --- bad files ------------------------------------------------------------------------------


BAD_FIELDS = {
    "no version": (lambda document: document.pop("version"), "version"),
    "no section": (lambda document: document.pop("GC_controller"), "GC_controller"),
    "39 parameters": (
        lambda document: document["GC_controller"].update(gc_dynamic_params_pos=[0.1] * 39),
        "39 entries",
    ),
    "null": (entry("gc_dynamic_params_neg", 12, None), "gc_dynamic_params_neg[12]"),
    "one range": (
        lambda document: document["GC_controller"].pop("joint_position_lower_limit"),
        "joint_position_lower_limit",
    ),
    "band over saturation": (entry("db_vel_vec", 2, 0.5), "sat_vec_vec[2]"),
    "ratio": (entry("fric_comp_ratio_vec", 6, 1.5), "fric_comp_ratio_vec[6]"),
    "range upside down": (entry("joint_position_lower_limit", 0, 50), "lower_limit[0]"),
}  # fmt: skip


def test_a_bad_field_is_refused_in_one_line_and_the_check_has_it_corrected(tmp_path, capsys):
    for case, (edit, named) in BAD_FIELDS.items():
        path = write(tmp_path, edited(edit))
        assert convert(path, tmp_path / "m.yaml") == 2, case
        error = capsys.readouterr().err
        assert named in error, case
        assert str(path) in error, case
        assert error.count("\n") == 1, case
        assert not (tmp_path / "m.yaml").exists(), case
        assert convert("--check", path) == 1, case
        assert named in capsys.readouterr().out, case
        assert check_file(path).answer.use is Use.REPAIR, case


def test_two_gravities_are_refused(tmp_path, capsys):
    document = synthetic()
    document["GC_controller"]["gc_dynamic_params_neg"][4] += 1e-6
    path = write(tmp_path, document)
    assert convert(path, tmp_path / "m.yaml") == 2
    assert "gc_dynamic_params_neg[4]" in capsys.readouterr().err
    assert "gravity_differs" in {finding.code for finding in check_file(path).findings}


UNREADABLE = {
    "empty": b"", "list": b"[]", "cut": b"{", "binary": b"\xff\xfe\x00binary",
    "nested": b"[" * 100_000, "digits": b'{"version": ' + b"1" * 5000 + b"}",
    "huge": b" " * 1_000_001,
}  # fmt: skip


def test_unreadable_files_are_refused_in_one_line(tmp_path, capsys):
    path = write(tmp_path, edited(entry("gc_dynamic_params_pos", 7, float("nan"))))
    assert convert(path, tmp_path / "m.yaml") == 2
    assert os.listdir(tmp_path) == [path.name]
    assert "gc_dynamic_params_pos[7]" in str(check_file(path).findings)
    capsys.readouterr()
    for case, content in UNREADABLE.items():
        path.write_bytes(content)
        for words in ((path, tmp_path / "m.yaml"), ("--check", path)):
            assert convert(*words) == 2, case
            error = capsys.readouterr().err
            assert str(path) in error, case
            assert error.count("\n") == 1, case
        assert os.listdir(tmp_path) == [path.name], case


def test_a_model_that_cannot_become_a_console_file_is_refused(tmp_path, capsys):
    for change, named in (
        ({"gravity_enabled": False}, "gravity_enabled"),
        ({"console.document": "{}"}, "console.document"),
    ):
        TorqueModel.from_parameters(own_model() | change).save(tmp_path / "m.yaml")
        assert convert(tmp_path / "m.yaml", tmp_path / "gc-MTMR-1.json") == 2
        error = capsys.readouterr().err
        assert named in error
        assert error.count("\n") == 1
        assert os.listdir(tmp_path) == ["m.yaml"]
    with pytest.raises(ConfigError, match=r"console\.document"):
        TorqueModel.from_parameters(own_model() | {"console.document": "{"})
