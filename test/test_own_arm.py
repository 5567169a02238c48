"""One's own arm: efforts in amperes, gains from a known load, its own unit, joints not recorded.

The simulated UR5 moves by Pinocchio's dynamics and friction that no effect of the package computes;
its currents are its torques over gains that the package is not told.
"""

from __future__ import annotations

import json
from contextlib import nullcontext
from dataclasses import dataclass, replace
from itertools import compress
from pathlib import Path

import numpy as np
import pytest
import yaml
from made_up_arm import write as write_made_up
from robots import PANDA, UR5

from dvrk_gravity.__main__ import main
from dvrk_gravity.arms import Arm, build_tree, nominal_inertias
from dvrk_gravity.compensate import DroppedSampleError, SampleReader
from dvrk_gravity.diagnosis import diagnose
from dvrk_gravity.effects import Payload, State
from dvrk_gravity.errors import ConfigError, RecordingError
from dvrk_gravity.identification import evaluate, identify
from dvrk_gravity.intake import KnownPayload, drive_gains, in_their_unit
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.planning import PlanLimits, exciting_motion
from dvrk_gravity.recording import Recording, RecordingFile
from dvrk_gravity.simulate import record_motion
from testing.plain_world import PlainWorld

pytestmark = pytest.mark.usefixtures("four_folds", "brief_simulation", "blank_pictures")

GAINS = np.array([12.0, 14.0, 11.0, 9.0, 10.5, 8.5])  # N·m/A
MASS, COM = 2.0, (0.02, 0.05, 0.08)  # kg, m in the last link's frame


def record(world: PlainWorld, motion: int, noise: int, duration: float = 20.0) -> Recording:
    """Record a motion by its seed, with noise of another."""
    planned = exciting_motion(PlanLimits.of(world.arm), duration + 10.0, motion)
    return record_motion(world.simulated(noise), planned, duration, 100.0)


def in_amperes(recording: Recording, gains: np.ndarray = GAINS) -> Recording:
    """The same as motors' drives tell it."""
    assert recording.effort is not None
    return replace(recording, effort=recording.effort / gains, arm=None)


@dataclass(frozen=True, eq=False)
class Lab:
    """Recordings of a UR5 in N·m (``bare``) and in A (the others), and their files."""

    bare: Recording
    currents: Recording
    loaded: Recording  # the same motion a second later
    elsewhere: Recording  # with the load, in another motion
    folder: Path


@pytest.fixture(scope="module")
def lab(tmp_path_factory) -> Lab:
    arm = Arm.load(UR5)
    world = PlainWorld.of(arm, nominal_inertias(arm))
    carrying = world.with_payload(arm.body_names[-1], MASS, COM)
    bare = record(world, 1, 11)
    same = in_amperes(record(carrying, 1, 12))
    shift = same.rows(slice(100, None))
    folder = tmp_path_factory.mktemp("lab")
    found = Lab(
        bare,
        in_amperes(bare),
        replace(shift, time=shift.time - shift.time[0], source="loaded"),
        in_amperes(record(carrying, 2, 13, 12.0)),
        folder,
    )
    for name in ("currents", "loaded", "elsewhere"):
        getattr(found, name).save(folder / f"{name}.csv")
    return found


def run(capsys, *words: object) -> tuple[int, str, str]:
    status = main([str(word) for word in words])
    return status, *capsys.readouterr()


def test_gains_that_are_given_make_the_model_that_torques_make(lab):
    arm = Arm.load(UR5)
    torques = identify(lab.bare, arm)
    currents = identify(lab.currents, arm.with_drive_gains(GAINS))
    for name, error in torques.held_out.items():
        assert currents.held_out[name].rmse == pytest.approx(error.rmse, rel=1e-6)
    assert currents.model.arm.effort_units == ("N·m",) * 6


