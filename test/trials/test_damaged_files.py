"""Whatever a file holds, it is read or refused in one line: no other error.

Good files are damaged here and there, so that most of what comes out gets past the first check.
The benchmark ``fuzz`` tries many more cases.
"""

from __future__ import annotations

import random
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from recording_samples import joint_state, wave, write_messages
from support import CONFIG, MODEL_FILE, examples

from dvrk_gravity import TorqueModel
from dvrk_gravity.arms import Arm
from dvrk_gravity.compensate import Settings
from dvrk_gravity.console import ConsoleFile
from dvrk_gravity.errors import ConfigError, DvrkGravityError
from dvrk_gravity.files import yaml_file
from dvrk_gravity.newton_euler import reader as mechanism
from dvrk_gravity.recording import CdrError, JointStateLayout, Recording
from dvrk_gravity.simulate import PlantFile

FRAGMENTS = [
    "nan", ".nan", "-.inf", "Infinity", "1e999", "-1", "0", "1e308", "9" * 5000, "true", "null",
    "~", "''", "'", '"', "[]", "{}", "[[", "}", "]", ",", ":", ": ", "- ", "\t", "\n", "\r", "\0",
    "#", "%", "?", "&a [*a]", "*a", "<<: {a: 1}", "!!python/object/apply:os.system ['true']",
    "!!int ''", "!!binary x", "\u2028", "é", "\ud7ff", "../../../etc/passwd", "2001-02-30", "0x1F",
    "1_000", "1:30:00", "beta", "arm", "outer_yaw", "[" * 3000, "{a: " * 50, "---\n", "...\n",
]  # fmt: skip
FAST = settings(
    max_examples=examples(25),
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)


def model(path: Path) -> None:
    """Load a model; what loads makes torques, and settings or an error that says why not."""
    loaded = TorqueModel.load(path)
    with np.errstate(all="ignore"):
        loaded.torque(np.full(7, 0.1), np.full(7, 0.2))
    try:
        Settings.from_parameters(loaded.parameters())
    except ConfigError:
        return


def original(kind: str, folder: Path) -> tuple[bytes, Path]:
    """Return the content of a good file of a kind, and where a damaged one is written."""
    if kind == "bag":
        shutil.rmtree(folder / "bag", ignore_errors=True)
        wave(30).save(folder / "bag")
        return (folder / "bag" / "metadata.yaml").read_bytes(), folder / "bag" / "metadata.yaml"
    if kind == "console":
        return TorqueModel.load(MODEL_FILE).document.encode(), folder / "gc-MTMR-1.json"
    return FILES[kind].read_bytes(), folder / "fuzz.yaml"


FILES = {
    "model": MODEL_FILE,
    "arm": CONFIG / "arms" / "mtmr.yaml",
    "plant": CONFIG / "plants" / "mtmr_28002.yaml",
    "mechanism": CONFIG / "exercises" / "2_1_with_gravity.yaml",
}
READERS: dict[str, Callable[[Path], Any]] = {
    "model": model,
    "arm": Arm.load,
    "plant": PlantFile.load,
    "mechanism": mechanism.read,
    "console": ConsoleFile.load,
    "bag": lambda path: Recording.load(path.parent),
}
EDITS = st.lists(
    st.tuples(
        st.sampled_from(["insert", "replace", "number", "delete", "double", "cut"]),
        st.floats(0.0, 1.0),
        st.sampled_from(FRAGMENTS) | st.text(max_size=5),
    ),
    min_size=1,
    max_size=4,
)


def damaged(content: bytes, edits: list[tuple[str, float, str]]) -> bytes:
    """Return a file's content with some edits made, each at a share of its length."""
    text = content.decode("utf-8", "replace")
    for kind, share, new in edits:
        at = int(share * len(text))
        if kind in ("insert", "replace"):
            text = text[:at] + new + text[at + (len(new) if kind == "replace" else 0) :]
        elif kind == "number":
            spans = [match.span() for match in re.finditer(r"-?\d+(\.\d*)?", text)]
            if spans:
                start, end = spans[min(int(share * len(spans)), len(spans) - 1)]
                text = text[:start] + new + text[end:]
        elif kind in ("delete", "double"):
            lines = text.splitlines(keepends=True)
            i = int(share * max(len(lines) - 1, 0))
            lines[i : i + 1] = [] if kind == "delete" else lines[i : i + 1] * 2
            text = "".join(lines)
        else:
            text = text[:at]
    return text.encode("utf-8", "surrogatepass")


