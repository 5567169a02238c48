"""The console's files: torques as the console computes them, nothing lost, faults found."""

import copy
import json
import math
import os
from pathlib import Path

import numpy as np
import pytest

from dvrk_gravity import command_line
from dvrk_gravity.console import ConsoleFile, FormError, Severity, check_file, export
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.model import TorqueModel

ROOT = Path(__file__).resolve().parents[1]
DATA = Path(os.environ.get("DVRK_GRAVITY_DATA", ROOT.parent / "shared" / "data")) / "gc_json"
REAL = sorted(DATA.glob("gc-*.json"))
needs_data = pytest.mark.skipif(not REAL, reason=f"no console files in {DATA}")


def convert(*words):
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


# --- synthetic files ----------------------------------------------------------------------


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


def poses_in_range(model, count=300, seed=2):
    cable = model.term("directional_cable")
    lower = np.maximum(cable.valid.lower, model.arm.lower)
    upper = np.minimum(cable.valid.upper, model.arm.upper)
    return np.random.default_rng(seed).uniform(lower, upper, (count, 7))


def velocities(count=300, seed=3):
    """Speeds in the dead band, on the ramp and far above, in both directions."""
    rng = np.random.default_rng(seed)
    return rng.choice([0.0, 0.005, 0.05, 0.5, 5.0, 30.0], (count, 7)) * rng.uniform(
        -1, 1, (count, 7)
    )


def findings(path):
    return check_file(path).findings


def assert_as_console(document, model):
    q, qd = poses_in_range(model), velocities()
    expected = [console_torque(document, *row) for row in zip(q, qd, strict=True)]
    np.testing.assert_allclose(model.torque(q, qd), expected, rtol=0, atol=1e-9)
    # One pose at a time takes another way through the gravity term.
    np.testing.assert_allclose(model.torque(q[0], qd[0]), expected[0], rtol=0, atol=1e-9)
    rest = [console_torque(document, row, np.zeros(7)) for row in q]
    np.testing.assert_allclose(model.torque(q), rest, rtol=0, atol=1e-9)


# --- torques --------------------------------------------------------------------------------


@pytest.mark.parametrize("version", ["1.0", "2.0"])
def test_torques_equal_the_consoles_formula(version, tmp_path):
    document = synthetic(version)
    path = write(tmp_path, document)
    assert convert(path, tmp_path / "model.yaml") == 0
    assert_as_console(document, TorqueModel.load(tmp_path / "model.yaml"))


@needs_data
@pytest.mark.parametrize("path", REAL, ids=lambda path: path.stem)
def test_torques_of_real_files_equal_the_consoles_formula(path):
    assert_as_console(json.loads(path.read_text()), ConsoleFile.load(path).model())


def test_outside_the_calibrated_range_the_polynomials_are_held():
    document = synthetic()
    document["GC_controller"]["gc_dynamic_params_pos"][:10] = [0] * 10
    document["GC_controller"]["gc_dynamic_params_neg"][:10] = [0] * 10
    model = ConsoleFile.from_document(document).model()
    edge, beyond = np.zeros(7), np.zeros(7)
    edge[0], beyond[0] = np.radians([20, 40])
    assert model.torque(beyond)[0] == model.torque(edge)[0]
    assert abs(console_torque(document, beyond, np.zeros(7))[0] - model.torque(edge)[0]) > 1e-4


def test_version_1_stays_full_above_its_amplitude():
    # The console's own code goes on along the sine there, and would be back at 0.5 at twice it.
    model = ConsoleFile.from_document(synthetic("1.0")).model()
    q = np.full(7, 0.2)
    at, twice = (model.torque(q, np.full(7, speed)) for speed in (10.0, 20.0))
    np.testing.assert_array_equal(at, twice)
    assert np.abs(twice - model.torque(q)).max() > 1e-3


# --- round trips ----------------------------------------------------------------------------