def test_a_model_file_carries_its_gains_and_takes_currents(lab, tmp_path):
    fit = identify(
        lab.currents, Arm.load(UR5).with_drive_gains(GAINS), effects=["viscous_friction"]
    )
    fit.model.save(tmp_path / "model.yaml")
    model = TorqueModel.load(tmp_path / "model.yaml")
    np.testing.assert_array_equal(model.arm.drive_gains, GAINS)
    in_currents = evaluate(model, [lab.folder / "currents.csv"], "joint").joints
    in_torques = evaluate(model, [replace(lab.bare, arm=model.arm)], "joint").joints
    for name, error in in_torques.items():
        assert in_currents[name].rmse == pytest.approx(error.rmse, rel=1e-6)


def test_a_recording_that_is_saved_is_in_the_unit_that_it_was_read_in(lab, tmp_path):
    arm = Arm.load(UR5).with_drive_gains(GAINS)
    read = Recording.load(lab.folder / "currents.csv", arm=arm)
    np.testing.assert_allclose(read.effort, lab.bare.effort, rtol=1e-9)
    read.save(tmp_path / "again.csv")
    again = Recording.load(tmp_path / "again.csv")
    np.testing.assert_allclose(again.effort, lab.currents.effort, rtol=1e-9)


def test_a_node_reads_and_sends_what_the_arm_does():
    arm = Arm.load(UR5).with_drive_gains(GAINS)
    reader = SampleReader(arm.joint_names, gains=arm.drive_gains)
    sample = reader.read(1, arm.joint_names, np.zeros(6), np.zeros(6), np.ones(6))
    np.testing.assert_array_equal(sample.effort, GAINS)
    np.testing.assert_allclose(arm.reading_of_torque(sample.effort), np.ones(6))


def test_a_yaml_names_a_urdf_beside_it_and_adds_what_that_does_not_say(tmp_path):
    (tmp_path / "robot.urdf").write_text(Path(PANDA).read_text())
    content = {
        "urdf": "robot.urdf", "tip": "panda_hand", "name": "mine", "drive_gains": [2.0] * 7,
        "frictionless": ["panda_joint2"], "base_rpy": [0, 90, 0],
    }  # fmt: skip
    (tmp_path / "arm.yaml").write_text(yaml.safe_dump(content))
    arm = Arm.load(tmp_path / "arm.yaml")
    assert (arm.name, arm.n, arm.frictionless) == ("mine", 7, ("panda_joint2",))
    assert arm.drive_gains.tolist() == [2.0] * 7
    np.testing.assert_allclose(arm.gravity, [9.81, 0.0, 0.0], atol=1e-12)
    model = TorqueModel(arm, ())
    model.save(tmp_path / "model.yaml")
    assert TorqueModel.load(tmp_path / "model.yaml").arm.joint_names == arm.joint_names


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"drive_gains": [1, 2]}, "drive_gains: got [1, 2], expected a list of 4"),
        (
            {"drive_gains": [1, 2, 0, 1]},
            "drive_gains of insertion: got 0.0, expected 0.001 to 10000",
        ),
        ({"drive_gains": [1, "2", 3, 1]}, "drive_gains of pitch: got '2', expected a finite"),
        (
            {"drive_gains": [1, 2, 3, 1], "drive_gain_error": [0, 0, 0, -1]},
            "drive_gain_error of roll: got -1.0, expected 0 or more",
        ),
        (
            {"drive_gains": [1, 2, 3, 1], "drive_gain_error": [0, 0, 0, 1e300]},
            "drive_gain_error of roll: got 1e+300, expected a number from -1e+06",
        ),
        ({"drive_gains": [1, 2, 3, 1], "effort_unit": "A"}, "none with drive gains"),
        ({"drive_gain_error": [1, 2, 3, 1]}, "expected drive_gains beside it"),
        (
            {"effort_unit": "mN.m"},
            "got 'mN.m', expected drive gains instead, of 0.001",
        ),
        ({"effort_unit": "milli A"}, "effort_unit: got 'milli A', expected a unit"),
        ({"frictionless": ["elbow"]}, "frictionless: got 'elbow', expected some of yaw"),
        ({"tip": "link4"}, "tip: got 'tip', expected one of"),
    ],
)
def test_what_an_arm_cannot_be_read_in_is_refused_in_a_line(tmp_path, changes, said):
    with pytest.raises(ConfigError, match=r"made_up\.yaml: ") as error:
        Arm.load(write_made_up(tmp_path, changes))
    assert said in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("written", ["N·m", "Nm", "N.m", "N*m", "n m", "newton-metres"])
