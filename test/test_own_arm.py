"""One's own arm: efforts in amperes, gains from a known load, its own unit, joints not recorded.

The simulated UR5 moves by Pinocchio's dynamics and friction that no effect of the package computes;
its currents are its torques over gains that the package does not know.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import fitted
import numpy as np
import pytest
from fitted import FEW
from made_up_arm import write as write_made_up
from robots import PANDA, UR5

from dvrk_gravity.__main__ import main
from dvrk_gravity.arms import Arm, build_tree, nominal_inertias
from dvrk_gravity.compensate import DroppedSampleError, SampleReader
from dvrk_gravity.errors import ConfigError, RecordingError
from dvrk_gravity.identification import evaluate, identify
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.observation import KnownPayload, drive_gains, in_their_unit, require_newtons
from dvrk_gravity.planning import PlanLimits, exciting_motion
from dvrk_gravity.recording import Recording, load_excerpt
from dvrk_gravity.simulate import record_motion
from testing.plain_world import PlainWorld

GAINS = np.array([12.0, 14.0, 11.0, 9.0, 10.5, 8.5])  # N·m/A
MASS, COM = 2.0, (0.02, 0.05, 0.08)  # kg, m in the last link's frame
HAND, FINGER = f"{PANDA}#panda_hand", "panda_finger_joint1"


def record(world: PlainWorld, motion: int, noise: int, duration: float = 20.0) -> Recording:
    """Record a motion by its seed, with noise of another."""
    planned = exciting_motion(PlanLimits.of(world.arm), duration + 10.0, motion)
    return record_motion(world.simulated(noise), planned, duration, 100.0)


def in_amperes(recording: Recording) -> Recording:
    """The same as motors' drives read it."""
    return replace(recording, effort=recording.effort / GAINS, arm=None)


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
    world = fitted.world_of(Arm.load(UR5))
    carrying = world.with_payload(world.arm.body_names[-1], MASS, COM)
    bare = record(world, 1, 11)
    shift = in_amperes(record(carrying, 1, 12)).rows(slice(100, None))
    shift = replace(shift, time=shift.time - shift.time[0], source="loaded")
    elsewhere = in_amperes(record(carrying, 2, 13, 12.0))
    found = Lab(bare, in_amperes(bare), shift, elsewhere, tmp_path_factory.mktemp("lab"))
    for name in ("currents", "loaded"):
        getattr(found, name).save(found.folder / f"{name}.csv")
    return found


def run(*words: object) -> int:
    return main([str(word) for word in words])


# --- gains -------------------------------------------------------------------------------


def test_gains_that_are_given_make_the_model_that_torques_make_and_its_file_takes_currents(
    lab, tmp_path
):
    arm = Arm.load(UR5)
    torques = identify(lab.bare, arm, effects=FEW, physical=False)
    currents = identify(lab.currents, arm.with_drive_gains(GAINS), effects=FEW, physical=False)
    for name, error in torques.held_out.items():
        assert currents.held_out[name].rmse == pytest.approx(error.rmse, rel=1e-6)
    currents.model.save(tmp_path / "model.yaml")
    model = TorqueModel.load(tmp_path / "model.yaml")
    assert model.arm.effort_units == ("N·m",) * 6
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
    reader = SampleReader(arm)
    sample = reader.read(1, arm.joint_names, np.zeros(6), np.zeros(6), np.ones(6))
    np.testing.assert_array_equal(sample.effort, GAINS)
    np.testing.assert_allclose(arm.reading_of_torque(sample.effort), np.ones(6))