def test_json_to_yaml_to_json_is_exact(tmp_path):
    document = synthetic()
    assert convert(write(tmp_path, document), tmp_path / "m.yaml") == 0
    assert convert(tmp_path / "m.yaml", tmp_path / "back.json") == 0
    assert json.loads((tmp_path / "back.json").read_text()) == document


def test_a_file_without_cables_loses_nothing():
    document = synthetic()
    for side in ("pos", "neg"):
        document["GC_controller"][f"gc_dynamic_params_{side}"][10:] = [0.0] * 30
    model = ConsoleFile.from_document(document).model()
    again = TorqueModel.from_parameters(model.parameters())
    assert export(again).document == document


@needs_data
@pytest.mark.parametrize("path", REAL, ids=lambda path: path.stem)
def test_real_files_come_back_exactly(path, tmp_path):
    document = json.loads(path.read_text())
    assert convert(path, tmp_path / "m.yaml") == 0
    assert convert(tmp_path / "m.yaml", tmp_path / path.name) == 0
    back = json.loads((tmp_path / path.name).read_text())
    if document["version"] == "1.0":
        new = ("db_vel_vec", "sat_vec_vec", "fric_comp_ratio_vec")
        assert all(len(back["GC_controller"].pop(name)) == 7 for name in new)
        assert back.pop("version") == "2.0"
        assert document.pop("version") == "1.0"
    assert back == document


def test_an_edited_number_is_the_only_one_that_changes(tmp_path):
    document = synthetic()
    model = ConsoleFile.from_document(document).model()
    values = model.parameters()
    beta = list(values["beta"])
    beta[2] += 0.05
    changed = TorqueModel.from_parameters(values | {"beta": beta})
    back = export(changed).document
    for side in ("pos", "neg"):
        old = document["GC_controller"][f"gc_dynamic_params_{side}"]
        new = back["GC_controller"][f"gc_dynamic_params_{side}"]
        assert new[2] == pytest.approx(old[2] + 0.05 / 9.81, rel=1e-12)
        assert [*new[:2], *new[3:]] == [*old[:2], *old[3:]]


def own_model():
    """Return a model that never was a console file."""
    values = ConsoleFile.from_document(synthetic()).model().parameters()
    del values["console.document"]
    return values


def test_a_model_of_ones_own_becomes_a_file_that_the_console_loads(tmp_path):
    model = TorqueModel.from_parameters(own_model())
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
    assert not [f for f in findings(tmp_path / "gc-MTMR-777.json") if "limits" in f.code]


def test_yaml_to_json_to_yaml_keeps_every_number(tmp_path):
    before = TorqueModel.from_parameters(own_model())
    after = ConsoleFile.from_document(export(before, "777").document).model().parameters()
    for name, value in before.parameters().items():
        if isinstance(value, tuple):  # a division by 9.81 and back may cost the last bit
            np.testing.assert_allclose(after[name], value, rtol=4e-16, atol=0, err_msg=name)
        else:
            assert after[name] == value


def test_elastic_cable_goes_into_both_directions():
    values = own_model()
    ranges = {
        f"elastic_cable.valid_{e}": values[f"directional_cable.valid_{e}"]
        for e in ("lower", "upper")
    }
    model = TorqueModel.from_parameters(
        values | ranges | {"elastic_cable.elbow_pitch": (0.01, 0.2, -0.1)}
    )
    assert_as_console(export(model, "777").document, model)


