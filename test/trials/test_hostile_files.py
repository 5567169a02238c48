"""Small files that unpack, recur or compare without end are refused after a bounded amount of work.

Work is counted in calls; the benchmark ``fuzz`` reads larger such files, and
looks at the processor's time and at memory.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from random import Random
from typing import Any

import hostile_files
import pytest
from hostile_files import KINDS, TEXTS

from dvrk_gravity.errors import DvrkGravityError
from dvrk_gravity.files import json_file

# Calls of functions, Python's and others: for each byte of a text, and of any other file.
CALLS, OTHERS = 30, 1_000_000


class TooManyCallsError(BaseException):
    """A reader made more calls than it may."""


@contextmanager
def at_most(calls: int) -> Iterator[None]:
    """Raise where more functions are called."""
    left = calls

    def count(frame: Any, event: str, argument: Any) -> None:
        nonlocal left
        left -= event in ("call", "c_call")
        if left < 0:
            sys.setprofile(None)
            raise TooManyCallsError(f"more than {calls}")

    sys.setprofile(count)
    try:
        yield
    finally:
        sys.setprofile(None)


@pytest.fixture
def small(monkeypatch):
    """Texts of a tenth of the real ones' length."""
    monkeypatch.setattr(hostile_files, "TEXT", 99_000)


@pytest.mark.parametrize("kind", KINDS)
def test_a_hostile_file_is_work_in_proportion_to_its_size(tmp_path, small, kind):
    path = hostile_files.write(kind, tmp_path, Random(0))
    size = path.stat().st_size
    with at_most(CALLS * size if kind in TEXTS else OTHERS), suppress(DvrkGravityError):
        hostile_files.read(path)


@pytest.mark.parametrize("kind", [kind for kind in TEXTS if kind.startswith("JSON")])
def test_no_mark_of_a_console_file_is_searched_from_twice(kind):
    content = TEXTS[kind][1](Random(0))
    for pattern, marks in ((json_file._COMMENT, ('"', "/*", "//")), (json_file._LOOSE, ('"',))):
        at = 0
        for match in pattern.finditer(content):
            assert not any(mark in content[at : match.start()] for mark in marks)
            at = match.end()
        assert not any(mark in content[at:] for mark in marks)


def test_of_many_oddities_of_a_console_file_some_are_listed(tmp_path):
    path = tmp_path / "gc.json"
    path.write_text("{" + ",".join(f'"k{k}": 1, "k{k}": 2' for k in range(5000)) + "}")
    content, oddities = json_file.load_with_oddities(path)
    assert content["k4999"] == 2
    assert len(oddities) == json_file.MOST_ODDITIES + 1
    assert "4900" in oddities[-1].text
