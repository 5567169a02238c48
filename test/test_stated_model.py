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
from dvrk_gravity.diagnosis import Diagnosis, diagnose
from dvrk_gravity.errors import ConfigError, RecordingError
from dvrk_gravity.identification import evaluate
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Recording
from dvrk_gravity.report import diagnosis_text
from testing.plain_world import PlainWorld

URDF = Path(UR5).read_text()
MASS, COM = 1.5, (0.02, 0.05, 0.08)  # kg, m in the last link's frame


@pytest.fixture(scope="module")
def world() -> PlainWorld:
    arm = Arm.load(UR5)
    bare = PlainWorld.of(arm, nominal_inertias(arm))
    return bare.with_payload(arm.body_names[-1], MASS, COM)


@pytest.fixture(scope="module")
def recording(world) -> Recording:
    return world.record(1, 15.0)


@pytest.fixture(scope="module")
def diagnosed(recording) -> Diagnosis:
    return diagnose(recording, UR5)


@pytest.mark.parametrize("path", [UR5, f"{PANDA}#panda_hand"])
def test_it_states_the_torque_that_pinocchio_computes_from_the_same_file(path):
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


def test_what_the_arm_has_and_the_file_does_not_is_found_at_every_joint(world, diagnosed):
    """A load, and friction of six joints of which the file says nothing."""
    found = {(finding.effect, finding.joints): finding for finding in diagnosed.findings}
    load = found["payload", world.arm.joint_names[-1:]].parameters
    assert load["mass"].value == pytest.approx(MASS, rel=0.05)
    for axis, place in zip("xyz", COM, strict=True):
        assert load[axis].value == pytest.approx(place, abs=0.01)
    for joint, level, slope in zip(
        world.arm.joint_names, world.coulomb, world.viscous, strict=True
    ):
        dry = found["coulomb_friction", (joint,)].parameters["positive"]
        assert dry.value == pytest.approx(level, rel=0.05)
        viscous = found["viscous_friction", (joint,)].parameters["coefficient"]
        assert viscous.value == pytest.approx(slope, rel=0.05)
    assert len(found) == 13
    # What a file says little of is no surprise, and no headline.
    assert diagnosed.findings[0].effect == "payload"


def test_a_load_is_found_though_the_file_states_more_damping_than_there_is(
    world, recording, tmp_path
):
    """Many files have one damping throughout, some of it far too large."""
    placeholder = tmp_path / "robot.urdf"
    placeholder.write_text(re.sub('damping="0.0"', 'damping="30.0"', URDF))
    assert (world.viscous < 30.0).all()

    first, *others = diagnose(recording, placeholder).findings

    assert first.effect == "payload"
    assert first.parameters["mass"].value == pytest.approx(MASS, rel=0.05)
    for finding in others:
        joint = world.arm.joint_names.index(finding.joints[0])
        if finding.effect == "viscous_friction":
            less = 30.0 - world.viscous[joint]
            assert -finding.parameters["coefficient"].value == pytest.approx(less, rel=0.02)
    assert {finding.effect for finding in others} == {"viscous_friction", "coulomb_friction"}
    assert len(others) == 12


def test_what_a_reading_does_to_other_causes_is_not_told_as_more_of_them(world, recording):
    """A factor reads too much of a payload's torque and of friction's, too."""
    joint, factor = 1, 1.15
    read = recording.effort * np.where(np.arange(6) == joint, factor, 1.0)

    diagnosis = diagnose(replace(recording, effort=read), UR5)

    found = {(finding.effect, finding.joints): finding for finding in diagnosis.findings}
    names = world.arm.joint_names
    scale = found["torque_scale", (names[joint],)].parameters["factor"]
    assert scale.value == pytest.approx(factor, rel=0.01)
    assert found["payload", names[-1:]].parameters["mass"].value == pytest.approx(MASS, rel=0.05)
    dry = found["coulomb_friction", (names[joint],)].parameters["positive"]
    assert dry.value == pytest.approx(world.coulomb[joint], rel=0.05)
    assert len(found) == 14


@pytest.mark.usefixtures("four_folds")
@pytest.mark.parametrize("joint", [1, 5], ids=["that bears weight", "that bears none"])
def test_an_effort_of_the_wrong_sign_is_told_though_the_file_has_no_friction(world, joint):
    recording = PlainWorld.of(world.arm, nominal_inertias(world.arm)).record(1, 10.0)
    sign = np.where(np.arange(6) == joint, -1.0, 1.0)

    first, *others = diagnose(replace(recording, effort=sign * recording.effort), UR5).findings

    assert first.effect == "wrong_coordinates"
    assert first.sentence.startswith(
        f"The recording is read wrongly: the effort of {recording.joints[joint]} has the wrong sign"
    )
    assert first.gain.relative > 0.8
    assert len(others) == 12  # as if it had been right