def test_version_1_is_written_as_version_2_and_the_note_bounds_the_change():
    document = synthetic("1.0")
    model = ConsoleFile.from_document(document).model()
    result = export(model)
    (note,) = result.notes
    told = float(note.split("up to ")[1].split(" N")[0])
    rng = np.random.default_rng(5)
    q = rng.uniform(model.arm.lower, model.arm.upper, (20_000, 7))
    qd = rng.uniform(-12, 12, q.shape)
    line = ConsoleFile.from_document(result.document).model()
    change = np.abs(model.torque(q, qd) - line.torque(q, qd)).max()
    assert 0.8 * told < change <= 1.05 * told


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"coulomb_friction.joint_positive": (0.1,) * 7}, "coulomb_friction"),
        ({"viscous_friction.joint": (0.1,) * 7}, "viscous_friction"),
        ({"elastic_cable.elbow_pitch": (0.0,) * 5 + (0.1,)}, "elastic_cable"),
        (
            {
                "directional_cable.positive.elbow_pitch": (0.0,) * 5 + (0.1,),
                "directional_cable.negative.elbow_pitch": (0.0,) * 5 + (0.1,),
            },
            "elbow_pitch[5]",
        ),
        ({"directional_cable.positive.wrist_roll": (0.1,)}, "wrist_roll"),
        ({"beta": (0.1,) * 12}, "beta[10]"),
        ({"gravity_vector": (0.0, 1.0, -9.7)}, "gravity_vector"),
        ({"elastic_cable.outer_yaw": (0.1,)}, "elastic_cable.valid_lower"),
    ],
)  # fmt: skip
def test_what_has_no_place_in_the_console_s_form_is_named(change, named):
    with pytest.raises(FormError) as error:
        export(TorqueModel.from_parameters(own_model() | change), "1")
    assert named in str(error.value)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"gravity_enabled": False}, "gravity_enabled"),
        ({"console.document": "{}"}, "console.document"),
    ],
)
def test_what_cannot_become_a_console_file_is_refused(change, named, tmp_path, capsys):
    TorqueModel.from_parameters(own_model() | change).save(tmp_path / "m.yaml")
    assert convert(tmp_path / "m.yaml", tmp_path / "gc-MTMR-1.json") == 2
    error = capsys.readouterr().err
    assert named in error
    assert error.count("\n") == 1
    assert os.listdir(tmp_path) == ["m.yaml"]


def test_settings_of_the_nodes_are_left_out_and_named(tmp_path, capsys):
    TorqueModel.from_parameters(own_model() | {"ramp_time": 2.0}).save(tmp_path / "m.yaml")
    assert convert(tmp_path / "m.yaml", tmp_path / "gc-MTMR-1.json") == 0
    assert "settings of the nodes: ramp_time" in capsys.readouterr().out


@needs_data
def test_the_example_model_is_what_convert_makes_of_its_source(tmp_path):
    assert convert(DATA / "gc-MTMR-28002.json", tmp_path / "m.yaml") == 0
    ours = TorqueModel.load(ROOT / "config" / "mtmr_28002.yaml")
    assert ours.parameters() == TorqueModel.load(tmp_path / "m.yaml").parameters()


# --- bad files ------------------------------------------------------------------------------


def section_edit(**fields):
    return lambda document: document["GC_controller"].update(fields)


def entry_edit(name, index, value):
    def edit(document):
        document["GC_controller"][name][index] = value

    return edit


def drop(name):
    return lambda document: document["GC_controller"].pop(name)


