"""The masses in an arm's file as the model on trial: what does a URDF get wrong?

The simulated UR5 moves by Pinocchio's dynamics and friction that no effect of the package computes.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import yaml
from robots import PANDA, UR5
from support import CONFIG, MODEL_FILE

from dvrk_gravity.__main__ import main
from dvrk_gravity.arms import Arm, nominal_inertias
from dvrk_gravity.diagnosis import diagnose
from dvrk_gravity.errors import ConfigError, RecordingError
from dvrk_gravity.identification import evaluate
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Recording
from testing.plain_world import PlainWorld

URDF = Path(UR5).read_text()


@pytest.fixture(scope="module")
def recording() -> Recording:
    """Of an arm that carries what the file does not have."""
    arm = Arm.load(UR5)
    bare = PlainWorld.of(arm, nominal_inertias(arm))
    return bare.with_payload(arm.body_names[-1], 1.5, (0.02, 0.05, 0.08)).record(1, 15.0)


def test_it_states_the_torque_that_pinocchio_computes_from_the_same_file():
    """With fingers that the arm does not move, as well."""
    path = f"{PANDA}#panda_hand"
    model, whole = TorqueModel.load(path), pin.buildModelFromUrdf(str(path).partition("#")[0])
    random = np.random.default_rng(0)
    for _ in range(5):
        q, qd, qdd = random.uniform(-1.5, 1.5, (3, model.arm.n))
        more = np.zeros(whole.nq - model.arm.n)  # the Panda's fingers, which are held
        expected = pin.rnea(
            whole, whole.createData(), *(np.append(part, more) for part in (q, qd, qdd))
        )
        expected = expected[: model.arm.n] + whole.damping[: model.arm.n] * qd
        np.testing.assert_allclose(model.torque(q, qd, qdd), expected, atol=1e-9)


def test_it_states_the_damping_and_the_friction_of_joints(tmp_path):
    """By Pinocchio's reader of the same file; a UR5's states none."""
    text = re.sub(r'(damping|friction)="0.0"', r'\1="0.3"', URDF)
    (tmp_path / "robot.urdf").write_text(text)
    whole = pin.buildModelFromUrdf(str(tmp_path / "robot.urdf"))
    qd = np.array([0.5, -0.5, 1.0, -1.0, 0.1, 0.2])

    rubbing, bare = (TorqueModel.load(file) for file in (tmp_path / "robot.urdf", UR5))

    expected = whole.damping * qd + whole.upperDryFrictionLimit * np.sign(qd)
    assert (np.abs(expected) > 0.3).all()
    more = rubbing.torque(np.zeros(6), qd) - bare.torque(np.zeros(6), qd)
    np.testing.assert_allclose(more, expected, rtol=1e-6)


def test_friction_that_drives_is_refused(tmp_path):
    text = URDF.replace('friction="0.0"', 'friction="-1.0"', 1)
    (tmp_path / "robot.urdf").write_text(text)
    with pytest.raises(ConfigError, match=r"shoulder_pan_joint: dynamics friction: got -1.0, exp"):
        Arm.load(tmp_path / "robot.urdf")


# --- files -----------------------------------------------------------------------------------


def test_convert_writes_it_as_a_model_file(tmp_path, capsys):
    out = tmp_path / "model.yaml"

    assert main(["convert", str(UR5), str(out)]) == 0

    q, qd, qdd = np.random.default_rng(0).uniform(-1.5, 1.5, (3, 6))
    written, stated = (TorqueModel.load(path).torque(q, qd, qdd) for path in (out, UR5))
    np.testing.assert_allclose(written, stated, rtol=1e-12)
    assert main(["convert", str(UR5), str(tmp_path / "model.csv")]) == 2
    assert "expected a file ending in .yaml or .yml" in capsys.readouterr().err


def test_files_taken_for_one_another_are_refused_in_a_line(
    recording, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    recording.save("run.csv")
    for words, said in (
        (["evaluate", "run.csv", "--model", CONFIG / "arms" / "psm.yaml"], "arm's file"),
        (["evaluate", "run.csv", "--model", CONFIG / "plants" / "psm.yaml"], "plant's file"),
        (["evaluate", "run.csv", "--model", UR5, "--drive-gains", "1,2"], "expected 6"),
        (["evaluate", "run.csv", "--model", UR5, "--effort-unit", "furlong"], "furlong"),
        (["identify", "run.csv", "--arm", MODEL_FILE, "--out", "x.yaml"], "model's parameters"),
        (["identify", "run.csv", "--arm", UR5, "--out", "x.urdf"], ".yaml"),
        (["convert", MODEL_FILE, "x.yaml"], ".urdf"),
        (["replay", "bag", "--model", UR5], "convert"),
        (["demo", "--model", UR5, "--out", "out"], "convert"),
    ):
        assert main([str(word) for word in words]) == 2, words
        error = capsys.readouterr().err
        assert said in error
        assert error.count("\n") == 1


def test_a_link_of_which_the_file_states_no_mass_is_named(recording, tmp_path):
    text = re.sub(r"<inertial>\s*<mass value=\"2.275\".*?</inertial>", "", URDF, flags=re.DOTALL)
    (tmp_path / "robot.urdf").write_text(text)

    evaluated = evaluate(tmp_path / "robot.urdf", recording)

    (first, *_) = evaluated.warnings
    assert "forearm_link" in str(first)


def test_a_file_that_another_one_names_is_not_written_over(recording, tmp_path, capsys):
    """A model's arm, and the URDF that this names, are read as well."""
    recording.save(tmp_path / "motion.csv")
    urdf, arm, model = (tmp_path / name for name in ("robot.urdf", "arm.yaml", "model.yaml"))
    urdf.write_text(URDF)
    arm.write_text("urdf: robot.urdf\n")
    TorqueModel.load(arm).save(model)

    for given in (f"{urdf}#tool0", arm, model):
        words = ["evaluate", tmp_path / "motion.csv", "--model", given, "--json", urdf]
        assert main([str(word) for word in words]) == 2
        assert "robot.urdf, which is read" in capsys.readouterr().err
    assert urdf.read_text() == URDF


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (
            {"urdf": str(UR5), "effort_unit": "A"},
            "expected drive_gains in it: masses give N·m, not",
        ),
        ({"urdf": "weightless.urdf"}, "expected an arm's file that states masses"),
    ],
)
def test_a_file_that_states_no_torques_is_no_model(tmp_path, content, said):
    bare = re.sub(r"<inertial>.*?</inertial>", "", URDF, flags=re.DOTALL)
    (tmp_path / "weightless.urdf").write_text(bare)
    (tmp_path / "arm.yaml").write_text(yaml.safe_dump(content))
    with pytest.raises(ConfigError, match=said):
        TorqueModel.load(tmp_path / "arm.yaml")


