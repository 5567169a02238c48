"""`diagnose --reference`: the same motion twice, and what changed between, without any model."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from robots import UR5
from test_own_arm import record, run

from dvrk_gravity.arms import Arm, build_tree, nominal_inertias
from dvrk_gravity.compensate import Settings
from dvrk_gravity.diagnosis import diagnose
from dvrk_gravity.errors import ConfigError, RecordingError
from dvrk_gravity.estimation import Track, same_motion
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Recording
from testing.lab_motion import Sines, draw_calibration
from testing.plain_world import NOISE, PlainWorld

pytestmark = pytest.mark.usefixtures("brief_simulation")

MASS, COM = 1.5, (0.03, 0.04, 0.06)


SLOW = pytest.mark.slow


@pytest.fixture(scope="module")
def world() -> PlainWorld:
    arm = Arm.load(UR5)
    return PlainWorld.of(arm, nominal_inertias(arm))


@pytest.fixture(scope="module")
def bare(world) -> Recording:
    return record(world, 1, 11)


@pytest.fixture(scope="module")
def again(world) -> Recording:
    return record(world, 1, 13)


def later(recording: Recording, seconds: float) -> Recording:
    """The same motion on a clock that began later."""
    cut = recording.between(seconds, np.inf)
    return replace(cut, time=cut.time - cut.time[0])


@pytest.fixture(scope="module")
def loaded(world) -> Recording:
    return later(record(world.with_payload(world.arm.body_names[-1], MASS, COM), 1, 12), 1.7)


def test_friction_that_changed_by_more_than_a_day_does_is_told(world, bare):
    """The elbow's by 40 %; that of another day, a tenth, has no say in it."""
    rubbing = later(record(world.with_friction(2, 0.4 * world.coulomb[2]), 1, 13), 1.7)

    (found,) = diagnose(rubbing, arm=UR5, reference=bare).findings

    assert (found.effect, found.joints) == ("coulomb_friction", (world.arm.joint_names[2],))
    level = found.parameters["positive"]
    assert level.value == pytest.approx(0.4 * world.coulomb[2], rel=0.1)


def test_friction_that_changed_as_a_day_changes_it_is_known(world, bare):
    rubbing = later(record(world.with_friction(2, 0.15 * world.coulomb[2]), 1, 13), 1.7)

    told = diagnose(rubbing, arm=UR5, reference=bare)

    assert told.verdict == "nothing_to_explain"
    assert [entry.joints for entry in told.known] == [(world.arm.joint_names[2],)]


def test_the_same_motion_is_found_at_its_time_in_the_other_recording():
    time = np.arange(0.0, 20.0, 0.01)
    q = np.column_stack([np.sin(time) + 0.3 * np.sin(2.3 * time), np.cos(1.7 * time)])
    (when,) = same_motion(Track([time[:1200]], [q[300:1500]]), Track([time], [q]), 100.0)
    np.testing.assert_allclose(when, time[300:1500], atol=2e-3)
    (never,) = same_motion(Track([time], [q[::-1] * [1, -1]]), Track([time], [q]), 100.0)
    assert np.isnan(never).mean() > 0.9


def test_a_load_is_weighed_without_a_model(world, bare, loaded):
    found = diagnose(loaded, arm=UR5, reference=bare, known_payload=MASS)
    (load,) = found.findings
    assert (load.effect, load.place) == ("payload", world.arm.body_names[-1])
    mass = load.parameters["mass"]
    assert mass.value == pytest.approx(MASS, rel=0.03)
    assert mass.low < MASS < mass.high
    for axis, coordinate in zip("xyz", COM, strict=True):
        assert load.parameters[axis].value == pytest.approx(coordinate, abs=0.01)
    assert "the torque scale agrees" in found.payload_check.sentence
    assert found.model.verdict == "do_not_compensate"  # it holds the change alone
    assert "that the reference does not know" in found.sentence
    assert not [words for words in (found.sentence, load.remedy) if "model" in words]
    assert "give --model with the reference" in found.caveat
    with pytest.raises(ConfigError, match="changes against a reference only"):
        Settings.from_parameters(found.model.parameters())