BAD_FIELDS = {
    "no version": (lambda document: document.pop("version"), "version"),
    "version 3": (lambda document: document.update(version="3.0"), "version"),
    "version true": (lambda document: document.update(version=True), "version"),
    "version in words": (lambda document: document.update(version="two"), "version"),
    "unknown arm": (lambda document: document.update(ARM_NAME="PSM1"), "ARM_NAME"),
    "no section": (lambda document: document.pop("GC_controller"), "GC_controller"),
    "39 parameters": (section_edit(gc_dynamic_params_pos=[0.1] * 39), "39 entries"),
    "null": (entry_edit("gc_dynamic_params_neg", 12, None), "gc_dynamic_params_neg[12]"),
    "true": (entry_edit("gc_dynamic_params_neg", 12, True), "gc_dynamic_params_neg[12]"),
    "text": (entry_edit("db_vel_vec", 1, "0.1"), "db_vel_vec[1]"),
    "infinite": (entry_edit("gc_dynamic_params_pos", 3, 10**400), "gc_dynamic_params_pos[3]"),
    "no limits": (drop("safe_upper_torque_limit"), "safe_upper_torque_limit"),
    "sat_vel_vec": (drop("sat_vec_vec"), "sat_vec_vec"),
    "one range": (drop("joint_position_lower_limit"), "joint_position_lower_limit"),
    "band over saturation": (entry_edit("db_vel_vec", 2, 0.5), "sat_vec_vec[2]"),
    "negative band": (entry_edit("db_vel_vec", 2, -0.5), "db_vel_vec[2]"),
    "ratio": (entry_edit("fric_comp_ratio_vec", 6, 1.5), "fric_comp_ratio_vec[6]"),
    "range upside down": (entry_edit("joint_position_lower_limit", 0, 50), "lower_limit[0]"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD_FIELDS)
def test_a_bad_field_is_refused_in_one_line_and_found_by_the_check(case, tmp_path, capsys):
    edit, named = BAD_FIELDS[case]
    document = synthetic()
    edit(document)
    path = write(tmp_path, document)
    assert convert(path, tmp_path / "m.yaml") == 2
    error = capsys.readouterr().err
    assert named in error
    assert str(path) in error
    assert error.count("\n") == 1
    assert not (tmp_path / "m.yaml").exists()
    assert convert("--check", path) == 1
    assert named in capsys.readouterr().out


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"[]",
        b"{",
        b"\xff\xfe\x00binary",
        b"[" * 100_000,
        b'{"a":' + b"[" * 30 + b"]" * 30 + b"}",
        b'{"version": /* "2.0"}',
        b'{"version": ' + b"1" * 5000 + b"}",
        b" " * 1_000_001,
    ],
    ids=["empty", "list", "cut", "binary", "nested", "deep", "comment", "digits", "huge"],
)
def test_unreadable_files_are_told_in_one_line(content, tmp_path, capsys):
    path = tmp_path / "gc-MTMR-1.json"
    path.write_bytes(content)
    for words in ((path, tmp_path / "m.yaml"), ("--check", path)):
        assert convert(*words) == 2
        error = capsys.readouterr().err
        assert str(path) in error
        assert error.count("\n") == 1
    assert os.listdir(tmp_path) == [path.name]


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity", "1e999"])
def test_numbers_that_are_not_finite(number, tmp_path, capsys):
    document = synthetic()
    document["GC_controller"]["gc_dynamic_params_pos"][7] = "HERE"
    path = tmp_path / "gc-MTMR-12345.json"
    path.write_text(json.dumps(document).replace('"HERE"', number))
    assert convert(path, tmp_path / "m.yaml") == 2
    assert not (tmp_path / "m.yaml").exists()
    assert convert("--check", path) == 1
    assert "gc_dynamic_params_pos[7]" in capsys.readouterr().out


def test_two_gravities_are_refused(tmp_path, capsys):
    document = synthetic()
    document["GC_controller"]["gc_dynamic_params_neg"][4] += 1e-6
    path = write(tmp_path, document)
    assert convert(path, tmp_path / "m.yaml") == 2
    assert "gc_dynamic_params_neg[4]" in capsys.readouterr().err
    assert "gravity_differs" in codes(path)


