"""`diagnose --reference`: the same motion twice, and what changed between, without any model."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from compared import DURATION, again, bare, changed, motion
from diagnosed import ARM, COULOMB, PITCH, ROLL, YAW, eye, holds, loaded, moving, only
from support import REPOSITORY

from dvrk_gravity.__main__ import main
from dvrk_gravity.compensate import Settings
from dvrk_gravity.diagnosis import diagnose
from dvrk_gravity.errors import ConfigError, RecordingError
from dvrk_gravity.estimation import Track, same_motion
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Recording

CHAIN = REPOSITORY / "testing" / "chain.yaml"
MASS, COM = 0.5, (0.03, -0.02, 0.05)
LAST = ARM.body_names[-1]


@cache
def carrying() -> Recording:
    return again(motion().torque(loaded(MASS, COM)) - motion().torque())


def rubs(part: float) -> np.ndarray:
    """Return a part more of pitch's dry friction."""
    return part * COULOMB[PITCH] * np.sign(motion().qd[:, [PITCH]]) * eye(PITCH)


def test_nothing_that_changed_is_nothing_to_explain():
    assert changed(again()).verdict == "nothing_to_explain"


def test_friction_that_changed_by_more_than_a_day_does_is_told():
    found = only(changed(again(rubs(0.6))))

    assert (found.effect, found.joints) == ("coulomb_friction", ("pitch",))
    assert holds(found, "positive", 0.6 * COULOMB[PITCH])


def test_friction_that_changed_as_a_day_changes_it_is_known():
    diagnosis = changed(again(rubs(0.15)))

    assert diagnosis.verdict == "nothing_to_explain"
    assert [entry.joints for entry in diagnosis.known] == [("pitch",)]


def test_a_load_is_weighed_without_a_model_and_compared_with_what_it_is():
    diagnosis = changed(carrying(), known_payload=MASS)

    load = only(diagnosis)
    assert (load.effect, load.place) == ("payload", LAST)
    mass = load.parameters["mass"]
    assert mass.value == pytest.approx(MASS, rel=0.03)
    assert mass.low < MASS < mass.high
    for axis, coordinate in zip("xyz", COM, strict=True):
        assert load.parameters[axis].value == pytest.approx(coordinate, abs=0.01)
    assert diagnosis.payload_check.scale.value == pytest.approx(1.0, rel=0.03)
    # It holds the change alone.
    assert diagnosis.model.verdict == "do_not_compensate"
    with pytest.raises(ConfigError, match="changes against a reference only"):
        Settings.from_parameters(diagnosis.model.parameters())


def test_a_load_is_weighed_at_its_place():
    diagnosis = changed(carrying(), payload_at=f"{LAST}:{','.join(map(str, COM))}")

    load = next(finding for finding in diagnosis.findings if finding.effect == "payload")
    mass = load.parameters["mass"]
    assert mass.value == pytest.approx(MASS, rel=0.02)
    assert mass.low < MASS < mass.high
    assert mass.high - mass.low < 0.2 * MASS
    assert load.parameters["z"].low == load.parameters["z"].high == COM[2]
    assert diagnosis.model.term("payload").mass == pytest.approx(MASS, rel=0.03)


def test_a_torque_scale_that_disagrees_with_a_known_mass_is_told():
    half = [replace(each, effort=0.5 * each.effort) for each in (carrying(), bare())]

    diagnosis = diagnose(half[0], arm=ARM, reference=half[1], known_payload=MASS)

    assert diagnosis.payload_check.scale.value == pytest.approx(0.5, rel=0.05)
    assert diagnosis.to_dict()["known_payload"]["mass"] == MASS


def test_a_spring_is_told_whole_though_it_is_at_rest_far_from_the_way():
    """Part of it is a constant, and part what springs pull otherwise from one day to another."""
    pull = 1.0 * (motion().q[:, [YAW]] - 3.0) * eye(YAW)

    found = only(changed(again(pull)))

    assert (found.effect, found.joints) == ("elastic_cable", ("yaw",))
    assert found.parameters["stiffness"].value == pytest.approx(1.0, rel=0.1)


def test_the_same_motion_is_found_at_its_time_in_the_other_recording():
    time = 1000.0 + np.arange(0.0, 20.0, 0.01)
    q = np.column_stack([np.sin(time) + 0.3 * np.sin(2.3 * time), np.cos(1.7 * time)])
    (when,) = same_motion(Track([time[:1200]], [q[300:1500]]), Track([time], [q]), 100.0)
    np.testing.assert_allclose(when, time[300:1500], atol=2e-3)
    (never,) = same_motion(Track([time], [q[::-1] * [1, -1]]), Track([time], [q]), 100.0)
    assert np.isnan(never).mean() > 0.9