def test_a_load_is_weighed_at_its_place(bare, loaded, world):
    place = f"{world.arm.body_names[-1]}:{','.join(map(str, COM))}"
    found = diagnose(loaded, arm=UR5, reference=bare, payload_at=place)
    load = next(finding for finding in found.findings if finding.effect == "payload")
    mass = load.parameters["mass"]
    assert mass.value == pytest.approx(MASS, rel=0.02)
    assert mass.low < MASS < mass.high
    assert mass.high - mass.low < 0.2 * MASS
    assert load.parameters["z"].low == load.parameters["z"].high == COM[2]
    assert found.model.term("payload").mass == pytest.approx(MASS, rel=0.03)


def test_what_is_wrong_with_both_recordings_is_said_once(bare, loaded):
    def frozen(recording: Recording, first: int) -> Recording:
        position = recording.position.copy()
        position[first : first + 40, 1] = position[first, 1]
        return replace(recording, position=position)

    found = diagnose(frozen(loaded, 500), arm=UR5, reference=frozen(bare, 900))

    said = [(warning.kind, warning.joint) for warning in found.warnings]
    assert said
    assert len(said) == len(set(said))


def test_a_load_makes_the_arm_swing_further_and_is_weighed_all_the_same(world):
    """Efforts by Pinocchio's inverse dynamics: the bare arm with all of the motion's harmonics
    1.5 % smaller, the loaded one a little lower."""
    wide = draw_calibration(world.arm, 3)
    narrow = replace(wide, amplitude=0.985 * wide.amplitude)
    lower = replace(wide, middle=wide.middle + 0.003)
    heavy = world.with_payload(world.arm.body_names[-1], MASS, COM)
    loaded, bare = inverse_dynamics(heavy, lower, 1), inverse_dynamics(world, narrow, 2)
    (load,) = diagnose(loaded, arm=UR5, reference=bare).findings
    assert load.parameters["mass"].value == pytest.approx(MASS, rel=0.02)
    assert load.parameters["mass"].low < MASS < load.parameters["mass"].high


def inverse_dynamics(world: PlainWorld, motion: Sines, noise: int) -> Recording:
    """What an arm that follows a motion exactly needs, read with noise."""
    time = np.arange(0.0, 15.0, 0.01)
    q, qd, qdd = motion.at(time)
    tree = build_tree(world.arm, world.links, world.arm.gravity)
    effort = np.array([tree.inverse_dynamics(*sample) for sample in zip(q, qd, qdd, strict=True)])
    effort += world.coulomb * np.sign(qd) + world.viscous * qd
    random = np.random.default_rng(noise)
    effort += NOISE * world.arm.actuator_effort_limit * random.standard_normal(effort.shape)
    return Recording(joints=world.arm.joint_names, position=q, effort=effort, time=time)


def test_nothing_that_changed_is_nothing_to_explain(bare, again):
    assert diagnose(later(again, 0.9), arm=UR5, reference=bare).verdict == "nothing_to_explain"


@pytest.mark.usefixtures("four_folds")
def test_speeds_that_are_read_noisily_are_no_news(bare, again):
    """What accelerations then say that the links need is in no effort."""
    then, now = (
        replace(
            recording,
            velocity=recording.velocity + 0.02 * random.normal(size=recording.velocity.shape),
        )
        for recording, random in zip((bare, again), map(np.random.default_rng, (1, 2)), strict=True)
    )
    assert diagnose(now, arm=UR5, reference=then).verdict == "nothing_to_explain"


@pytest.mark.usefixtures("four_folds")
@pytest.mark.parametrize("rest", [0.3, 3.0], ids=["at rest on the way", "far from it"])
def test_a_spring_is_told_whole_wherever_it_is_at_rest(world, bare, again, rest):
    """Part of it is a constant, and part what springs pull otherwise from one day to another."""
    joint, stiffness = 1, 3.0  # N·m/rad
    pull = stiffness * (again.position[:, joint] - rest)
    pulled = again.effort + np.outer(pull, np.eye(world.arm.n)[joint])

    (found,) = diagnose(replace(again, effort=pulled), arm=UR5, reference=bare).findings

    assert (found.effect, found.joints) == ("elastic_cable", (world.arm.joint_names[joint],))
    assert found.parameters["stiffness"].value == pytest.approx(stiffness, rel=0.1)


