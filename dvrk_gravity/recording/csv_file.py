"""Reading CSV files as many programs write them: any delimiter, a header after comments, dates."""

from __future__ import annotations

import csv
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from itertools import count
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.errors import RecordingError, printable
from dvrk_gravity.recording.csv_columns import WAY_OUT, Columns, Header, Mapped, read_columns
from dvrk_gravity.recording.csv_header import HeaderReader
from dvrk_gravity.recording.notes import Note, note
from dvrk_gravity.recording.publishers import one_publisher
from dvrk_gravity.recording.samples import CHUNK, LARGEST, Coordinates, Samples, TimeBase
from dvrk_gravity.recording.table import Assembly, RowTable

LATEST_TIME = 9e9  # s; beyond it ns since 1970 overflow 64 bits: certainly not seconds
LINE_LIMIT = 100_000  # characters; a longer line is neither a header nor a row
# Characters of rows read at a time, beside one line: those of 100 columns have half of it.
_PART_CHARACTERS = 8_000_000
_MOST_COMMENTS = 200  # lines before the header
_DELIMITERS = (",", ";", "\t", " ")
# Part of the rows that may be unreadable, of so many. Chosen: few are in a file that was cut off.
_UNREADABLE, _ENOUGH = 0.1, 1000
# s since 1970 of the years 2000 to 2100: a larger time is in the unit that brings it there.
_SINCE_1970 = (9.4e8, 4.1e9)


def iterate_csv(
    path: str | Path,
    coordinates: Coordinates = "joint",
    chunk: int = CHUNK,
    arm: Arm | None = None,
    columns: Columns | None = None,
    time_base: TimeBase = "stamp",
) -> Iterator[Samples]:
    """Yield a CSV file as samples, about ``chunk`` at a time, times relative to its first row.

    Rows that are left out are counted (``repeated``, ``notes``).

    Args:
        path: The file.
        coordinates: Of its columns.
        chunk: Rows read at a time.
        arm: Whose joints are read; ``None``: those that the header names.
        columns: See :func:`~dvrk_gravity.recording.csv_columns.read_columns`.
        time_base: Which of two times is read, where a file has a header's stamp, too.

    Raises:
        RecordingError: Naming the line and column that cannot be used.
        ConfigError: ``columns`` that are none.
    """
    source, given = str(path), read_columns(columns)
    assembly = Assembly(source, "line", coordinates, arm, "")
    try:
        with Path(path).open(encoding="utf-8-sig", newline="") as file:
            reader = RowReader(source, file, arm, given, time_base)
            yield from assembly.samples(one_publisher(reader.tables(chunk), source))
    except UnicodeDecodeError as error:
        raise RecordingError(source, "is not a text file, expected CSV") from error
    except OSError as error:
        raise RecordingError(source, f"cannot be read: {error.strerror or error}") from error


