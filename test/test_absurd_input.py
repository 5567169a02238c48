"""Input that is absurd, not damaged: one line and status 2, at once and in little memory."""

from __future__ import annotations

import os
import resource
import signal
import sqlite3
import subprocess
import sys
from functools import partial

import numpy as np
import pytest
import yaml
from support import MODEL_FILE, REPOSITORY

from dvrk_gravity.__main__ import main
from dvrk_gravity.arms import JOINT_NAMES
from dvrk_gravity.errors import ConfigError, RecordingError
from dvrk_gravity.files import yaml_file
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.parameters import unflatten
from dvrk_gravity.recording import BagReader, Recording
from dvrk_gravity.simulate import PlantFile

HUGE = [1e308, 1e200, 1e29, 1e13]


@pytest.fixture
def recording(tmp_path):
    """Return the path of a recording of 12 s."""
    time = np.arange(0.0, 12.0, 0.02)
    angle = time[:, None] * (0.5 + 0.37 * np.arange(7))
    q, qd = 0.3 * np.sin(angle) + 0.2, 0.3 * (0.5 + 0.37 * np.arange(7)) * np.cos(angle)
    effort = TorqueModel.load(MODEL_FILE).torque(q, qd) + 1e-3 * np.sin(angle)
    path = tmp_path / "r.csv"
    Recording(JOINT_NAMES, time, q, qd, effort).save(path)
    return path


def with_coefficient(path, name: str, value: float):
    """Write the shipped model with one coefficient more, or another one."""
    model = TorqueModel.load(MODEL_FILE)
    values = model.parameters()
    values[name] = (value, *values.get(name, (0.0,))[1:])
    path.write_text(yaml_file.dump({"/**": {"ros__parameters": unflatten(values)}}))
    return path


@pytest.mark.parametrize("value", HUGE)
@pytest.mark.parametrize(
    "name", ["beta", "elastic_cable.elbow_pitch", "directional_cable.positive.elbow_pitch"]
)
@pytest.mark.parametrize("verb", ["evaluate", "diagnose"])
def test_a_model_of_absurd_torques_is_refused(verb, name, value, tmp_path, recording, capsys):
    model = with_coefficient(tmp_path / "m.yaml", name, value)
    words = [verb, str(recording), "--model", str(model)]
    words += ["--out", str(tmp_path / "out")] if verb == "diagnose" else []
    assert main(words) == 2
    captured = capsys.readouterr()
    (line,) = captured.err.strip().splitlines()
    assert str(model) in line
    assert "nan" not in captured.out


def test_a_model_of_absurd_torques_is_refused_on_static_poses(tmp_path, capsys):
    random = np.random.default_rng(0)
    q = random.uniform(-0.3, 0.3, (60, 7))
    poses = Recording(JOINT_NAMES, None, q, None, TorqueModel.load(MODEL_FILE).torque(q))
    poses.save(tmp_path / "poses.csv")
    model = with_coefficient(tmp_path / "m.yaml", "elastic_cable.elbow_pitch", 1e29)
    for verb, more in (("evaluate", []), ("diagnose", ["--out", str(tmp_path / "out")])):
        words = [verb, str(tmp_path / "poses.csv"), "--model", str(model), *more]
        assert main(words) == 2
        assert str(model) in capsys.readouterr().err


@pytest.mark.parametrize("field", ["mass", "com", "inertia"])
@pytest.mark.parametrize("value", [1e308, -1e308, 1e150])
def test_a_plant_that_weighs_more_than_a_building_is_refused(field, value, tmp_path):
    content = yaml.safe_load((REPOSITORY / "config" / "plants" / "mtmr_28002.yaml").read_text())
    row = content["links"]["link2"]
    row[field] = (
        value
        if field == "mass"
        else [abs(value) if field == "inertia" else value] * 3
        + ([0.0] * 3 if field == "inertia" else [])
    )
    path = tmp_path / "plant.yaml"
    path.write_text(yaml_file.dump(content))
    with pytest.raises(ConfigError, match=rf"links.link2.{field}.*expected"):
        PlantFile.load(path).plant()


BAG_DAMAGE = {
    "an integer message": "UPDATE messages SET data = 5 WHERE id = 3",
    "a text message": "UPDATE messages SET data = 'text' WHERE id = 3",
    "no message": "UPDATE messages SET data = 2.5 WHERE id = 3",
    "a text time": "UPDATE messages SET timestamp = 'noon' WHERE id = 3",
    "a fractional time": "UPDATE messages SET timestamp = 1.5 WHERE id = 3",
    "an absurd topic": "UPDATE messages SET topic_id = 'x'",
    "an integer type": "UPDATE topics SET type = 7",
    "an integer name": "UPDATE topics SET name = x'00ff'",
    "an integer format": "UPDATE topics SET serialization_format = 3",
}