def test_friction_that_has_doubled_is_found_at_its_joint(world, bare):
    joint = 2
    rubs = record(world.with_friction(joint, 2.0 * world.coulomb[joint]), 1, 14)
    first, *_ = diagnose(rubs, arm=UR5, reference=bare).findings
    assert (first.effect, first.joints) == ("coulomb_friction", (world.arm.joint_names[joint],))


def test_a_load_that_was_taken_off_since_is_weighed_too(bare, loaded):
    (load,) = diagnose(bare, arm=UR5, reference=loaded).findings
    assert load.effect == "payload"
    assert load.parameters["mass"].value == pytest.approx(-MASS, rel=0.03)
    for axis, coordinate in zip("xyz", COM, strict=True):
        assert load.parameters[axis].value == pytest.approx(coordinate, abs=0.01)
    assert "less than in the reference" in load.sentence


@pytest.mark.parametrize(
    "factor", [pytest.param(0.5, marks=SLOW), pytest.param(1.2, marks=SLOW), 2.0]
)
def test_efforts_that_read_by_a_factor_more_than_a_reference_are_told_by_it(bare, again, factor):
    read = replace(again, effort=factor * again.effort)
    (found,) = diagnose(read, arm=UR5, reference=bare).findings
    scale = found.parameters["factor"]
    assert (found.effect, len(found.joints)) == ("torque_scale", 6)
    assert scale.value == pytest.approx(factor, rel=0.02)
    assert scale.low < factor < scale.high


@pytest.fixture(scope="module")
def pair(world) -> list[Recording]:
    return [record(world, 1, seed) for seed in (15, 16)]


@pytest.mark.parametrize("noise", [1.0, pytest.param(2.0, marks=SLOW)])
@pytest.mark.parametrize("delay", [pytest.param(0.012, marks=SLOW), 0.04, -0.04])
def test_efforts_that_come_later_than_a_reference_s_are_told_by_how_much(world, pair, delay, noise):
    """Noise of the two is not taken for their slope, nor friction's steps, left out, for none."""
    rng, sensors = np.random.default_rng(3), NOISE * world.arm.actuator_effort_limit
    bare, again = (
        replace(r, effort=r.effort + (noise - 1.0) * sensors * rng.standard_normal(r.effort.shape))
        for r in pair
    )
    late = [np.interp(again.time - delay, again.time, effort) for effort in again.effort.T]

    (found,) = diagnose(
        replace(again, effort=np.column_stack(late)), arm=UR5, reference=bare
    ).findings

    told = found.parameters["delay"]
    assert found.effect == "time_delay"
    assert told.value == pytest.approx(delay, rel=0.1, abs=0.003)
    assert told.low < delay < told.high


@pytest.mark.parametrize("joint", [1, pytest.param(slice(None), marks=SLOW)], ids=["one", "all"])
def test_efforts_of_the_other_sign_than_the_reference_s_are_refused(bare, again, joint):
    effort = again.effort.copy()
    effort[:, joint] *= -1.0
    with pytest.raises(RecordingError, match=r"shoulder_lift_joint.* with reversed sign"):
        diagnose(replace(again, effort=effort), arm=UR5, reference=bare)


def test_a_torque_scale_that_disagrees_with_a_known_mass_is_told(bare, loaded):
    half = [replace(recording, effort=0.5 * recording.effort) for recording in (loaded, bare)]
    found = diagnose(half[0], arm=UR5, reference=half[1], known_payload=MASS)
    assert found.payload_check.scale.value == pytest.approx(0.5, rel=0.05)
    assert "too low" in found.payload_check.sentence
    assert found.to_dict()["known_payload"]["mass"] == MASS


def test_a_model_beside_a_reference_takes_the_change_in(bare, loaded):
    whole = TorqueModel(Arm.load(UR5), ())
    found = diagnose(loaded, whole, reference=bare)
    assert found.model.term("payload").mass == pytest.approx(MASS, rel=0.03)


def test_another_motion_is_refused(world, bare):
    with pytest.raises(RecordingError, match=r"expected the same motion, 8 s of it at least$"):
        diagnose(record(world, 2, 12), arm=UR5, reference=bare)