def test_newton_metres_are_taken_for_themselves_however_they_are_written(written):
    arm = Arm.load(UR5).with_effort_unit(written)
    assert set(arm.effort_units) == {"N·m"}
    assert arm.drive_gains.tolist() == [1.0] * arm.n


def test_a_joint_without_friction_is_fitted_without(tmp_path, lab):
    (tmp_path / "arm.yaml").write_text(
        yaml.safe_dump({"urdf": str(UR5), "frictionless": ["elbow_joint"], "effort_unit": "N·m"})
    )
    fit = identify(lab.bare, Arm.load(tmp_path / "arm.yaml"))
    names = [parameter.name for parameter in fit.parameters]
    assert any("friction" in name and "shoulder_lift" in name for name in names)
    assert not any("friction" in name and "elbow" in name for name in names)


@pytest.mark.parametrize("which", ["loaded", "elsewhere"], ids=["same motion", "another motion"])
def test_a_load_of_known_mass_tells_the_gains_of_the_joints_that_feel_it(lab, which):
    found = drive_gains([lab.currents], [getattr(lab, which)], Arm.load(UR5), KnownPayload(MASS))
    assert found.determined[1:4].all()  # shoulder_lift, elbow and wrist_1 lift it
    error = found.gain / GAINS - 1.0
    assert np.abs(error[found.determined]).max() < 0.06
    assert (np.abs(error) < 3.0 * found.error)[found.determined].all()


def test_a_load_of_which_no_link_is_told_is_where_a_payload_of_a_model_is():
    """Not on the last body, which of a gripper is the finger that follows the other."""
    arm = Arm.load(PANDA)
    (default,) = (p.default for p in Payload.schema(arm) if p.name == "payload.link")
    assert arm.body_names[KnownPayload(1.0).body(arm)] == default == "panda_leftfinger"
    held = Arm.load(PANDA).holding({"panda_finger_joint1": 0.02})
    assert held.body_names[KnownPayload(1.0).body(held)] == "panda_link7"


def test_the_joint_whose_torque_a_load_does_not_change_is_named():
    arm = Arm.load(UR5)
    world = PlainWorld.of(arm, nominal_inertias(arm))
    tiny = world.with_payload(arm.body_names[-1], 0.5, (0.0, 0.0, 0.0))
    found = drive_gains(
        [in_amperes(record(world, 1, 11, 30.0))], [in_amperes(record(tiny, 1, 12, 30.0))], arm,
        KnownPayload(0.5, centre=(0.0, 0.0, 0.0)),
    )  # fmt: skip
    assert not found.determined[4:].any()  # it lies on the axes of both
    assert found.determined[1:4].all()
    assert "the load does not determine the gain of" in found.lines(arm)[-1]
    assert arm.joint_names[5] in found.lines(arm)[-1]