@pytest.mark.parametrize(
    "words",
    [
        ["a.json", "b.json"],
        ["a.yaml", "b.yaml"],
        ["a.json"],
        [],
        ["a.json", "b.yaml", "--json", "r.json"],
        ["a.txt", "b.yaml"],
    ],
    ids=" ".join,
)
def test_wrong_pairs_of_files(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write(tmp_path, synthetic(), "a.json")
    TorqueModel.from_parameters(own_model()).save("a.yaml")
    assert convert(*words) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert sorted(os.listdir(tmp_path)) == ["a.json", "a.yaml"]


def test_a_model_without_console_file_needs_a_serial_number(tmp_path, capsys):
    TorqueModel.from_parameters(own_model()).save(tmp_path / "m.yaml")
    assert convert(tmp_path / "m.yaml", tmp_path / "console.json") == 2
    assert "serial number" in capsys.readouterr().err


def test_a_model_file_with_a_broken_document_does_not_load():
    with pytest.raises(ConfigError, match=r"console\.document"):
        TorqueModel.from_parameters(own_model() | {"console.document": "{"})


# --- the check ------------------------------------------------------------------------------


def codes(path):
    return {finding.code for finding in findings(path)}


def test_a_sound_file_has_no_findings_but_the_pair(tmp_path, capsys):
    path = write(tmp_path, synthetic())
    assert convert("--check", path) == 0
    assert codes(path) == {"pair"}
    assert "0.450/0.450" in capsys.readouterr().out


def scaled_gravity(document, beta1, total=0.45):
    """Move joint 2's torque between beta1 and the linear column, their sum kept."""
    for side in ("pos", "neg"):
        row = document["GC_controller"][f"gc_dynamic_params_{side}"]
        row[0], row[16] = beta1, total - 9.81 * beta1


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


def position_range(joint, low, high):
    def edit(document):
        document["GC_controller"]["joint_position_lower_limit"][joint] = low
        document["GC_controller"]["joint_position_upper_limit"][joint] = high

    return edit


SERIOUS, WARNING = Severity.SERIOUS, Severity.WARNING
# code -> (fault that must fire, its severity, near miss that must not)
FAULTS = {
    "limits_clip": (limits(1, -0.5, 0.5), SERIOUS, limits(1, 0.0, 1.1)),
    "limits_reversed": (limits(0, 0.5, -0.5), SERIOUS, limits(0, -0.5, 0.5)),
    "limits_exclude_zero": (limits(6, 9e-5, 9e-5), WARNING, limits(6, 0, 9e-5)),
    "limits_beyond_actuator": (limits(5, -1.485, 0.09), SERIOUS, limits(5, -0.097, 0.09)),
    "limits_wide": (limits(0, -1.8, 1.8), WARNING, limits(0, -0.01, 0.03)),
    "growth": (both_sides(14, 1.0), SERIOUS, both_sides(14, 0.001)),
    "other_hand": (both_sides(5, -0.0197), SERIOUS, both_sides(5, 0.0205)),
    "range": (position_range(1, -14, 80), SERIOUS, position_range(1, -14, 65)),
    "g_constant": (
        lambda document: document["lse"].update(g_constant=9.5), SERIOUS,
        lambda document: document["lse"].update(g_constant=9.81),
    ),
    "pair_sum": (
        lambda document: scaled_gravity(document, 0.03, 0.75), WARNING,
        lambda document: scaled_gravity(document, 0.03, 0.6),
    ),
    "file_name": (
        lambda document: document.update(SN="999"), SERIOUS,
        lambda document: document.update(SN=12345),
    ),
    "other_data": (
        lambda document: document.update(MTM_data_path="data/MTMR_777"), WARNING,
        lambda document: document.update(MTM_data_path="data/MTMR_12345"),
    ),
}  # fmt: skip


@pytest.mark.parametrize("code", FAULTS)
def test_each_check_fires_and_stays_silent(code, tmp_path):
    fault, severity, near_miss = FAULTS[code]
    document = synthetic()
    fault(document)
    found = [f for f in findings(write(tmp_path, document)) if f.code == code]
    assert found
    assert found[0].severity is severity
    document = synthetic()
    near_miss(document)
    assert code not in codes(write(tmp_path, document))


def test_the_range_of_the_other_hand_is_told_apart_from_a_wrong_range(tmp_path):
    document = synthetic()
    position_range(3, -190, 80)(document)
    (finding,) = (f for f in findings(write(tmp_path, document)) if f.code == "other_hand")
    assert (finding.subject, finding.severity) == ("wrist_platform", SERIOUS)
    assert "MTML" in finding.text


@pytest.mark.parametrize(
    ("beta1", "severity"),
    [(0.03, Severity.NOTE), (-0.14, Severity.WARNING), (-2.4, Severity.SERIOUS)],
)
def test_the_pair_that_cannot_be_told_apart(beta1, severity, tmp_path):
    document = synthetic()
    scaled_gravity(document, beta1)
    (finding,) = (f for f in findings(write(tmp_path, document)) if f.code == "pair")
    assert finding.severity is severity
    assert finding.numbers["positive_Nm_rad"] == pytest.approx(0.45, abs=1e-12)


def test_no_pair_without_a_linear_column(tmp_path):
    document = synthetic()
    both_sides(16, 0.0)(document)
    assert "pair" not in codes(write(tmp_path, document))


def test_version_1_and_its_missing_range_are_told(tmp_path):
    assert {"version_1", "no_range"} <= codes(write(tmp_path, synthetic("1.0")))


def test_a_copy_of_another_arms_file_is_named(tmp_path):
    path = write(tmp_path, synthetic())
    other = synthetic() | {"SN": "777"}
    write(tmp_path, other, "gc-MTMR-777.json")
    write(tmp_path, synthetic(seed=9) | {"SN": "778"}, "gc-MTMR-778.json")
    (tmp_path / "gc-MTMR-779.json").write_text("broken")
    (finding,) = (f for f in findings(path) if f.code == "copy")
    assert (finding.subject, finding.severity) == ("gc-MTMR-777.json", SERIOUS)
    assert "copy" not in codes(tmp_path / "gc-MTMR-778.json")
    # A second name of the same arm's file is no copy of another arm's.
    write(tmp_path, synthetic(), "gc-MTMR-12345-old.json")
    (tmp_path / "gc-MTMR-777.json").unlink()
    assert "copy" not in codes(path)


@pytest.mark.parametrize("side", [1, -1], ids=["above", "below"])
def test_the_share_of_clipped_poses_is_right(side, tmp_path):
    # Joint 1 has its own polynomial only: linear in q, uniform poses, the share is plain.
    document = synthetic()
    for index, value in enumerate((0.0, 0.1, 0.0, 0.0, 0.0), start=10):
        both_sides(index, value)(document)
    position_range(0, -40, 40)(document)
    edge = 0.1 * math.radians(20) - 0.001
    limits(0, *((-0.5, edge) if side == 1 else (-edge, 0.5)))(document)
    (finding,) = (f for f in findings(write(tmp_path, document)) if f.code == "limits_clip")
    assert (finding.subject, finding.severity) == ("outer_yaw", SERIOUS)
    assert finding.numbers["share"] == pytest.approx(0.25, abs=0.01)
    assert finding.numbers["worst_Nm"] == pytest.approx(side * 0.1 * math.radians(40), abs=1e-3)


def test_the_report_is_json_and_statuses_combine(tmp_path, capsys):
    good = write(tmp_path, synthetic())
    bad = copy.deepcopy(synthetic(seed=4))
    bad["SN"] = "5"
    limits(0, 0.5, -0.5)(bad)
    serious = write(tmp_path, bad, "gc-MTMR-5.json")
    report = tmp_path / "report.json"
    assert convert("--check", good, serious, "--json", report) == 1
    content = json.loads(report.read_text())
    assert set(content) == {str(good), str(serious)}
    assert content[str(good)]["answer"]["use"] == "usable"
    assert content[str(serious)]["answer"]["use"] == "repair this"
    first = content[str(serious)]["findings"][0]
    assert (first["code"], first["severity"]) == ("limits_reversed", "serious")
    assert convert("--check", good, serious, tmp_path / "none.json") == 2
    assert "none.json" in capsys.readouterr().err


@needs_data
def test_what_is_known_of_the_real_files_is_found():
    found = {path.stem: {(f.code, f.subject) for f in findings(path)} for path in REAL}
    assert {("other_hand", "beta6"), ("other_hand", "wrist_platform")} <= found["gc-MTMR-22403"]
    others = {name: codes for name, codes in found.items() if name != "gc-MTMR-22403"}
    assert not any(code == "other_hand" for codes in others.values() for code, _ in codes)
    assert ("limits_clip", "shoulder_pitch") in found["gc-MTMR-28002"]
    assert ("limits_beyond_actuator", "wrist_roll") in found["gc-MTML-41878"]
    assert ("other_data", "MTM_data_path") in found["gc-MTML-41878"]