@pytest.mark.usefixtures("four_folds")
def test_poses_of_an_arm_as_its_file_says_are_nothing_to_explain():
    """Not even at a joint on which nothing weighs, where the file has no error at all."""
    random = np.random.default_rng(0)
    q = random.uniform(-1.5, 1.5, (80, 6))
    effort = TorqueModel.stated(UR5).torque(q) + 0.05 * random.normal(size=q.shape)

    found = diagnose(Recording(Arm.load(UR5).joint_names, None, q, effort=effort), UR5)

    assert found.verdict == "nothing_to_explain"


def test_what_is_done_alike_at_several_joints_is_told_once(diagnosed):
    """Twelve findings of friction are no twelve things to do."""
    told = list(diagnosis_text(diagnosed, verbose=True))

    assert told[0] == "explained: 13 findings, certain"
    assert "\n".join(told).count("removes") > 13  # each with its sizes
    done = [line for line in told if "what to do: " in line]
    assert len(done) == 3
    assert "an arm's file states little of it: use the extended model, which has it" in done[1]


def test_convert_writes_it_as_a_model_file(tmp_path, capsys):
    out = tmp_path / "model.yaml"

    assert main(["convert", str(UR5), str(out)]) == 0

    assert "link_weight + link_inertia" in capsys.readouterr().out
    q, qd, qdd = np.random.default_rng(0).uniform(-1.5, 1.5, (3, 6))
    written, stated = (TorqueModel.load(path).torque(q, qd, qdd) for path in (out, UR5))
    np.testing.assert_allclose(written, stated, rtol=1e-12)
    assert main(["convert", str(UR5), str(tmp_path / "model.csv")]) == 2
    assert "expected a file ending in .yaml or .yml" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["evaluate", "run.csv", "--model", CONFIG / "arms" / "psm.yaml"], 'got "an arm\'s file"'),
        (["evaluate", "run.csv", "--model", CONFIG / "plants" / "psm.yaml"], "a plant's file"),
        (["evaluate", "run.csv", "--model", UR5, "--drive-gains", "1,2"], "expected 6, one for"),
        (["identify", "run.csv", "--arm", MODEL_FILE, "--out", "x.yaml"], "a model's parameters"),
        (["identify", "run.csv", "--arm", UR5, "--out", "x.urdf"], "a .yaml file for the model"),
        (["convert", MODEL_FILE, "x.yaml"], "expected an arm's .urdf, or a .yaml with one"),
    ],
)
def test_files_taken_for_one_another_are_told(
    words, said, recording, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    recording.save("run.csv")
    assert main([str(word) for word in words]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1


def test_a_link_of_which_the_file_states_no_mass_is_named(recording, tmp_path):
    text = re.sub(r"<inertial>\s*<mass value=\"2.275\".*?</inertial>", "", URDF, flags=re.DOTALL)
    (tmp_path / "robot.urdf").write_text(text)

    evaluated = evaluate(tmp_path / "robot.urdf", recording)

    (first, *_) = evaluated.warnings
    assert str(first).startswith("in the arm's file: no mass of forearm_link, which a joint moves")


@pytest.mark.parametrize("verb", ["replay", "demo"])
def test_a_node_reads_a_model_file_and_no_urdf(verb, tmp_path, capsys):
    words = {"replay": ["bag", "--model", UR5], "demo": ["--model", UR5, "--out", tmp_path]}
    assert main([verb, *map(str, words[verb])]) == 2
    assert "expected a model file, as `convert robot.urdf" in capsys.readouterr().err


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


def test_a_folder_may_be_called_as_if_a_link_followed(tmp_path, monkeypatch):
    folder = tmp_path / "h#sh"
    folder.mkdir()
    (folder / "robot.urdf").write_text(URDF)
    monkeypatch.chdir(folder)
    TorqueModel.load("robot.urdf").save(tmp_path / "model.yaml")

    again = TorqueModel.load(tmp_path / "model.yaml")

    assert again.arm.source.endswith("h#sh/robot.urdf")


def test_a_name_with_a_dot_is_refused_before_parameters_are_grouped_by_it(tmp_path):
    text = URDF.replace("forearm_link", "wrist_1_link.cover")
    (tmp_path / "robot.urdf").write_text(text)
    with pytest.raises(ConfigError, match=r"got 'wrist_1_link\.cover', expected one without"):
        Arm.load(tmp_path / "robot.urdf")


def test_a_link_may_be_called_as_a_number_is_written(tmp_path):
    text = URDF.replace("forearm_link", "1e3")
    (tmp_path / "robot.urdf").write_text(text)
    model = TorqueModel.load(tmp_path / "robot.urdf")
    model.save(tmp_path / "model.yaml")
    q = np.ones(6)
    np.testing.assert_allclose(
        TorqueModel.load(tmp_path / "model.yaml").torque(q), model.torque(q), rtol=1e-12
    )


@pytest.mark.slow
@pytest.mark.usefixtures("four_folds")
def test_joints_that_no_recording_holds_are_held_and_a_load_is_found_all_the_same():
    """A Panda's fingers; their masses are the hand's."""
    arm = Arm.load(f"{PANDA}#panda_hand")
    bare = PlainWorld.of(arm, nominal_inertias(arm))
    recording = bare.with_payload(arm.body_names[-1], 0.8, (0.02, 0.0, 0.2)).record(1, 12.0)

    diagnosis = diagnose(recording, PANDA)

    load = next(found for found in diagnosis.findings if found.effect == "payload")
    assert load.joints == arm.joint_names[-1:]
    assert load.parameters["mass"].value == pytest.approx(0.8, rel=0.05)
    assert any(note.startswith("not recorded, assumed held") for note in diagnosis.notes)
    assert set(diagnosis.before) == set(arm.joint_names)


def test_efforts_that_are_insisted_on_are_taken(recording, tmp_path, capsys):
    halved = replace(recording, effort=0.1 * recording.effort)
    halved.save(tmp_path / "motion.csv")
    words = ["evaluate", tmp_path / "motion.csv", "--model", UR5]
    assert main([str(word) for word in words]) == 2
    assert "--effort-unit N·m overrides them" in capsys.readouterr().err
    # Taken, and of that size not what the file's masses need.
    assert main([str(word) for word in (*words, "--effort-unit", "Nm")]) == 1
    assert "do not compensate with this" in capsys.readouterr().out


def test_its_error_is_told_with_no_verdict(recording, tmp_path, capsys):
    recording.save(tmp_path / "motion.csv")

    status = main(["evaluate", str(tmp_path / "motion.csv"), "--model", str(UR5)])

    said = capsys.readouterr().out
    assert "the model carries no verdict of identify" in said
    assert "it would be: do not compensate with this" in said  # masses alone: no friction
    assert status == 1


def test_a_yaml_that_names_a_urdf_is_the_same_model_with_its_gains(recording, tmp_path):
    (tmp_path / "arm.yaml").write_text(yaml.safe_dump({"urdf": str(UR5), "drive_gains": [2.0] * 6}))
    halved = replace(recording, effort=0.5 * recording.effort, arm=None)

    by_gains = evaluate(tmp_path / "arm.yaml", halved).joints

    for name, error in evaluate(UR5, recording).joints.items():
        assert by_gains[name].rmse == pytest.approx(error.rmse, rel=1e-6)


@pytest.mark.parametrize("judge", [evaluate, lambda model, given: diagnose(given, model)])
def test_efforts_that_its_masses_do_not_need_are_refused(recording, judge):
    in_amperes = replace(recording, effort=0.08 * recording.effort)
    with pytest.raises(RecordingError, match=r"efforts are 0\.\d+ times what the masses"):
        judge(UR5, in_amperes)


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


def test_another_unit_than_the_model_s_is_refused(recording, tmp_path, capsys):
    recording.save(tmp_path / "motion.csv")
    words = ["evaluate", tmp_path / "motion.csv", "--model", UR5, "--effort-unit", "furlong"]

    status = main([str(word) for word in words])

    assert status == 2
    assert "--effort-unit: got 'furlong', expected N·m" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("written", "instead"),
    [('value="8.393"', 'value="8.393 "'), ('value="8.393"', 'value="\uff18.393"'),
     ('xyz="0.0 0.0 0.28"', 'xyz="0.0&#9;0.0&#10;0.28"'), ('friction="0.0"', 'friction="0.0 "')],
)  # fmt: skip
def test_numbers_with_blanks_tabs_and_other_digits_weigh_the_same(written, instead, tmp_path):
    """Pinocchio's reader drops an inertia whose numbers it cannot read, and says so nowhere."""
    assert written in URDF
    (tmp_path / "robot.urdf").write_text(URDF.replace(written, instead))
    q, qd, qdd = np.random.default_rng(0).uniform(-1.5, 1.5, (3, 6))
    given, plain = (TorqueModel.load(path) for path in (tmp_path / "robot.urdf", UR5))
    np.testing.assert_allclose(given.torque(q, qd, qdd), plain.torque(q, qd, qdd), rtol=1e-12)


def test_a_model_is_not_saved_over_its_arm_s_file(tmp_path):
    (tmp_path / "own.urdf").write_text(URDF)
    model = TorqueModel.load(tmp_path / "own.urdf")
    with pytest.raises(ConfigError, match=r"own.urdf, which is read"):
        model.save(tmp_path / "own.urdf")
    assert (tmp_path / "own.urdf").read_text() == URDF
