"""Whatever a file holds, it is read or refused in one line: no other error, no long wait.

Good files are damaged here and there, so that most of what comes out gets past the first check;
arbitrary bytes as CSV and bags are tried in the tests of the recordings. The benchmark ``fuzz``
tries many more cases.
"""

from __future__ import annotations

import re
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from recording_samples import wave
from support import CONFIG, MODEL_FILE, examples

from dvrk_gravity import TorqueModel
from dvrk_gravity.arms import Arm
from dvrk_gravity.compensate import Settings
from dvrk_gravity.console import ConsoleFile
from dvrk_gravity.errors import ConfigError, DvrkGravityError
from dvrk_gravity.newton_euler import reader as mechanism
from dvrk_gravity.recording import Recording
from dvrk_gravity.simulate import PlantFile

SLOWEST = 5.0  # s of processor time that a file of a few kB may take
FRAGMENTS = [
    "nan", ".nan", "-.inf", "Infinity", "1e999", "-1", "0", "1e308", "9" * 5000, "true", "null",
    "~", "''", "'", '"', "[]", "{}", "[[", "}", "]", ",", ":", ": ", "- ", "\t", "\n", "\r", "\0",
    "#", "%", "?", "&a [*a]", "*a", "<<: {a: 1}", "!!python/object/apply:os.system ['true']",
    "!!int ''", "!!binary x", "\u2028", "é", "\ud7ff", "../../../etc/passwd", "2001-02-30", "0x1F",
    "1_000", "1:30:00", "beta", "arm", "outer_yaw", "[" * 3000, "{a: " * 50, "---\n", "...\n",
]  # fmt: skip


def model(path: Path) -> None:
    """Load a model; what loads makes finite torques, or settings that say why not."""
    loaded = TorqueModel.load(path)
    with np.errstate(all="ignore"):
        loaded.torque(np.full(7, 0.1), np.full(7, 0.2))
    try:
        Settings.from_parameters(loaded.parameters())
    except ConfigError:
        return


READERS: dict[str, tuple[Path, Callable[[Path], Any]]] = {
    "model": (MODEL_FILE, model),
    "arm": (CONFIG / "arms" / "mtmr.yaml", Arm.load),
    "plant": (CONFIG / "plants" / "mtmr_28002.yaml", PlantFile.load),
    "mechanism": (CONFIG / "exercises" / "2_1_with_gravity.yaml", mechanism.read),
}
EDITS = st.lists(
    st.tuples(
        st.sampled_from(["insert", "replace", "number", "delete", "double", "cut", "byte"]),
        st.floats(0.0, 1.0),
        st.sampled_from(FRAGMENTS) | st.text(max_size=5),
    ),
    min_size=1,
    max_size=4,
)


def damaged(original: bytes, edits: list[tuple[str, float, str]]) -> bytes:
    """Return a file's content with some edits made, each at a share of its length."""
    for kind, share, fragment in edits:
        text = original.decode("utf-8", "replace")
        at = int(share * len(text))
        new = fragment
        if kind == "insert":
            text = text[:at] + new + text[at:]
        elif kind == "replace":
            text = text[:at] + new + text[at + max(len(new), 1) :]
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
        elif kind == "cut":
            text = text[:at]
        original = text.encode("utf-8", "surrogatepass")
        if kind == "byte" and original:
            at = int(share * (len(original) - 1))
            original = original[:at] + bytes([len(new) * 37 % 256]) + original[at + 1 :]
    return original


def read_or_refused(read: Callable[[Path], Any], path: Path) -> None:
    """Any other error than the package's own fails; so does one whose text is not one line."""
    begin = time.process_time()
    said, given = "read", ""
    try:
        read(path)
    except DvrkGravityError as error:
        said, given = str(error), "".join(map(str, error.args))
    assert 0 < len(said) < 1000
    assert "\n" not in given  # a text spells it out
    assert time.process_time() - begin < SLOWEST


FAST = settings(
    max_examples=examples(20),
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)


@pytest.mark.parametrize("kind", READERS)
@FAST
@given(edits=EDITS)
def test_any_damaged_parameter_file_is_read_or_refused(tmp_path, kind, edits):
    original, read = READERS[kind]
    path = tmp_path / "fuzz.yaml"
    path.write_bytes(damaged(original.read_bytes(), edits))
    read_or_refused(read, path)


@FAST
@given(edits=EDITS)
def test_any_damaged_console_file_is_read_or_refused(tmp_path, edits):
    path = tmp_path / "gc-MTMR-1.json"
    document = TorqueModel.load(MODEL_FILE).document
    path.write_bytes(damaged(document.encode(), edits))
    read_or_refused(ConsoleFile.load, path)


@pytest.fixture(scope="module")
def bag(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("fuzz") / "bag"
    wave(30).save(folder)
    return folder


@FAST
@given(edits=EDITS)
def test_any_damaged_description_of_a_bag_is_read_or_refused(tmp_path, bag, edits):
    copy = tmp_path / "bag"
    shutil.rmtree(copy, ignore_errors=True)
    shutil.copytree(bag, copy)
    metadata = copy / "metadata.yaml"
    metadata.write_bytes(damaged(metadata.read_bytes(), edits))
    read_or_refused(Recording.load, copy)


def test_the_judge_lets_no_other_error_pass(tmp_path):
    def broken(_: Path) -> None:
        raise KeyError("a defect")

    with pytest.raises(KeyError):
        read_or_refused(broken, tmp_path)

    def chatty(_: Path) -> None:
        raise DvrkGravityError("one line\nand another")

    with pytest.raises(AssertionError):
        read_or_refused(chatty, tmp_path)