# --- its efforts -----------------------------------------------------------------------------


def test_efforts_that_are_insisted_on_are_taken(recording, tmp_path, capsys):
    halved = replace(recording, effort=0.1 * recording.effort)
    halved.save(tmp_path / "motion.csv")
    words = ["evaluate", tmp_path / "motion.csv", "--model", UR5]
    assert main([str(word) for word in words]) == 2
    assert "--effort-unit" in capsys.readouterr().err
    # Taken, and of that size not what the file's masses need.
    assert main([str(word) for word in (*words, "--effort-unit", "Nm")]) == 1


def test_a_yaml_that_names_a_urdf_is_the_same_model_with_its_gains(recording, tmp_path):
    (tmp_path / "arm.yaml").write_text(yaml.safe_dump({"urdf": str(UR5), "drive_gains": [2.0] * 6}))
    halved = replace(recording, effort=0.5 * recording.effort, arm=None)

    by_gains = evaluate(tmp_path / "arm.yaml", halved).joints

    for name, error in evaluate(UR5, recording).joints.items():
        assert by_gains[name].rmse == pytest.approx(error.rmse, rel=1e-6)


def test_efforts_that_its_masses_do_not_need_are_refused(recording):
    in_amperes = replace(recording, effort=0.08 * recording.effort)
    for judge in (evaluate, lambda model, given: diagnose(given, model)):
        with pytest.raises(RecordingError, match=r"0\.\d+ times"):
            judge(UR5, in_amperes)