def test_what_an_arm_cannot_be_read_in_is_refused_in_a_line(tmp_path):
    four = {"drive_gains": [1, 2, 3, 1]}
    for changes, says in (
        ({"drive_gains": [1, 2]}, "drive_gains: got [1, 2], expected a list of 4"),
        ({"drive_gains": [1, 2, 0, 1]}, "drive_gains of insertion: got 0.0"),
        (four | {"drive_gain_error": [0, 0, 0, -1]}, "of roll: got -1.0"),
        (four | {"effort_unit": "A"}, "effort_unit"),
        ({"drive_gain_error": [1, 2, 3, 1]}, "expected drive_gains"),
        ({"effort_unit": "mN.m"}, "got 'mN.m', expected drive gains instead, of 0.001"),
        ({"frictionless": ["elbow"]}, "frictionless: got 'elbow', expected some of yaw"),
    ):
        with pytest.raises(ConfigError, match=r"made_up\.yaml: ") as error:
            Arm.load(write_made_up(tmp_path, changes))
        assert says in str(error.value)
        assert "\n" not in str(error.value)


def test_newton_metres_are_taken_for_themselves_however_they_are_written():
    for written in ("N·m", "Nm", "N.m", "N*m", "n m", "newton-metres"):
        arm = Arm.load(UR5).with_effort_unit(written)
        assert set(arm.effort_units) == {"N·m"}, written
        assert arm.drive_gains.tolist() == [1.0] * arm.n


def test_a_joint_without_friction_is_fitted_without(lab):
    arm = replace(Arm.load(UR5).with_effort_unit("N·m"), frictionless=("elbow_joint",))
    names = [p.name for p in identify(lab.bare, arm, effects=FEW, physical=False).parameters]
    assert any("friction" in name and "shoulder_lift" in name for name in names)
    assert not any("friction" in name and "elbow" in name for name in names)


@pytest.mark.parametrize("which", ["loaded", "elsewhere"], ids=["same motion", "another motion"])
def test_a_load_of_known_mass_determines_the_gains_of_the_joints_that_feel_it(lab, which):
    found = drive_gains([lab.currents], [getattr(lab, which)], Arm.load(UR5), KnownPayload(MASS))
    assert found.determined[1:4].all()  # shoulder_lift, elbow and wrist_1 lift it
    error = found.gain / GAINS - 1.0
    assert np.abs(error[found.determined]).max() < 0.06
    assert (np.abs(error) < 3.0 * found.error)[found.determined].all()


def test_joints_on_whose_axes_a_load_lies_learn_no_gain_and_are_named(lab):
    arm = Arm.load(UR5)
    tiny = fitted.world_of(arm).with_payload(arm.body_names[-1], 1.5, (0.0, 0.0, 0.0))
    loaded = in_amperes(record(tiny, 1, 12))
    found = drive_gains([lab.currents], [loaded], arm, KnownPayload(1.5, centre=(0.0, 0.0, 0.0)))
    assert not found.determined[4:].any()
    assert found.determined[1:4].all()
    assert arm.joint_names[5] in found.notes(arm)[-1].text


def test_what_determines_no_gain_is_refused_in_a_line(lab, tmp_path, capsys):
    bare, loaded = lab.folder / "currents.csv", lab.folder / "loaded.csv"
    wrong = ".012,.014,.011,.009,.0105,.0085"
    for words, says in (
        ((bare, "--drive-gains", "1,2,3"), "--drive-gains: got '3 numbers', expected 6"),
        ((bare, "--drive-gains", "1,2,3,4,5,-6"), "wrist_3_joint: got -6.0"),
        ((bare, "--drive-gains", wrong), "0.001 times"),
        ((bare, loaded, "--known-payload", "0.002"), "expected N·m/A"),
        ((loaded, bare, "--known-payload", "2"), "with that load last"),
        ((bare, "--known-payload", "2"), "one recording is too few"),
        ((bare, loaded, "--known-payload", "-2"), "more than 0 kg"),
        ((bare, "--payload-link", "tool0"), "expected --known-payload"),
        ((bare, loaded, "--known-payload", "2", "--drive-gains", wrong), "no drive gains"),
    ):
        assert run("identify", *words, "--arm", UR5, "--out", tmp_path / "m.yaml") == 2
        error = capsys.readouterr().err
        assert says in error
        assert error.count("\n") == 1


# --- a unit that nobody states -----------------------------------------------------------