def halting(recording: Recording, every: float, pause: float, pace: float = 1.0) -> Recording:
    """The same path with pauses, both in s, at another pace, as of a busy machine."""
    time = recording.time
    runs = np.where(time % every < pause, 0.0, pace)
    phase = np.concatenate([[0.0], np.cumsum(np.diff(time) * runs[1:])])
    kept = phase < time[-1]
    position = np.column_stack([np.interp(phase, time, q) for q in recording.position.T])
    effort = np.column_stack([np.interp(phase, time, e) for e in recording.effort.T])
    velocity = np.gradient(position, time, axis=0)
    changed = replace(recording, position=position, velocity=velocity, effort=effort)
    return changed.rows(np.flatnonzero(kept))


@pytest.mark.parametrize("timing", [(1.5, 0.1, 1.0), (100.0, 0.0, 1.4), (100.0, 0.0, 0.6)])
def test_the_same_path_with_pauses_or_at_another_pace_is_refused_with_what_to_do(bare, timing):
    said = (
        r"follows the path of .* for \d+\.\d s, but with pauses or at another pace: .* record both"
    )
    with pytest.raises(RecordingError, match=said) as caught:
        diagnose(halting(bare, *timing), arm=UR5, reference=bare)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("further", [12.0, 2.5])
def test_a_motion_that_is_the_same_but_for_a_joint_s_place_is_refused_with_that_joint(
    bare, further
):
    elsewhere = replace(bare, position=bare.position + np.radians([0, 0, 0, further, 0, 0]))
    said = rf"it does so where wrist_1_joint is {further:g}[.0]* deg further$"
    with pytest.raises(RecordingError, match=said):
        diagnose(elsewhere, arm=UR5, reference=bare)


def test_what_is_diagnosed_is_no_reference_of_itself(bare):
    with pytest.raises(RecordingError, match="--reference is the recording being diagnosed"):
        diagnose(bare, arm=UR5, reference=bare)


def test_poses_are_refused(bare):
    poses = replace(bare, time=None, velocity=None)
    with pytest.raises(RecordingError, match="static poses"):
        diagnose(poses, arm=UR5, reference=poses)


@pytest.fixture(scope="module")
def files(bare, loaded, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("files")
    bare.save(folder / "bare.csv")
    loaded.save(folder / "loaded.csv")
    TorqueModel(Arm.load(UR5), ()).save(folder / "ur5.yaml")
    return folder


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "--model: got nothing, expected a model; or --arm with --reference"),
        (["--arm", UR5], "--model: got nothing, expected a model; or --arm with --reference"),
        (["--reference", "bare.csv"], "--arm: got nothing, expected the arm, or a --model"),
        (["--reference", "bare.csv", "--arm", "mtmr", "--model", "ur5.yaml"],
         "--arm: got 'mtmr', expected that of the model"),
        (["--reference", "bare.csv", "--arm", "mtmr"], "expected time, direction or"),
        (["--reference", "none.csv", "--arm", UR5], "no such file"),
        (["--reference", "bare.csv", "--arm", UR5, "--at", "others=0, elbow_joint=2deg"],
         "expected a joint that is not recorded: elbow_joint is"),
    ],
)  # fmt: skip
def test_contradictions_are_refused_in_a_line(files, tmp_path, capsys, words, said):
    there = [files / word if str(word).endswith((".csv", "5.yaml")) else word for word in words]
    status, _, error = run(capsys, "diagnose", files / "loaded.csv", "--out", tmp_path, *there)
    assert status == 2
    assert said in error
    assert error.count("\n") == 1


def test_the_command_writes_what_a_diagnosis_by_a_model_does(files, tmp_path, capsys):
    status, text, _ = run(
        capsys, "diagnose", files / "loaded.csv", "--arm", UR5, "--reference", files / "bare.csv",
        "--known-payload", MASS, "--out", tmp_path,
    )  # fmt: skip
    assert status == 0
    assert "known payload: " in text
    content = json.loads((tmp_path / "findings.json").read_text())
    assert content["format"] == 2
    assert content["findings"][0]["effect"] == "payload"
    assert (tmp_path / "report.html").read_text().count("Known payload") == 1
    assert TorqueModel.load(tmp_path / "extended_model.yaml").verdict == "do_not_compensate"
