"""Whatever is wrong with a YAML file, one line tells it; writing is whole or not at all."""

from __future__ import annotations

import contextlib
import os
import time

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from support import examples

from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import text_file, yaml_file

BOMB = "a: &a [x,x,x,x,x,x,x,x,x]\nb: &b [*a,*a,*a,*a,*a,*a]\nc: [*b,*b,*b,*b,*b]\n"
WRONG = {
    "empty": (b"", "got 'NoneType', expected a YAML mapping"),
    "comment only": (b"# nothing\n", "got 'NoneType', expected a YAML mapping"),
    "a list": (b"- 1\n- 2\n", "got 'list', expected a YAML mapping"),
    "a text": (b"hello", "got 'str', expected a YAML mapping"),
    "tab": (b"a:\n\tb: 1\n", "line 2"),
    "nested": (b"[" * 3000, "nested deeper than 50 levels"),
    "unclosed": (b"a: [1, 2\nb: 3\n", "line 2"),
    "two documents": (b"a: 1\n---\nb: 2\n", "expected valid YAML"),
    "anchor bomb": (BOMB.encode(), "anchors and aliases are not used"),
    "alias": (b"a: &x 1\nb: *x\n", "anchors and aliases are not used"),
    "merge": (b"a: 1\n<<: {b: 2}\n", "expected valid YAML"),
    "key twice": (b"a: 1\nb: 2\na: 3\n", "key 'a' appears twice"),
    "inner key twice": (b"x:\n  a: 1\n  a: 1\n", "key 'a' appears twice"),
    "key is a list": (b"[1, 2]: 3\n", "expected valid YAML"),
    "python object": (b"a: !!python/object/apply:os.system [ls]\n", "expected valid YAML"),
    "unknown tag": (b"a: !colour red\n", "expected valid YAML"),
    "empty integer": (b"a: !!int ''\n", "expected valid YAML"),
    "no truth value": (b"a: !!bool perhaps\n", "expected valid YAML"),
    "no date": (b"a: !!timestamp tomorrow\n", "expected valid YAML"),
    "absurd date": (b"a: 2026-99-99\n", "expected valid YAML"),
    "too many digits": (b"a: 1" + b"0" * 5000 + b"\n", "expected valid YAML"),
    "nested too deep": (b"a: " + b"[" * 5000 + b"]" * 5000, "expected valid YAML"),
    "binary": (bytes(range(256)), "binary data"),
    "utf-16": ("a: 1\n".encode("utf-16"), "binary data"),
    "control characters": (b"a: \x01\x02\n", "expected valid YAML"),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_file_that_cannot_be_used_is_told_in_one_line_with_its_name(case, tmp_path):
    content, told = WRONG[case]
    file = tmp_path / "model.yaml"
    file.write_bytes(content)
    with pytest.raises(ConfigError) as caught:
        yaml_file.load(file)
    text = str(caught.value)
    assert text.startswith(f"{file}: ")
    assert told in text
    assert "\n" not in text
    assert len(text) < len(str(file)) + 200


def test_what_is_not_a_file_is_told_in_one_line(tmp_path):
    cases = {tmp_path / "none.yaml": "no such file", tmp_path: "a folder"}
    cases[tmp_path / "a\0b.yaml"] = "null"
    for path, told in cases.items():
        with pytest.raises(ConfigError, match=told):
            yaml_file.load(path)


@pytest.mark.skipif(os.geteuid() == 0, reason="root reads everything")
def test_a_file_that_may_not_be_read_is_told_in_one_line(tmp_path):
    file = tmp_path / "secret.yaml"
    file.write_text("a: 1\n")
    file.chmod(0)
    with pytest.raises(ConfigError, match="Permission denied"):
        yaml_file.load(file)


def test_a_hundred_megabytes_are_refused_at_once(tmp_path):
    file = tmp_path / "huge.yaml"
    with file.open("wb") as stream:
        stream.truncate(100_000_000)
    begin = time.process_time()
    with pytest.raises(ConfigError, match="at most 1000000 bytes"):
        yaml_file.load(file)
    assert time.process_time() - begin < 0.5


def test_a_device_that_never_ends_is_refused_at_once():
    with pytest.raises(ConfigError, match="got 'a pipe or device', expected a YAML file"):
        yaml_file.load("/dev/zero")


def test_many_keys_take_no_more_than_their_share_of_time(tmp_path):
    """Ten times the keys may take ten times as long, not a hundred times."""

    def seconds(count: int) -> float:
        file = tmp_path / f"{count}.yaml"
        file.write_text("".join(f"k{i}: 1\n" for i in range(count)))
        begin = time.process_time()
        assert len(yaml_file.load(file)) == count
        return time.process_time() - begin

    # The least of a few: a collection of garbage takes longer than a thousand keys.
    few, many = (min(seconds(count) for _ in range(3)) for count in (1_000, 10_000))
    assert many < 20 * few


@pytest.mark.parametrize("text", ["1e-05", "1E5", "-2e+3", "+1e3", "1.5e-3", ".5", "-0.0"])
def test_numbers_are_read_as_ros_reads_them(text, tmp_path):
    """PyYAML alone takes 1e-05 for a text; ROS's parser takes it for a number."""
    file = tmp_path / "number.yaml"
    file.write_text(f"a: {text}\n")
    value = yaml_file.load(file)["a"]
    assert isinstance(value, float)
    assert value == float(text)


@pytest.mark.parametrize("text", ["e5", "1e", "0x1e5", "1e5e5", "v1e5", "--1"])
def test_what_only_looks_like_a_number_is_none(text, tmp_path):
    file = tmp_path / "text.yaml"
    file.write_text(f"a: {text}\n")
    assert not isinstance(yaml_file.load(file)["a"], float)


@given(
    st.lists(st.floats(allow_nan=False, allow_infinity=False, allow_subnormal=False), min_size=1)
)
@example([1e-05, 1e16, 1e22, 2.3e-308, -0.0, 1.0, 123456789.0, 0.1])
def test_floats_survive_bit_by_bit_and_stay_floats_for_every_reader(values):
    text = yaml_file.dump({"a": values, "b": {"c": values[0]}})
    for loader in (yaml.SafeLoader, yaml_file._Loader):
        content = yaml.load(text, loader)
        for found in (*content["a"], content["b"]["c"]):
            assert type(found) is float
        np.testing.assert_array_equal(
            np.array(content["a"]).view(np.int64), np.array(values).view(np.int64)
        )


# Text made of what YAML gives a meaning to gets further into a parser than letters do.
YAML_BITS = st.sampled_from(
    [*":-?[]{},#&*!|>%@`'\"\n\t \\", ": ", "\n  ", "- ", "<<: ", "!!int ", "!!float ", "!!bool ",
     "!!timestamp ", "!!binary ", "!!set ", "!!omap ", "!!pairs ", "!!null ", "!!map ", "!!seq ",
     "!!merge ", "!!value ", "1e5", "0x", "0b", "1:60", "2026-01-01", "~", "=", ".nan", "a", "b",
     "ros__parameters", "/**", "---\n", "...\n", "%YAML 9.9\n", "\ufeff", "\x85", "\u2028", "\x00"]
)  # fmt: skip


@settings(max_examples=examples(100), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(YAML_BITS, max_size=25).map("".join) | st.text() | st.binary())
@example("a: !!int ''")
@example("a: !!float ''")
@example("a: !!binary é")
def test_no_text_brings_anything_but_a_mapping_or_one_clear_line(tmp_path, text):
    file = tmp_path / "fuzz.yaml"
    file.write_bytes(text if isinstance(text, bytes) else text.encode("utf-8", "surrogatepass"))
    told = f"{file}: "
    with contextlib.suppress(ConfigError):
        try:
            assert isinstance(yaml_file.load(file), dict)
        except ConfigError as error:
            told = str(error)
            raise
    assert told.startswith(f"{file}: ")
    assert "\n" not in told


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

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left"):
        text_file.write(file, "new")
    assert file.read_text() == "old"
    assert os.listdir(tmp_path) == ["model.yaml"]


def test_writing_into_a_folder_that_is_not_there_is_an_os_error(tmp_path):
    with pytest.raises(OSError, match="No such file"):
        text_file.write(tmp_path / "none" / "model.yaml", "new")