def test_a_unit_is_doubted_from_a_factor_of_four_on_and_gains_are_refused_from_thirty(lab):
    arm = Arm.load(UR5)
    with_gains, bare = arm.with_drive_gains(GAINS), lab.bare.rows(slice(1000))

    def scaled(factor: float) -> Recording:
        return replace(bare, effort=factor * bare.effort, arm=None)

    for factor, unit in ((0.22, "a.u."), (0.28, "N·m"), (3.6, "N·m"), (4.4, "a.u.")):
        found, notes = in_their_unit(arm, [scaled(factor)])
        assert (found.effort_units, bool(notes)) == ((unit,) * 6, unit == "a.u."), factor
        if notes:
            assert found.effort_size == pytest.approx(factor, rel=0.1)
    for factor, doubted in ((0.04, True), (0.28, False), (3.6, False), (4.4, True), (27.0, True)):
        _, notes = in_their_unit(with_gains, [in_amperes(scaled(factor))])
        assert any(note.kind == "effort_unit" for note in notes) == doubted, factor
        twice = 2 * [in_amperes(scaled(factor))]
        odd = tuple(note for note in notes if note.kind != "effort_read")
        assert require_newtons(TorqueModel.from_arm(with_gains), twice) == odd
    for factor in (0.03, 34.0):
        with pytest.raises(ConfigError, match="drive gains"):
            in_their_unit(with_gains, [in_amperes(scaled(factor))])
    assert in_their_unit(arm.with_effort_unit("N·m"), [scaled(9.0)])[1] == ()


def test_an_effort_against_what_nominal_masses_need_is_warned_of(lab):
    arm, effort = Arm.load(UR5), lab.bare.effort.copy()
    assert in_their_unit(arm, [lab.bare])[1] == ()
    effort[:, 1] *= -1.0
    (note,) = in_their_unit(arm, [replace(lab.bare, effort=effort)])[1]
    assert (note.kind, "shoulder_lift_joint" in note.text) == ("effort_sign", True)


# --- joints that were not recorded -------------------------------------------------------


def test_a_joint_that_is_not_where_the_model_has_it_held_is_refused(tmp_path):
    arm = Arm.load(PANDA)
    held = arm.with_held_joints({FINGER: 0.01})
    position = np.zeros((5, arm.n))
    position[:, -1] = [0.01, 0.012, 0.01, 0.01, 0.06]
    elsewhere = Recording(
        arm.joint_names, 0.1 * np.arange(5.0), position, effort=position + 1.0, source="run"
    )
    says = f"sample 4: {FINGER} is at 0.06, expected 0.01"
    assert elsewhere.rows(slice(4)).of(held).joints == held.joint_names
    with pytest.raises(RecordingError, match=says):
        elsewhere.of(held)
    elsewhere.save(tmp_path / "run.csv")
    with pytest.raises(RecordingError, match=says):
        load_excerpt(tmp_path / "run.csv", arm=held)
    reader = SampleReader(held)
    for row in position[:4]:
        reader.read(1, arm.joint_names, row, (), ())
    with pytest.raises(DroppedSampleError, match=FINGER):
        reader.read(1, arm.joint_names, position[4], (), ())
    assert reader.read(2, held.joint_names, np.zeros(held.n), (), ()).stamp == 2


def test_an_arm_that_is_held_has_the_dynamics_of_one_whose_joint_does_not_move():
    arm = Arm.load(PANDA)
    whole, held = (
        build_tree(variant, nominal_inertias(variant), variant.gravity)
        for variant in (arm, arm.with_held_joints({FINGER: 0.01}))
    )
    for q, qd, qdd in np.random.default_rng(0).normal(size=(5, 3, 7)):
        expected = whole.inverse_dynamics(np.append(q, 0.01), np.append(qd, 0), np.append(qdd, 0))
        np.testing.assert_allclose(held.inverse_dynamics(q, qd, qdd), expected[:7], atol=1e-12)
