"""Whatever is wrong with a YAML file, one line names it; writing is whole or not at all."""

from __future__ import annotations

import os

import numpy as np
import pytest
import yaml

from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import text_file, yaml_file

BOMB = "a: &a [x,x,x,x,x,x,x,x,x]\nb: &b [*a,*a,*a,*a,*a,*a]\nc: [*b,*b,*b,*b,*b]\n"
# The content, and a token of the refusal.
WRONG = {
    "empty": (b"# nothing\n", "'NoneType', expected a YAML mapping"),
    "a list": (b"- 1\n- 2\n", "'list', expected a YAML mapping"),
    "tab": (b"a:\n\tb: 1\n", "line 2"),
    "nested": (b"[" * 3000, "50 levels"),
    "unclosed": (b"a: [1, 2\nb: 3\n", "line 2"),
    "two documents": (b"a: 1\n---\nb: 2\n", "valid YAML"),
    "anchor bomb": (BOMB.encode(), "anchors"),
    "alias": (b"a: &x 1\nb: *x\n", "anchors"),
    "merge": (b"a: 1\n<<: {b: 2}\n", "valid YAML"),
    "key twice": (b"a: 1\nb: 2\na: 3\n", "'a' appears twice"),
    "python object": (b"a: !!python/object/apply:os.system [ls]\n", "valid YAML"),
    "absurd date": (b"a: 2026-99-99\n", "valid YAML"),
    "too many digits": (b"a: 1" + b"0" * 5000 + b"\n", "valid YAML"),
    "binary": (bytes(range(256)), "binary"),
    "control characters": (b"a: \x01\x02\n", "valid YAML"),
}


def test_a_file_that_cannot_be_used_is_refused_in_one_line_with_its_name(tmp_path):
    file = tmp_path / "model.yaml"
    for case, (content, token) in WRONG.items():
        file.write_bytes(content)
        with pytest.raises(ConfigError) as caught:
            yaml_file.load(file)
        text = str(caught.value)
        assert text.startswith(f"{file}: "), case
        assert token in text, (case, text)
        assert "\n" not in text, case
        assert len(text) < len(str(file)) + 200, case


def test_what_is_not_a_file_of_a_sensible_size_is_refused(tmp_path):
    huge = tmp_path / "huge.yaml"
    with huge.open("wb") as stream:
        stream.truncate(100_000_000)
    for path, token in (
        (tmp_path / "none.yaml", "no such file"),
        (tmp_path, "a folder"),
        (tmp_path / "a\0b.yaml", "null"),
        (huge, "1000000 bytes"),
        ("/dev/zero", "device"),
    ):
        with pytest.raises(ConfigError, match=token):
            yaml_file.load(path)


def test_numbers_are_read_as_ros_reads_them(tmp_path):
    """PyYAML alone takes 1e-05 for a text, and 1:30 for 90; ROS's parser does not."""
    file = tmp_path / "number.yaml"
    for text in ("1e-05", "1E5", "-2e+3", "+1e3", "1.5e-3", ".5", "-0.0", "-1e300"):
        file.write_text(f"a: {text}\n")
        value = yaml_file.load(file)["a"]
        assert isinstance(value, float), text
        assert value == float(text)
    for text in ("e5", "1e", "0x1e5", "1e5e5", "v1e5", "--1", "7"):
        file.write_text(f"a: {text}\n")
        assert not isinstance(yaml_file.load(file)["a"], float), text
    for text in ("1:30", "-1:30", "1:30.5", "190:20:30"):
        file.write_text(f"a: {text}\nb: [{text}]\n")
        assert yaml_file.load(file) == {"a": text, "b": [text]}


def test_floats_survive_bit_by_bit_and_stay_floats_for_every_reader(tmp_path):
    values = [1e-05, 1e16, 1e22, 2.3e-308, -0.0, 1.0, 123456789.0, 0.1, 1.7976931348623157e308]
    values += np.random.default_rng(0).normal(size=50).tolist()
    text = yaml_file.dump({"a": values, "b": {"c": values[0]}})
    (tmp_path / "floats.yaml").write_text(text)
    for content in (yaml.safe_load(text), yaml_file.load(tmp_path / "floats.yaml")):
        for found in (*content["a"], content["b"]["c"]):
            assert type(found) is float
        read = np.array(content["a"]).view(np.int64)
        np.testing.assert_array_equal(read, np.array(values).view(np.int64))


def test_writing_replaces_the_file_and_leaves_nothing_else(tmp_path):
    file = tmp_path / "model.yaml"
    file.write_text("old")
    text_file.write(file, "new é\n")
    assert file.read_text(encoding="utf-8") == "new é\n"
    assert os.listdir(tmp_path) == ["model.yaml"]


def test_a_write_that_fails_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch):
    file = tmp_path / "model.yaml"
    file.write_text("old")

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)  # what a full disk does
    with pytest.raises(OSError, match=r"No space left on device: '[^']*'$"):
        text_file.write(file, "new")
    assert file.read_text() == "old"
    assert os.listdir(tmp_path) == ["model.yaml"]
    with pytest.raises(OSError, match="No such file"):
        text_file.write(tmp_path / "none" / "model.yaml", "new")
