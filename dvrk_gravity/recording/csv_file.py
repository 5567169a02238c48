"""Recordings as CSV: one header line, one row a sample, SI units.

Columns: ``time`` (s; absent: static poses), ``<joint>.position``,
``<joint>.velocity``, ``<joint>.effort``, and ``direction`` or
``<joint>.direction`` (+1/-1), in any order. Numbers are written with the
fewest digits that read back to the same float64.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import count, islice
from pathlib import Path
from typing import TextIO

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.recording.samples import (
    CHUNK,
    LARGEST,
    QUANTITIES,
    Array,
    Coordinates,
    Samples,
    check_joints,
)
from dvrk_gravity.recording.timeline import Timeline, with_counts

LATEST_TIME = 9e9  # s; beyond it ns since 1970 overflow 64 bits: certainly not seconds
LINE_LIMIT = 10_000  # characters; a longer line is neither a header nor a row


@dataclass(frozen=True)
class _Columns:
    """Where a header's columns are: file column of every array column."""

    header: tuple[str, ...]
    joints: tuple[str, ...]
    time: int | None
    quantities: dict[str, list[int]]

    @classmethod
    def parse(cls, source: str, line: str, arm: Arm | None) -> _Columns:
        """Read a header line with the joints of an arm, or any if none is known.

        Beside all joints of an arm others are left out.

        Raises:
            RecordingError: If columns are unknown, twice, or missing, or of another arm.
        """
        known = arm.joint_names if arm else ()
        header = tuple(name.strip().strip('"') for name in line.rstrip("\r\n").split(","))
        where = f"{source}: line 1"
        if len(header) == 1 and ";" in header[0]:
            raise RecordingError(where, "columns are parted by semicolons, expected commas")
        # Where all of the arm's joints are, others are another arm's or a hand's; else a misprint.
        whole = all(f"{joint}.position" in header for joint in known)
        index: dict[str, int] = {}
        for column, name in enumerate(header):
            joint, _, quantity = name.rpartition(".")
            a_joint = joint in known or (whole and joint != "")
            if name not in ("time", "direction") and not (
                a_joint and quantity in (*QUANTITIES, "direction")
            ):
                raise RecordingError(
                    where,
                    f"column {column + 1} is {name[:40]!r}, expected time, direction or "
                    "<joint>.position/velocity/effort/direction"
                    + (f", joints: {', '.join(known)}" if known else ""),
                )
            if name in index:
                raise RecordingError(where, f"column {name!r} appears twice")
            index[name] = column
        named = dict.fromkeys(name.rpartition(".")[0] for name in index if "." in name)
        check_joints(where, tuple(named), arm)
        joints = tuple(joint for joint in known or named if joint in named)
        if not joints:
            raise RecordingError(where, "no <joint>.position column")
        quantities = {}
        for quantity in (*QUANTITIES, "direction"):
            missing = [j for j in joints if f"{j}.{quantity}" not in index]
            if missing and (quantity == "position" or len(missing) < len(joints)):
                raise RecordingError(where, f"no column {missing[0]}.{quantity}")
            if not missing:
                quantities[quantity] = [index[f"{j}.{quantity}"] for j in joints]
        if "direction" in index:
            if "direction" in quantities:
                raise RecordingError(where, "both direction and <joint>.direction columns")
            quantities["direction"] = [index["direction"]] * len(joints)
        return cls(header, joints, index.get("time"), quantities)

    def plausible(self, table: Array) -> bool:
        """Return whether all of ``(N, columns)`` are finite, and all but times below LARGEST."""
        largest = np.full(len(self.header), LARGEST)
        if self.time is not None:
            largest[self.time] = np.inf
        return bool(np.all(np.abs(table) < largest))


def _locate(source: str, columns: _Columns, lines: list[str], first_line: int) -> RecordingError:
    """Return the error that names line, column and value of the first row that cannot be used."""
    for number, line in enumerate(lines, first_line):
        if not line.strip():
            continue
        cells = line.rstrip("\r\n").split(",")
        where = f"{source}: line {number}"
        if len(cells) != len(columns.header):
            return RecordingError(where, f"{len(cells)} values, expected {len(columns.header)}")
        for name, cell in zip(columns.header, cells, strict=True):
            try:
                usable = abs(float(cell)) < (np.inf if name == "time" else LARGEST)
            except ValueError:
                usable = False
            if not usable:
                return RecordingError(
                    where,
                    f"{name} is {cell.strip()[:40]!r}, expected a finite number below {LARGEST:g}",
                )
    return RecordingError(source, f"rows from line {first_line} on are not plain numbers")


def _parse_rows(source: str, columns: _Columns, lines: list[str], first_line: int) -> Array:
    """Return the values ``(rows, columns)`` of some lines, blank ones skipped."""
    with warnings.catch_warnings():
        # Only blank lines: an empty table is the right answer, not worth a warning.
        warnings.filterwarnings("ignore", message=".*input contained no data.*")
        try:
            table = np.loadtxt(lines, delimiter=",", comments=None, ndmin=2, dtype=np.float64)
        except ValueError as error:
            raise _locate(source, columns, lines, first_line) from error
    if table.size and (table.shape[1] != len(columns.header) or not columns.plausible(table)):
        raise _locate(source, columns, lines, first_line)
    return table.reshape(-1, len(columns.header))


