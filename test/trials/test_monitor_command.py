"""The verb `monitor` over recordings: what it prints and writes, and what it refuses."""

from __future__ import annotations

import json

import numpy as np
import pytest

from dvrk_gravity import Recording
from dvrk_gravity.__main__ import main
from dvrk_gravity.arms import Arm
from dvrk_gravity.planning import Multisine
from dvrk_gravity.simulate import PlantFile

ARM = Arm.load("ecm")


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Return a model's file and that of a recording as the model has it, 20 s."""
    folder = tmp_path_factory.mktemp("monitored")
    model = PlantFile.of(ARM).model
    model.save(folder / "model.yaml")
    time = np.arange(0.0, 20.0, 0.01)
    q, qd = Multisine.draw(ARM, 3).at(time)
    effort = model.torque(q, qd, np.gradient(qd, time, axis=0))
    effort += 1e-3 * ARM.effort_limit * np.random.default_rng(2).normal(size=q.shape)
    Recording(ARM.joint_names, time, q, qd, effort).save(folder / "motion.csv")
    return folder / "model.yaml", folder / "motion.csv"


def test_a_recording_as_the_model_expects_it_has_no_event(files, tmp_path, capsys):
    model, recording = map(str, files)
    assert main(["monitor", recording, "--model", model, "--json", f"{tmp_path / 'e.json'}"]) == 0
    printed = capsys.readouterr().out
    assert all(joint in printed for joint in ARM.joint_names)
    written = json.loads((tmp_path / "e.json").read_text())
    assert written["arm"] == "ecm"
    assert written["events"] == []
    assert written["seconds"] == pytest.approx(20.0, abs=1.0)
    assert written["external"].keys() == {*ARM.joint_names}
    for joint, size in zip(ARM.joints, written["external"].values(), strict=True):
        assert 0.0 < size["rms"] < 0.02 * joint.effort_limit


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["{recording}"], "--model"),
        (["{recording}", "--model", "nothing.yaml"], "nothing.yaml"),
        (["nothing.csv", "--model", "{model}"], "nothing.csv"),
        (["--model", "{model}"], "--params-file"),
        (["--ros-args", "--params-file", "nothing.yaml"], "nothing.yaml"),
        (["--ros-args", "-p", "publish_rate:=500.0", "--params-file", "{model}"], "publish_rate"),
        (["--ros-args", "-p", "tip:=nowhere", "--params-file", "{model}"], "nowhere"),
        (["--ros-args", "-p", "arm:=ecm"], "--params-file"),
    ],
)
def test_what_cannot_be_monitored_is_refused_in_one_line(files, capsys, words, named):
    model, recording = map(str, files)
    given = [word.format(model=model, recording=recording) for word in words]
    assert main(["monitor", *given]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert named in said