def halting(every: float, pause: float, pace: float = 1.0) -> Recording:
    """The same path with pauses, both in s, at another pace, as of a busy machine."""
    recording = bare()
    time = recording.time
    runs = np.where(time % every < pause, 0.0, pace)
    phase = np.concatenate([[0.0], np.cumsum(np.diff(time) * runs[1:])])
    position, effort = (
        np.column_stack([np.interp(phase, time, column) for column in values.T])
        for values in (recording.position, recording.effort)
    )
    other = replace(
        recording, position=position, velocity=np.gradient(position, time, axis=0), effort=effort
    )
    return other.rows(np.flatnonzero(phase < time[-1]))


def test_what_cannot_be_compared_with_a_reference_is_refused_in_a_line():
    other, right = moving(2, DURATION), bare()
    for bad, words in (
        (other.read(other.torque()), "the same motion, 8 s"),
        (halting(1.5, 0.1), "with pauses or at another pace"),
        (halting(100.0, 0.0, 0.6), "with pauses or at another pace"),
        (
            replace(right, position=right.position + np.radians(12.0) * eye(ROLL)),
            r"roll is 12[.0]* deg further",
        ),
        (right, "--reference is the recording being diagnosed"),
        (replace(right, time=None, velocity=None), "static poses"),
        (
            replace(again(), effort=again().effort * (1.0 - 2.0 * eye(PITCH))),
            "pitch.* with reversed sign",
        ),
    ):
        with pytest.raises(RecordingError, match=words) as caught:
            changed(bad)
        assert "\n" not in str(caught.value)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("files")
    bare().save(folder / "bare.csv")
    carrying().save(folder / "loaded.csv")
    TorqueModel(ARM, ()).save(folder / "model.yaml")
    return folder


def run(capsys, *words: object) -> tuple[int, str, str]:
    status = main([str(word) for word in words])
    return status, *capsys.readouterr()


def test_contradictions_are_refused_in_a_line(files, tmp_path, capsys):
    bare_file, model_file = files / "bare.csv", files / "model.yaml"
    for words, said in (
        (["--arm", CHAIN], "--model: got nothing"),
        (["--reference", bare_file], "--arm: got nothing"),
        (["--reference", bare_file, "--arm", "mtmr", "--model", model_file], "--arm: got 'mtmr'"),
        (["--reference", files / "none.csv", "--arm", CHAIN], "no such file"),
        (["--reference", bare_file, "--arm", CHAIN, "--at", "others=0, pitch=2deg"], "pitch is"),
    ):
        status, _, error = run(capsys, "diagnose", files / "loaded.csv", "--out", tmp_path, *words)
        assert status == 2, said
        assert said in error
        assert error.count("\n") == 1


def test_the_command_writes_what_a_diagnosis_by_a_model_does(files, tmp_path, capsys):
    status, _, _ = run(
        capsys, "diagnose", files / "loaded.csv", "--arm", CHAIN, "--reference",
        files / "bare.csv", "--known-payload", MASS, "--out", tmp_path,
    )  # fmt: skip
    assert status == 0
    content = json.loads((tmp_path / "findings.json").read_text())
    assert content["format"] == 2
    assert content["findings"][0]["effect"] == "payload"
    assert content["known_payload"]["mass"] == MASS
    assert (tmp_path / "report.html").exists()
    assert TorqueModel.load(tmp_path / "extended_model.yaml").verdict == "do_not_compensate"


def test_efforts_that_read_by_a_factor_more_than_a_reference_are_told_by_it():
    found = only(changed(replace(again(), effort=1.5 * again().effort)))

    scale = found.parameters["factor"]
    assert (found.effect, found.joints) == ("torque_scale", ARM.joint_names)
    assert scale.value == pytest.approx(1.5, rel=0.02)
    assert scale.low < 1.5 < scale.high


def test_efforts_that_come_earlier_than_a_reference_s_are_told_by_how_much():
    recording, delay = again(), -0.04
    late = [np.interp(recording.time - delay, recording.time, e) for e in recording.effort.T]

    found = only(changed(replace(recording, effort=np.column_stack(late))))

    assert found.effect == "time_delay"
    assert holds(found, "delay", delay)