@pytest.mark.parametrize("bare", [False, True])
@pytest.mark.parametrize("damage", BAG_DAMAGE)
def test_a_value_of_another_type_in_a_bag_is_refused_or_not_read(damage, bare, tmp_path, recording):
    bag = tmp_path / "bag"
    Recording.load(recording).between(0.0, 1.0).save(bag)
    (file,) = bag.glob("*.db3")
    with sqlite3.connect(file) as connection:
        connection.execute(BAG_DAMAGE[damage])
    path = file if bare else bag
    if "message" in damage:
        with pytest.raises(RecordingError, match="expected bytes"):
            Recording.load(path)
        return
    try:
        Recording.load(path)
        with BagReader(path) as reader:
            list(reader.raw(reader.joint_state_topic()))
    except RecordingError:  # in one line, as all of them are
        pass


@pytest.mark.parametrize("text", ["1:30", "-1:30", "1:30.5", "190:20:30"])
def test_colons_make_no_number_of_sixties(text, tmp_path):
    """YAML 1.1 reads 1:30 as 90, ROS's reader as a text."""
    file = tmp_path / "file.yaml"
    file.write_text(f"a: {text}\nb: [{text}]\n")
    assert yaml_file.load(file) == {"a": text, "b": [text]}
    model = tmp_path / "model.yaml"
    model.write_text(f"/**:\n  ros__parameters:\n    timeout: {text}\n")
    with pytest.raises(ConfigError, match=r"timeout: got '.*', expected a number"):
        TorqueModel.load(model)


@pytest.mark.parametrize("value", [1, -2, 1.5, 1e-3, 0.0, -1e300, 123456789])
def test_other_numbers_are_read_as_ever(value, tmp_path):
    file = tmp_path / "file.yaml"
    file.write_text(f"a: {value!r}\n")
    assert yaml_file.load(file) == {"a": value}


def piped(folder, good):
    """Yield words of commands that read something that is neither file nor folder."""
    for name in ("pipe.csv", "pipe.yaml", "pipe.json", "pipe.db3", "pipe.mcap",
                 "a/metadata.yaml", "b/good.db3"):  # fmt: skip
        (folder / name).parent.mkdir(exist_ok=True)
        os.mkfifo(folder / name)
    (folder / "b" / "metadata.yaml").write_text((good / "metadata.yaml").read_text())
    model, out = ["--model", str(MODEL_FILE)], ["--out", str(folder / "out")]
    fit = ["--arm", "mtmr", "--out", str(folder / "m.yaml")]
    for verb, name, *words in (
        ("evaluate", "pipe.csv", *model),
        ("evaluate", "a", "--model", str(folder / "pipe.yaml")),
        ("diagnose", "pipe.db3", *model, *out),
        ("diagnose", "pipe.mcap", *model, *out),
        ("identify", "a", *fit),
        ("identify", "b", *fit),
        ("convert", "pipe.json", str(folder / "m.yaml")),
        ("convert", "pipe.csv", str(folder / "new_bag")),
        ("newton-euler", "pipe.yaml"),
        ("replay", "pipe.db3", *model),
    ):
        yield [verb, str(folder / name), *words]
    yield ["convert", "--check", str(folder / "pipe.json")]


def test_a_pipe_is_refused_at_once(tmp_path, recording, capsys):
    good = tmp_path / "good"
    Recording.load(recording).between(0.0, 0.5).save(good)
    folder = tmp_path / "pipes"
    folder.mkdir()

    def too_late(*_):
        raise AssertionError("still waiting for whoever writes to the pipe")

    before = signal.signal(signal.SIGALRM, too_late)
    try:
        for words in piped(folder, good):
            signal.alarm(20)
            assert main(words) == 2, words
            (line,) = capsys.readouterr().err.strip().splitlines()
            assert "a pipe or device" in line
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def limited(bytes_more: int) -> None:
    """Let a child have little memory beyond what it starts with."""
    resource.setrlimit(resource.RLIMIT_AS, (bytes_more, bytes_more))


LOAD = """
import sys
from dvrk_gravity.errors import DvrkGravityError
from dvrk_gravity.files import json_file, yaml_file
from dvrk_gravity.recording import Recording
read = {"csv": Recording.load, "yaml": yaml_file.load, "json": json_file.load}
try:
    read[sys.argv[1].rpartition(".")[2]](sys.argv[1])
except DvrkGravityError as error:
    print(error)
"""


@pytest.mark.parametrize(
    ("name", "head", "told"),
    [
        ("r.csv", "time,outer_yaw.position\n0,", "line 2: is longer than"),
        ("r.csv", "time,outer_yaw.position\n0,1\n1,2\n\n", "line 5: is longer than"),
        ("r.csv", "", "line 1"),
        ("m.yaml", "a: ", "a larger file"),
        ("m.json", '{"a": ', "a larger file"),
    ],
)
def test_a_line_of_a_gigabyte_takes_little_memory(name, head, told, tmp_path):
    path = tmp_path / name
    with path.open("w") as file:
        file.write(head)
        file.truncate(10**9)  # zeros that take no room on the disk
    result = subprocess.run(
        [sys.executable, "-c", LOAD, str(path)], capture_output=True, text=True, timeout=60,
        cwd=REPOSITORY, check=False, preexec_fn=partial(limited, 2 * 10**9),
        env=os.environ | {"PYTHONPATH": str(REPOSITORY)},
    )  # fmt: skip
    assert result.returncode == 0, result.stderr[-500:]
    assert told in result.stdout
    assert len(result.stdout) < 1000