def _to_nanoseconds(source: str, seconds: Array) -> np.ndarray:
    if np.any(np.abs(seconds) > LATEST_TIME):
        worst = seconds[np.argmax(np.abs(seconds))]
        raise RecordingError(source, f"time is {worst:g}, expected seconds")
    return np.round(seconds * 1e9).astype(np.int64)


def iterate_csv(
    path: str | Path,
    coordinates: Coordinates = "joint",
    chunk: int = CHUNK,
    arm: Arm | None = None,
) -> Iterator[Samples]:
    """Yield a CSV file as recordings of at most ``chunk`` samples, times relative to its first row.

    A row with the time of the row before is left out and counted (``repeated``).

    Raises:
        RecordingError: Naming the line and column that cannot be used.
    """
    source = str(path)
    try:
        with Path(path).open(encoding="utf-8-sig", newline="") as file:
            yield from with_counts(_iterate(source, file, coordinates, chunk, arm))
    except UnicodeDecodeError as error:
        raise RecordingError(source, "is not a text file, expected CSV") from error
    except OSError as error:
        raise RecordingError(source, f"cannot be read: {error.strerror or error}") from error


def _lines(source: str, file: TextIO, rows_from: int) -> Iterator[str]:
    """Yield lines, numbered from the given one on; one without end is not read to the end."""
    for number in count(rows_from):
        line = file.readline(LINE_LIMIT)
        if not line:
            return
        if len(line) == LINE_LIMIT and not line.endswith("\n"):
            raise RecordingError(
                f"{source}: line {number}", f"is longer than {LINE_LIMIT} characters"
            )
        yield line


def _iterate(
    source: str, file: TextIO, coordinates: Coordinates, chunk: int, arm: Arm | None
) -> Iterator[tuple[Samples | None, int, int]]:
    header = file.readline(LINE_LIMIT)
    if not header.strip():
        raise RecordingError(source, "is empty, expected a CSV header")
    columns = _Columns.parse(source, header, arm)
    timeline = Timeline()
    begin, rows_read = 2, 0
    while lines := list(islice(_lines(source, file, rows_from=begin), chunk)):
        table = _parse_rows(source, columns, lines, begin)
        rows, time = len(table), None
        rows_read += rows
        if columns.time is not None:
            stamps = _to_nanoseconds(source, table[:, columns.time])
            numbers = [n for n, line in enumerate(lines, begin) if line.strip()]
            later, time = timeline.advance(stamps, numbers, f"{source}: line")
            table = table[later]
        begin += len(lines)
        if not len(table):
            yield None, 0, rows
            continue
        arrays = {name: table[:, index] for name, index in columns.quantities.items()}
        for array in (*arrays.values(), time):
            if array is not None:
                array.flags.writeable = False
        samples = Samples(
            columns.joints,
            time,
            arrays["position"],
            arrays.get("velocity"),
            arrays.get("effort"),
            arrays.get("direction"),
            coordinates,
            source,
            timeline.start_ns or 0,
            arm=arm,
        )
        yield samples, 0, rows - len(table)
    if not rows_read:
        raise RecordingError(source, "has a header but no rows")


@contextmanager
def new_file(path: str | Path) -> Iterator[TextIO]:
    """Open a new text file that appears under its name only when complete.

    Raises:
        RecordingError: If the target exists or cannot be written.
    """
    target = Path(path)
    if target.exists():
        raise RecordingError(target, "exists already, expected a new name")
    partial = target.with_name(f"{target.name}.partial-{os.getpid()}")
    try:
        with partial.open("x", encoding="utf-8", newline="") as file:
            yield file
        partial.replace(target)
    except OSError as error:
        raise RecordingError(target, f"cannot be written: {error.strerror or error}") from error
    finally:
        partial.unlink(missing_ok=True)


def write_csv(chunks: Iterable[Samples], path: str | Path) -> None:
    """Write consecutive parts of one recording as a CSV file, complete or not at all.

    Raises:
        RecordingError: If the target exists or cannot be written, or the parts differ in columns.
    """
    with new_file(path) as file:
        header: list[str] = []
        for part in chunks:
            names, arrays = _table(part)
            if not header:
                header = names
                file.write(",".join(header) + "\n")
            elif names != header:
                raise RecordingError(part.source, "columns change within the recording")
            table = np.column_stack(arrays)
            file.writelines(",".join(map(repr, row)) + "\n" for row in table.tolist())
        if not header:
            raise RecordingError(path, "nothing to write")


def _table(part: Samples) -> tuple[list[str], list[Array]]:
    names, arrays = [], []
    if part.time is not None:
        names.append("time")
        arrays.append(part.time)
    for quantity in QUANTITIES:
        values = getattr(part, quantity)
        if values is not None:
            names += [f"{joint}.{quantity}" for joint in part.joints]
            arrays.append(values)
    if part.direction is not None:
        if np.all(part.direction == part.direction[:, :1]):
            names.append("direction")
            arrays.append(part.direction[:, 0])
        else:
            names += [f"{joint}.direction" for joint in part.joints]
            arrays.append(part.direction)
    return names, arrays