def test_identify_with_a_known_load_writes_a_model_of_the_arm_without_it(lab, tmp_path, capsys):
    out = tmp_path / "model.yaml"
    status, text, _ = run(
        capsys, "identify", lab.folder / "currents.csv", lab.folder / "loaded.csv", "--arm", UR5,
        "--known-payload", MASS, "--out", out, "--terms", "viscous_friction,coulomb_friction",
    )  # fmt: skip
    assert status == 0
    assert "drive gains from the known load" in text
    model = TorqueModel.load(out)
    bare = evaluate(model, [lab.folder / "currents.csv"], "joint").joints
    assert max(error.nrmse for error in bare.values()) < 0.15


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["currents.csv", "--drive-gains", "1,2,3"], "--drive-gains: got '3 numbers', expected 6"),
        (["currents.csv", "--drive-gains", "1,2,3,a,5,6"], "6 numbers with commas between"),
        (["currents.csv", "--drive-gains", "1,2,3,4,5,-6"], "wrist_3_joint: got -6.0, expected"),
        (["currents.csv", "--drive-gains", "1e-300,2,3,4,5,6"], "got 1e-300, expected 0.001 to 1"),
        (["currents.csv", "--drive-gains", ".012,.014,.011,.009,.0105,.0085"],
         "expected N·m/A: with these gains, torques are 0.001 times what the masses"),
        (["currents.csv", "loaded.csv", "--known-payload", "0.002"],
         "expected N·m/A: with these gains, torques are 0.0"),
        (["loaded.csv", "currents.csv", "--known-payload", "2"], "with that load last"),
        (["currents.csv", "--known-payload", "2"], "one recording is too few for a known load"),
        (["currents.csv", "loaded.csv", "--known-payload", "-2"], "more than 0 kg"),
        (["currents.csv", "--payload-link", "tool0"], "expected --known-payload beside it"),
        (["currents.csv", "loaded.csv", "--known-payload", "2", "--payload-centre", "1,2"],
         "--payload-centre: got '2 numbers', expected 3"),
        (["currents.csv", "loaded.csv", "--known-payload", "2", "--drive-gains", "1,2,3,4,5,6"],
         "no drive gains with it"),
    ],
)  # fmt: skip
def test_what_no_gain_can_be_told_by_is_refused_in_a_line(lab, tmp_path, capsys, words, said):
    files = [lab.folder / word if word.endswith(".csv") else word for word in words]
    status, _, error = run(capsys, "identify", *files, "--arm", UR5, "--out", tmp_path / "m.yaml")
    assert status == 2
    assert said in error
    assert error.count("\n") == 1


@pytest.fixture(scope="module")
def own_unit(lab) -> Path:
    path = lab.folder / "own_unit.yaml"
    fit = identify(lab.folder / "currents.csv", UR5)
    assert any("not in N·m" in line for line in fit.handling)
    fit.model.save(path)
    assert {parameter.unit for parameter in fit.parameters}.isdisjoint(
        {"N·m", "kg", "kg·m", "kg·m^2", "N"}
    )
    return path


def test_without_gains_a_model_is_in_its_recordings_unit_and_says_so(lab, own_unit, capsys):
    model = TorqueModel.load(own_unit)
    assert model.arm.effort_units == ("a.u.",) * 6
    status, text, _ = run(capsys, "evaluate", lab.folder / "currents.csv", "--model", own_unit)
    assert status == 1  # in a unit that nobody states it is not to be compensated with
    assert "RMSE a.u." in text
    assert "N·m" not in text


def test_gains_that_the_arms_masses_do_not_go_with_are_doubted(lab):
    """A load of 2 kg that is told as 12 is no slip of a unit: it may be, and is asked about."""
    fit = identify(
        [lab.currents, lab.loaded], Arm.load(UR5), known_payload=KnownPayload(6.0 * MASS)
    )
    (doubt,) = [line for line in fit.handling if line.startswith("warning: ")]
    assert "times what the masses in the arm's file need" in doubt
    assert "a known load in kg" in doubt


@pytest.mark.slow
def test_without_gains_a_load_is_found_all_the_same(lab, own_unit, capsys, tmp_path):
    status, text, _ = run(
        capsys, "diagnose", lab.folder / "elsewhere.csv", "--model", own_unit, "--out", tmp_path
    )
    assert status == 0
    first, *_ = json.loads((tmp_path / "findings.json").read_text())["findings"]
    assert (first["effect"], first["joints"]) == ("payload", [Arm.load(UR5).joint_names[-1]])
    mass = first["parameters"]["mass"]
    assert mass["unit"] == "kg·a.u./(N·m)"
    # Times a gain it is the mass; gains differ from joint to joint.
    assert GAINS.min() * mass["value"] < 1.2 * MASS
    assert GAINS.max() * mass["value"] > 0.8 * MASS
    assert "mN·m" not in text


