"""Nothing is written over what is read, over another output, through a link or to a device."""

from __future__ import annotations

import os

import pytest
from support import MODEL_FILE

from dvrk_gravity.__main__ import main
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import outputs
from dvrk_gravity.model import TorqueModel

CALLS = {
    "convert": "run.csv {}",
    "replay": "run.csv --model model.yaml --out new --json {}",
    "identify": "run.csv --arm model.yaml --report new --out {}",
    "evaluate": "run.csv --model model.yaml --json {}",
    "diagnose": "run.csv --model model.yaml --out {}",
    "plan": "--arm model.yaml --limits run.csv --out {}",
    "collect": "run.csv --model model.yaml --out {}",
    "calibrate": "--arm model.yaml --limits run.csv --simulated --out {}",
    "demo": "--model run.csv --out {}",
    "newton-euler": "run.csv --json {}",
}


def test_no_output_is_an_input_a_link_or_a_device(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for name in ("run.csv", "model.yaml"):
        (tmp_path / name).write_text("the content of an input")
    os.link("run.csv", "hard.csv")
    (tmp_path / "soft.csv").symlink_to("nothing")
    os.mkfifo("pipe.csv")
    for verb, words in CALLS.items():
        for output, token in (
            ("run.csv", "is read"), ("hard.csv", "is read"), ("soft.csv", "link"),
            ("pipe.csv", "pipe"),
        ):  # fmt: skip
            assert main([verb, *words.format(output).split()]) == 2, (verb, output)
            (line,) = capsys.readouterr().err.splitlines()
            assert token in line, (verb, output, line)
    assert (tmp_path / "run.csv").read_text() == "the content of an input"
    assert sorted(os.listdir(tmp_path)) == [
        "hard.csv", "model.yaml", "pipe.csv", "run.csv", "soft.csv"
    ]  # fmt: skip
    with pytest.raises(OSError, match="no file"):  # from Python neither
        TorqueModel.load(MODEL_FILE).save(tmp_path / "pipe.csv")
    assert (tmp_path / "pipe.csv").is_fifo()


def test_a_model_s_uncertainty_is_not_written_over(tmp_path):
    (tmp_path / "sure.npz").write_bytes(b"how sure")
    for text in (
        "identification:\n  uncertainty: sure.npz\n",
        "/**: {ros__parameters: {identification.uncertainty: sure.npz}}\n",
    ):
        (tmp_path / "model.yaml").write_text(text)
        with pytest.raises(ConfigError, match=r"sure\.npz, which is read"):
            outputs.check({"--json": tmp_path / "sure.npz"}, [tmp_path / "model.yaml"])


def test_a_urdf_is_not_written_over_however_the_arm_names_it_or_if_that_is_not_known(tmp_path):
    urdf, file = tmp_path / "robot.urdf", tmp_path / "arm.yaml"
    urdf.write_text("a robot")
    for arm, token in (
        ("urdf: robot.urdf", r"robot\.urdf, which is read"),
        ("? urdf\n: robot.urdf", r"robot\.urdf, which is read"),
        ('"\\x75rdf": "robot\\u002eurdf"', r"robot\.urdf, which is read"),
        ("urdf: [robot.urdf", r"arm\.yaml"),
        ("a: &x robot.urdf\nurdf: *x", r"arm\.yaml"),
        ("<<: {urdf: robot.urdf}", r"arm\.yaml"),
    ):
        file.write_text(arm)
        with pytest.raises(ConfigError, match=token):
            outputs.check({"--out": tmp_path / "m.yaml", "--report": urdf}, [file])
        with pytest.raises(ConfigError, match=token):
            outputs.check_folder("--out", tmp_path, ["robot.urdf"], [file])
        with pytest.raises(ConfigError, match=token):
            outputs.require_unread("path", urdf, file)
        outputs.require_unread("path", tmp_path / "new.yaml", file)


def test_an_earlier_result_may_be_replaced_but_no_folder_and_nothing_in_a_bag(tmp_path):
    out, bag = tmp_path / "out", tmp_path / "bag"
    outputs.check({"--json": out}, [MODEL_FILE, None])
    out.write_text("an earlier result")
    outputs.check({"--json": out}, [MODEL_FILE, None])
    bag.mkdir()
    with pytest.raises(ConfigError, match="bag"):
        outputs.check({"--json": bag}, [MODEL_FILE])
    for name in ("metadata.yaml", "bag_0.db3"):
        (bag / name).write_text("a bag")
    with pytest.raises(ConfigError, match="is read"):
        outputs.check({"--json": bag / "metadata.yaml"}, [bag / "bag_0.db3"])
    outputs.check({"--json": bag / "findings.json"}, [bag / "bag_0.db3"])
