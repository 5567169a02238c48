"""Small files that unpack, recur or compare without end are refused after a bounded amount of work.

Work is counted in calls, records and bytes; the benchmark ``fuzz`` reads larger such files, and
looks at the processor's time and at memory.
"""

from __future__ import annotations

import signal
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
from dvrk_gravity.recording import Allowance, BagReader, bag_file, sqlite_file

RECORDS, CHUNK, PER_BYTE = 5000, 1_000_000, 100
# Calls of functions, Python's and others: for each record of a bag, or byte of a text.
CALLS = 30


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
    """Bounds a hundredth of the real ones, and files to match."""
    monkeypatch.setattr(Allowance, "RECORDS", RECORDS)
    monkeypatch.setattr(Allowance, "PER_BYTE", PER_BYTE)
    monkeypatch.setattr(bag_file, "LARGEST_CHUNK", CHUNK)
    monkeypatch.setattr(sqlite_file, "_MOST_STEPS", 300_000)
    monkeypatch.setattr(hostile_files, "CHUNK", 900_000)
    monkeypatch.setattr(hostile_files, "TEXT", 99_000)
    monkeypatch.setattr(hostile_files, "PACKED", 5000)


@pytest.mark.parametrize("kind", KINDS)
def test_a_hostile_file_is_work_in_proportion_to_its_size(tmp_path, small, kind):
    path = hostile_files.write(kind, tmp_path, Random(0))
    size = path.stat().st_size
    calls = CALLS * (size if kind in TEXTS else 4 * (RECORDS + size))
    with at_most(calls), suppress(DvrkGravityError):
        hostile_files.read(path)


@pytest.mark.parametrize(
    ("kind", "why"),
    [
        ("MCAP, empty records, bz2", "records"),
        ("MCAP, empty records, zstd", "records"),
        ("ROS 1, empty records", "records"),
        ("MCAP, large messages", "unpack"),
        ("packed MCAP", "unpack|records"),
        ("db3, a view", "view"),
        ("db3, a view of topics", "view"),
        ("db3, a computed column", "computed"),
    ],
)
def test_what_a_file_cannot_be_is_refused_by_name(tmp_path, small, kind, why):
    path = hostile_files.write(kind, tmp_path, Random(0))
    with pytest.raises(DvrkGravityError, match=why) as caught:
        hostile_files.read(path)
    assert path.name in str(caught.value)


@pytest.mark.parametrize("kind", ["db3, pages without end", "db3, packed messages"])
def test_of_a_database_without_end_the_beginning_is_read(tmp_path, small, kind):
    path = hostile_files.write(kind, tmp_path, Random(0))
    with BagReader(path) as bag:
        read = sum(1 for _ in bag.raw(hostile_files.TOPIC))
        assert 0 < read <= RECORDS + path.stat().st_size
        assert any("damaged" in note.text for note in bag.notes)


def test_ctrl_c_ends_a_query_of_sqlite(tmp_path, monkeypatch):
    # The topic of no message: SQLite returns nothing that Python could look at.
    path = hostile_files.write("db3, pages without end", tmp_path, Random(0))
    counted, looks = sqlite_file.SqliteFile._count_steps, []

    def pressed(file):
        looks.append(file)
        if len(looks) == 3:
            signal.raise_signal(signal.SIGINT)
        return counted(file)

    monkeypatch.setattr(sqlite_file.SqliteFile, "_count_steps", pressed)
    file = sqlite_file.SqliteFile(path, path.stat().st_size)
    with pytest.raises(KeyboardInterrupt):
        list(file.read([2]))
    file.close()
    assert len(looks) == 3


@pytest.mark.parametrize("codec", hostile_files.PACK)
def test_ctrl_c_waits_for_a_megabyte_that_is_unpacked_at_most(monkeypatch, codec):
    asked, made = [], bag_file._decompressor

    class Watched:
        def __init__(self, inner):
            self.inner = inner

        def __getattr__(self, name):
            return getattr(self.inner, name)

        def decompress(self, data, most=-1):
            asked.append(most)
            return self.inner.decompress(data, most)

    monkeypatch.setattr(bag_file, "_decompressor", lambda kind: Watched(made(kind)))
    data = bytes(5_000_000)
    packed, allowance = hostile_files.PACK[codec](data), Allowance(100_000)
    assert bag_file.unpacked(packed, codec, len(data), allowance) == data
    assert allowance.unpacked == len(data)
    assert 0 < min(asked) <= max(asked) <= 1_000_000


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
