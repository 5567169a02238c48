"""What files and messages are called never moves a terminal's cursor, nor turns a page's text."""

from __future__ import annotations

import io
import unicodedata
from contextlib import redirect_stdout

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from recording_samples import joint_state, write_messages
from support import examples

from dvrk_gravity.arms import Arm
from dvrk_gravity.command_line import CLEAR_LINE, PrintableStream, one_line
from dvrk_gravity.errors import ConfigError, DvrkGravityError, PlanError, RecordingError, printable
from dvrk_gravity.files import yaml_file
from dvrk_gravity.recording import BagReader, Note, Recording
from dvrk_gravity.report import html

CLEAR, TURN = "\x1b[2J\x1b[H", "\u202eevil\u2066"
HOSTILE = f"a{CLEAR}b{TURN}\r\n\u2028\x9b1m\udc80c"
OBEYED = {"Cc", "Cf", "Cs", "Zl", "Zp"}


def obeyed(text):
    """Return the characters of a text that would be obeyed, not shown."""
    return [letter for letter in text if unicodedata.category(letter) in OBEYED]


@given(st.text() | st.text(st.characters(categories=sorted(OBEYED), codec=None)))
@settings(max_examples=examples(100))
def test_printable_text_is_shown_whole(text):
    shown = printable(text)
    assert not obeyed(shown)
    assert printable(shown) == shown
    shown.encode()


def test_text_of_the_field_stays_as_it_is():
    for text in ("λ·ẋ = −3 N·m², ±5 °", "関節1", "a\u00a0b", "مفصل"):
        assert printable(text) == text


@pytest.mark.parametrize(
    "error",
    [
        RecordingError(HOSTILE, HOSTILE),
        ConfigError(HOSTILE, HOSTILE, HOSTILE, HOSTILE),
        DvrkGravityError(HOSTILE),
        PlanError(HOSTILE),
        Note("gaps", HOSTILE, {}, HOSTILE, recording=HOSTILE),
        ConfigError("x", [2**40_000], "a number"),
    ],
)
def test_errors_and_warnings_are_printable(error):
    assert not obeyed(str(error))


def test_an_error_of_the_system_is_printable():
    assert not obeyed(one_line(FileNotFoundError(2, "no such file", HOSTILE)))


def test_pages_are_printable():
    assert not obeyed(html.escape(HOSTILE) + html.item_list([HOSTILE]).replace("\n", ""))
    assert not obeyed(html.table([HOSTILE], [[HOSTILE]]).replace("\n", ""))


def test_a_terminal_gets_lines_and_nothing_else_to_obey():
    written = io.StringIO()
    with redirect_stdout(PrintableStream(written)):
        print(f"{CLEAR_LINE}half: {HOSTILE}{CLEAR_LINE}", end="")
        print("next\nlast")
    assert written.getvalue().startswith(CLEAR_LINE)
    rest = written.getvalue().removeprefix(CLEAR_LINE)
    assert set(obeyed(rest)) == {"\n"}


def test_names_of_topics_and_joints_are_printable(tmp_path):
    names = tuple(f"j{k}{CLEAR}" for k in range(2))
    write_messages(tmp_path / "bag", [joint_state(k, names) for k in range(20)], topic=f"/a{TURN}")
    with BagReader(tmp_path / "bag") as bag:
        assert not obeyed("".join(bag.topics))
    found = Recording.load(tmp_path / "bag")
    assert found.joints == tuple(map(printable, names))


def test_names_of_columns_are_printable(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(
        f"time,j{CLEAR}.position,other{TURN}\n" + "".join(f"{k},1,2\n" for k in range(9))
    )
    found = Recording.load(path)
    assert not obeyed("".join(found.joints) + "".join(note.text for note in found.found))
    assert "\\x1b[2J" in found.joints[0]


def test_texts_of_yaml_are_printable(tmp_path):
    path = tmp_path / "a.yaml"
    path.write_text(yaml.safe_dump({f"a{CLEAR}": [f"b{TURN}\n"]}))
    assert not obeyed(str(yaml_file.load(path)))


def test_an_arm_has_printable_names(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(
        '<robot name="r"><link name="a"/><link name="b"/><joint name="j&#x202e;k" type="revolute">'
        '<parent link="a"/><child link="b"/><limit lower="-1" upper="1" effort="1" velocity="1"/>'
        "</joint></robot>"
    )
    with pytest.raises(ConfigError, match="printed") as caught:
        Arm.load(str(path))
    assert not obeyed(str(caught.value))