@dataclass
class RowReader:
    """Reads the rows of a CSV file that is open at its beginning; see :func:`iterate_csv`."""

    source: str
    file: TextIO
    arm: Arm | None
    given: Mapped
    time_base: TimeBase = "stamp"
    _delimiter: str = ","
    _read: int = 0
    _unreadable: int = 0
    _problem: RecordingError | None = None
    _factor: float | None = None
    _first_lines: list[tuple[int, str]] = field(default_factory=list)

    def tables(self, chunk: int) -> Iterator[RowTable]:
        """Yield the rows, ``chunk`` at a time.

        Raises:
            RecordingError: No readable header, no rows, or too many that cannot be read.
        """
        header = self._header()
        notes = header.notes
        for numbers, rows_of in self._parts(chunk):
            table = self._table(header, numbers, rows_of, notes)
            rows_of.clear()  # its memory serves the next read
            notes = ()
            yield table
        if self._problem is not None and self._unreadable > _UNREADABLE * self._read:
            raise self._problem
        if not self._read:
            raise RecordingError(self.source, "has a header but no rows")

    def _parts(self, chunk: int) -> Iterator[tuple[list[int], list[str]]]:
        """Yield numbers and texts of consecutive lines, ``chunk`` at a time, or fewer long ones."""
        numbers: list[int] = []
        lines: list[str] = []
        size = 0
        for number, line in self._numbered():
            numbers.append(number)
            lines.append(line)
            size += len(line)
            if len(lines) == chunk or size > _PART_CHARACTERS:
                yield numbers, lines
                numbers, lines, size = [], [], 0
        if lines:
            yield numbers, lines

    def _numbered(self) -> Iterator[tuple[int, str]]:
        """Yield number and text of the lines that are not blank, the header's first rows first."""
        yield from self._first_lines
        begin = self._first_lines[-1][0] + 1 if self._first_lines else self._next
        for number, line in self._lines(begin):
            if line.strip():
                yield number, line

    def _lines(self, begin: int) -> Iterator[tuple[int, str]]:
        """Yield numbered lines; one longer than ``LINE_LIMIT`` is refused."""
        for number in count(begin):
            line = self.file.readline(LINE_LIMIT)
            self._next = number + 1
            if not line:
                return
            if len(line) == LINE_LIMIT and not line.endswith("\n"):
                raise RecordingError(
                    f"{self.source}: line {number}", f"is longer than {LINE_LIMIT} characters"
                )
            yield number, line

    def _header(self) -> Header:
        """Read up to the first row, and return the header."""
        self._next = 1
        comments: list[tuple[int, str]] = []
        plain: list[tuple[int, str]] = []
        for number, line in self._lines(1):
            if not line.strip():
                continue
            if line.lstrip().startswith(("#", "%")) and not plain:
                comments.append((number, line.strip().lstrip("#").strip()))
                if len(comments) > _MOST_COMMENTS:
                    break
                continue
            plain.append((number, line))
            if len(plain) == 2:
                break
        if not plain and not comments:
            raise RecordingError(self.source, "is empty, expected a CSV header")
        if not plain:
            plain.append(comments.pop())
        if not _is_row(plain[0][1]):
            number, head = plain.pop(0)
        elif comments:
            number, head = comments[-1]
        else:
            return self._without_header(plain)
        first = plain[0][1] if plain else ""
        self._first_lines = plain
        self._delimiter = _delimiter(head, first)
        names = [printable(name.strip().strip('"')) for name in self._cells(head)]
        where = f"{self.source}: line {number}"
        cells = self._cells(first)
        return HeaderReader(where, self.arm, self.given, self.time_base, names, cells).read()

    def _without_header(self, plain: list[tuple[int, str]]) -> Header:
        """Return the columns of a file of rows alone: mapped by a user, or `ros2 topic echo`'s."""
        number, first = plain[0]
        self._first_lines = plain
        self._delimiter = _delimiter(first, first)
        cells = [cell.strip() for cell in self._cells(first)]
        where = f"{self.source}: line {number}"
        names = _echoed(cells)
        if names is None or self.given.columns:
            if not self.given.columns:
                raise RecordingError(
                    where, "has no header, expected names of columns; or --columns "
                    "'1=time,2=<joint>.position,…' by their numbers"
                )  # fmt: skip
            names = [str(k + 1) for k in range(len(cells))]
        names = [printable(name) for name in names]
        if not names:
            raise RecordingError(
                where, "looks like `ros2 topic echo --csv`, of which two fields were sent, and it "
                "does not say which; --columns '1=time,…' by the columns' numbers"
            )  # fmt: skip
        return HeaderReader(where, self.arm, self.given, self.time_base, names, cells).read()

    def _cells(self, line: str) -> list[str]:
        text = line.rstrip("\r\n")
        if self._delimiter == " ":
            return text.split()
        if '"' in text:
            return next(csv.reader([text], delimiter=self._delimiter))
        return text.split(self._delimiter)

    def _table(
        self, header: Header, numbers: list[int], lines: list[str], notes: tuple[Note, ...]
    ) -> RowTable:
        """Return the rows of some lines."""
        values = self._fast(header, lines)
        lined = np.array(numbers, np.int64)
        if values is None:
            values, good = self._slow(header, numbers, lines)
            bad = len(lines) - len(values)
            if bad:
                text = f"of lines that are no rows (the first one: {self._problem})"
                notes += (note("unreadable", text, left_out=bad),)
            lined = lined[good]
            self._unreadable += bad
        self._read += len(lines)
        too_many = self._unreadable > _UNREADABLE * self._read and self._read > _ENOUGH
        if self._problem is not None and too_many:
            raise self._problem
        used = {column: place for place, column in enumerate(header.used)}
        self._require_same(header, used, values, lined)
        stamps = None
        if header.time is not None:
            times = values[:, [used[at] for at in header.time.columns]]
            known = np.asarray(np.isfinite(times).all(axis=1))
            if not known.all():
                left = len(known) - int(known.sum())
                notes += (note("not_finite", "without a time", left_out=left),)
                values, lined = values[known], lined[known]
            stamps = self._stamps(header, times[known], lined)
        missing = np.full(len(values), np.nan)
        arrays = {
            quantity: np.column_stack(
                [values[:, used[at]] if at >= 0 else missing for at in columns]
            ) * header.factors[quantity]
            for quantity, columns in header.quantities.items()
        }  # fmt: skip
        if stamps is not None and arrays:
            # In a file with rows of several topics, those of the others are empty.
            some = np.any([np.isfinite(array).any(axis=1) for array in arrays.values()], axis=0)
            if not some.all():
                arrays = {quantity: array[some] for quantity, array in arrays.items()}
                stamps, lined = stamps[some], lined[some]
        return RowTable(header.joints, stamps, lined, arrays, 0, notes)

    def _fast(self, header: Header, lines: list[str]) -> Array | None:
        """Return the used columns (N, k) of plain lines; ``None`` if some need :meth:`_slow`."""
        delimiter, text = self._delimiter, header.time is not None and header.time.text
        cells = len(header.names) - 1
        if text or (delimiter != " " and any(line.count(delimiter) != cells for line in lines)):
            return None
        given = lines if delimiter == "," else [line.replace(",", ".") for line in lines]
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message=".*input contained no data.*")
            try:
                return np.loadtxt(
                    given, delimiter=None if delimiter == " " else delimiter, comments=None,
                    ndmin=2, dtype=np.float64, usecols=header.used,
                )  # fmt: skip
            except ValueError:
                return None

    def _slow(self, header: Header, numbers: list[int], lines: list[str]) -> tuple[Array, Mask]:
        """Return the used columns (N, k) of the readable lines, and the mask of these."""
        rows: list[list[float] | None] = []
        for number, line in zip(numbers, lines, strict=True):
            try:
                rows.append(self._row(header, line))
            except ValueError as error:
                rows.append(None)
                where = f"{self.source}: line {number}"
                self._problem = self._problem or RecordingError(where, str(error))
        good = np.array([row is not None for row in rows], dtype=bool)
        found = [row for row in rows if row is not None]
        return np.array(found, np.float64).reshape(-1, len(header.used)), good

    def _row(self, header: Header, line: str) -> list[float]:
        """Return the used columns of a line, or raise ``ValueError``."""
        cells, expected = self._cells(line), len(header.names)
        if len(cells) != expected and not (len(cells) == expected + 1 and not cells[-1].strip()):
            raise ValueError(f"{len(cells)} values, expected {expected}")
        dates = header.time.columns if header.time is not None and header.time.text else ()
        row = []
        for at in header.used:
            value = _date(cells[at]) if at in dates else _number(cells[at], self._delimiter)
            if value is None:
                raise ValueError(
                    f"{header.names[at]} is {cells[at].strip()[:40]!r}, expected a finite number "
                    f"below {LARGEST:g}"
                )
            row.append(value)
        return row

    def _require_same(
        self, header: Header, used: Mapping[int, int], values: Array, lines: NDArray[np.int64]
    ) -> None:
        """Refuse columns of one name that differ."""
        for first, second in header.same:
            here, there = values[:, used[first]], values[:, used[second]]
            different = np.flatnonzero(~((here == there) | (np.isnan(here) & np.isnan(there))))
            if len(different):
                raise RecordingError(
                    f"{self.source}: line {lines[different[0]]}",
                    f"column {header.names[first]!r} appears twice with different values{WAY_OUT}",
                )

    def _stamps(self, header: Header, times: Array, lines: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the (N,) stamps, ns."""
        assert header.time is not None
        if times.shape[1] == 2:  # seconds and nanoseconds
            return np.asarray(
                times[:, 0].astype(np.int64) * 1_000_000_000 + times[:, 1].astype(np.int64)
            )
        if self._factor is None:
            self._factor = header.time.factor or _factor(times)
        seconds = times[:, 0] * self._factor
        if np.any(np.abs(seconds) > LATEST_TIME):
            worst = int(np.argmax(np.abs(seconds)))
            raise RecordingError(
                f"{self.source}: line {lines[worst]}",
                f"time is {times[worst, 0]:g}, expected seconds; or --columns "
                f"'{header.names[header.time.columns[0]]}=time[ms]', or us, or ns",
            )
        return np.round(seconds * 1e9).astype(np.int64)


def _factor(times: Array) -> float:
    """Return the factor to seconds of times without a unit: those since 1970 are known by size."""
    first, last = _SINCE_1970
    size = float(np.min(times)) if len(times) else 0.0
    factors = (1e-3, 1e-6, 1e-9)
    return next((factor for factor in factors if first < size * factor < last), 1.0)


def _delimiter(head: str, first: str) -> str:
    """Return the delimiter of a header and its first row."""

    def cells(line: str, delimiter: str) -> int:
        if delimiter == " ":
            return len(line.split())
        return len(next(csv.reader([line.rstrip("\r\n")], delimiter=delimiter), []))

    for delimiter in _DELIMITERS:
        count = cells(head, delimiter)
        if count > 1 and (not first or cells(first, delimiter) in (count, count + 1)):
            return delimiter
    return next((delimiter for delimiter in _DELIMITERS if delimiter in head.strip()), ",")


def _is_row(line: str) -> bool:
    """Return whether a line begins like a row: with a number or a date."""
    cell = next((part for part in line.replace(";", ",").replace("\t", ",").split(",")), "")
    cell = cell.strip().strip('"').split(" ")[0]
    return (_number(cell, ",") is not None and cell != "") or _date(cell) is not None


def _number(cell: str, delimiter: str) -> float | None:
    """Return a cell's number, NaN of an empty one, ``None`` where it is none."""
    text = cell.strip().strip('"')
    if not text:
        return np.nan
    if delimiter != ",":
        text = text.replace(",", ".")
    try:
        return None if "_" in text else float(text)
    except ValueError:
        return None


def _date(cell: str) -> float | None:
    """Return s since 1970 of a date and time, in UTC where no zone is given."""
    try:
        found = datetime.fromisoformat(cell.strip().strip('"'))
    except ValueError:
        return None
    return (found if found.tzinfo else found.replace(tzinfo=UTC)).timestamp()


def _echoed(cells: list[str]) -> list[str] | None:
    """Return names for the columns of `ros2 topic echo --csv`, which writes none.

    That is, of a JointState: s, ns, frame, names, and as many positions, velocities and efforts.
    ``None`` if they are something else; ``[]`` if it is not sure which fields were sent.
    """
    is_number = [cell != "" and _number(cell, ",") is not None for cell in cells]
    if len(cells) < 5 or not all(is_number[:2]) or is_number[2] or is_number[3]:
        return None
    joints = [cell for cell, number in zip(cells[3:], is_number[3:], strict=True) if not number]
    n = len(joints)
    values = len(cells) - 3 - n
    if not n or not all(is_number[3 + n :]) or values not in (n, 2 * n, 3 * n):
        return None
    if values == 2 * n:
        return []
    fields = ("position", "velocity", "effort")[: values // n]
    named = [f"{joint}.{quantity}" for quantity in fields for joint in joints]
    return ["header.stamp.sec", "header.stamp.nanosec", "frame_id",
            *(f"name[{k}]" for k in range(n)), *named]  # fmt: skip