def test_an_effort_against_what_nominal_masses_need_is_warned_of(lab):
    arm, effort = Arm.load(UR5), lab.bare.effort.copy()
    assert in_their_unit(arm, [lab.bare])[1] == ()
    effort[:, 1] *= -1.0

    _, (line,) = in_their_unit(arm, [replace(lab.bare, effort=effort)])

    assert "the effort of shoulder_lift_joint is opposite to" in line


def test_efforts_that_are_said_to_be_in_newton_metres_are(lab, tmp_path, capsys):
    status, text, _ = run(
        capsys, "identify", lab.folder / "currents.csv", "--arm", UR5, "--effort-unit", "N·m",
        "--terms", "viscous_friction", "--out", tmp_path / "m.yaml",
    )  # fmt: skip
    assert "RMSE N·m" in text
    assert status in (0, 1)  # whatever the verdict on it
    model = TorqueModel.load(tmp_path / "m.yaml")
    assert model.arm.effort_units == ("N·m",) * 6


def test_a_model_in_another_unit_takes_no_gains(lab, own_unit, capsys):
    status, _, error = run(
        capsys, "evaluate", lab.folder / "currents.csv", "--model", own_unit, "--drive-gains",
        "1,2,3,4,5,6",
    )  # fmt: skip
    assert status == 2
    assert "the model is in a.u." in error


# --- joints that were not recorded ------------------------------------------------------


def test_a_joint_that_is_not_where_the_model_has_it_held_is_told(tmp_path):
    arm = Arm.load(PANDA)
    finger = arm.joint_names[-1]
    held = arm.holding({finger: 0.01})
    position = np.zeros((5, arm.n))
    position[:, -1] = [0.01, 0.012, 0.01, 0.01, 0.06]
    elsewhere = Recording(
        arm.joint_names, 0.1 * np.arange(5.0), position, effort=position + 1.0, source="run"
    )
    told = f"sample 4: {finger} is at 0.06, expected 0.01, where the model's arm holds it"
    assert elsewhere.rows(slice(4)).of(held).joints == held.joint_names
    with pytest.raises(RecordingError, match=told):
        elsewhere.of(held)
    elsewhere.save(tmp_path / "run.csv")
    with pytest.raises(RecordingError, match=told):
        RecordingFile(tmp_path / "run.csv", arm=held)

    reader = SampleReader(held.joint_names, held=held.held)
    for row, stays in zip(position, [True, True, True, True, False], strict=True):
        expected = nullcontext() if stays else pytest.raises(DroppedSampleError, match="fixed at")
        with expected:
            reader.read(1, arm.joint_names, row, (), ())
    assert reader.read(2, held.joint_names, np.zeros(held.n), (), ()).stamp == 2


def test_an_arm_that_is_held_has_the_dynamics_of_one_whose_joint_does_not_move():
    arm = Arm.load(PANDA)
    held = arm.holding({arm.joint_names[-1]: 0.01})
    trees = [
        build_tree(variant, nominal_inertias(variant), variant.gravity) for variant in (arm, held)
    ]
    random = np.random.default_rng(0)
    for q, qd, qdd in random.normal(size=(5, 3, 7)):
        whole = trees[0].inverse_dynamics(np.append(q, 0.01), np.append(qd, 0), np.append(qdd, 0))
        np.testing.assert_allclose(trees[1].inverse_dynamics(q, qd, qdd), whole[:7], atol=1e-12)


@pytest.fixture(scope="module")
def without_fingers(tmp_path_factory) -> Path:
    """A Panda's seven joints, of an arm that has eight."""
    arm = Arm.load(f"{PANDA}#panda_hand")
    world = PlainWorld.of(arm, nominal_inertias(arm))
    path = tmp_path_factory.mktemp("panda") / "seven.csv"
    replace(record(world, 1, 11), arm=None).save(path)
    return path