def read_or_refused(read: Callable[[Path], Any], path: Path) -> None:
    """Any other error than the package's own fails; so does one that is not a line."""
    said, given = "read", ""
    try:
        found = read(path)
    except DvrkGravityError as error:
        said, given = str(error), "".join(map(str, error.args))
    else:
        assert not isinstance(found, Recording) or np.isfinite(found.position).all()
    assert 0 < len(said) < 1000
    assert "\n" not in given  # a text spells it out


@pytest.mark.parametrize("kind", READERS)
@FAST
@given(edits=EDITS)
def test_any_damaged_file_is_read_or_refused(tmp_path, kind, edits):
    content, path = original(kind, tmp_path)
    path.write_bytes(damaged(content, edits))
    read_or_refused(READERS[kind], path)


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
def test_any_text_is_a_mapping_or_refused(tmp_path, text):
    file = tmp_path / "fuzz.yaml"
    file.write_bytes(text if isinstance(text, bytes) else text.encode("utf-8", "surrogatepass"))
    read_or_refused(yaml_file.load, file)


CELLS = st.sampled_from(
    ["0", "1", "-1.5", "1e999", "nan", "", " ", "x", "1e-320", "0x1", "1_0", '"1"', "\0", "é", "#"]
) | st.floats().map(repr)
NAMES = st.sampled_from(
    ["time", "direction", "outer_yaw.position", "outer_yaw.effort", "wrist_roll.position", "", "."]
)
LINES = st.lists(st.lists(CELLS, max_size=4).map(",".join), max_size=6)


@FAST
@given(names=st.lists(NAMES, max_size=4), lines=LINES, end=st.sampled_from(["\n", "\r\n", "\r"]))
def test_any_csv_is_read_or_refused(tmp_path, names, lines, end):
    path = tmp_path / "fuzz.csv"
    path.write_text(end.join([",".join(names), *lines]), encoding="utf-8", newline="")
    read_or_refused(Recording.load, path)


@pytest.fixture(scope="module")
def small_bags(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bags")
    for storage in ("sqlite3", "mcap"):
        write_messages(folder / storage, [joint_state(k) for k in range(20)], storage)
    return [folder / "sqlite3/sqlite3.db3", folder / "mcap/mcap.mcap"]


@FAST
@given(seed=st.integers(0, 2**32), count=st.integers(1, 30))
@example(226, 13)  # a time of receipt beyond what 64 bits with a sign hold
def test_damaged_bags_are_read_or_refused(tmp_path, small_bags, seed, count):
    draw = random.Random(seed)
    for original in small_bags:
        data = bytearray(original.read_bytes())
        for _ in range(count):
            at = draw.randrange(len(data))
            damage = bytes(draw.choice((0, 1, 255, draw.randrange(256))) for _ in range(4))
            kind = draw.randrange(3)
            data[at : at + (0 if kind == 0 else 4)] = b"" if kind == 1 else damage
        path = tmp_path / f"fuzz{original.suffix}"
        path.write_bytes(data)
        read_or_refused(Recording.load, path)


@FAST
@given(
    data=st.binary(max_size=400)
    | st.builds(
        lambda at, new: joint_state(0)[1][:at] + new + joint_state(0)[1][at + len(new) :],
        st.integers(0, 330),
        st.binary(min_size=1, max_size=8),
    )
)
def test_any_message_is_decoded_or_refused(data):
    try:
        layout = JointStateLayout.parse(data)
    except CdrError:
        return
    stamps, values = layout.decode([data])
    assert layout.match([data]).all()
    assert (len(stamps), len(values)) == (1, 3)