def test_joints_beyond_those_recorded_are_held_and_named(without_fingers, tmp_path):
    fit = identify(without_fingers, PANDA, effects=["viscous_friction", "coulomb_friction"])
    (line,) = (line for line in fit.handling if "not recorded" in line)
    assert "panda_finger_joint1 at 0" in line
    assert fit.model.arm.n == 7
    fit.model.save(tmp_path / "model.yaml")
    assert TorqueModel.load(tmp_path / "model.yaml").arm.held == {"panda_finger_joint1": 0.0}


def test_joints_beyond_those_recorded_are_held_where_it_is_said(without_fingers):
    at = {"panda_finger_joint1": 0.02}
    fit = identify(without_fingers, PANDA, effects=["viscous_friction"], still=at)
    assert fit.model.arm.held == at


def test_a_load_is_weighed_against_a_reference_that_lacks_the_fingers(without_fingers):
    arm = Arm.load(f"{PANDA}#panda_hand")
    loaded = record(PlainWorld.of(arm, nominal_inertias(arm)), 1, 12)
    q, qd = loaded.position, loaded.velocity
    assert q is not None
    assert qd is not None
    assert loaded.effort is not None
    assert loaded.rate
    state = State(q, qd, np.gradient(qd, 1.0 / loaded.rate, axis=0))
    load = Payload(arm, arm.body_names[-1], MASS, MASS * np.array(COM), arm.gravity)
    loaded = replace(loaded, effort=loaded.effort + load.torque(state), arm=None)
    found = diagnose(loaded, reference=without_fingers, arm=PANDA)
    assert list(found.before) == list(arm.joint_names)
    assert found.findings[0].effect == "payload"
    mass = found.findings[0].parameters["mass"]
    assert mass.low < MASS < mass.high
    assert mass.value == pytest.approx(MASS, rel=0.005)


def test_a_model_of_more_joints_is_judged_on_those_that_were_recorded(without_fingers):
    whole = Arm.load(PANDA)
    found = evaluate(TorqueModel(whole, ()), [without_fingers], "joint")
    assert list(found.joints) == list(whole.joint_names[:7])
    assert any("panda_finger_joint1 at 0" in line for line in found.handling)


def test_a_joint_that_carries_the_recorded_ones_has_to_be_recorded(without_fingers, tmp_path):
    header, rows = without_fingers.read_text().split("\n", 1)
    second = [not name.startswith("panda_joint2.") for name in header.split(",")]
    text = "\n".join(
        ",".join(compress(row.split(","), second)) for row in (header, *rows.split("\n")) if row
    )
    (tmp_path / "six.csv").write_text(text)
    with pytest.raises(RecordingError, match="has no panda_joint2, panda_finger_joint1"):
        identify(tmp_path / "six.csv", PANDA)


def test_columns_of_joints_that_are_not_the_arm_s_are_left_out(without_fingers, tmp_path):
    header, *rows = without_fingers.read_text().split()
    more = [f"{header},door.position,door.effort", *(f"{row},1,2" for row in rows)]
    (tmp_path / "more.csv").write_text("\n".join(more))
    read = Recording.load(tmp_path / "more.csv", arm=Arm.load(f"{PANDA}#panda_hand"))
    np.testing.assert_array_equal(read.effort, Recording.load(without_fingers).effort)


def test_joints_beyond_one_that_is_not_recorded_may_be_said_to_stand_somewhere(
    without_fingers, tmp_path
):
    header, *rows = without_fingers.read_text().split()
    kept = [not name.startswith("panda_joint7.") for name in header.split(",")]
    text = [",".join(compress(row.split(","), kept)) for row in (header, *rows)]
    (tmp_path / "six.csv").write_text("\n".join(text))
    still = {"panda_finger_joint1": 0.02}
    fit = identify(tmp_path / "six.csv", PANDA, effects=["viscous_friction"], still=still)
    assert fit.model.arm.held == {"panda_joint7": 0.0, **still}
