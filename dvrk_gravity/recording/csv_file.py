"""Recordings as CSV: one row a sample, read as many programs write it; written in SI units.

Written columns: ``time`` (s; absent: static poses), ``<joint>.position``, ``<joint>.velocity``,
``<joint>.effort``, and ``direction`` or ``<joint>.direction`` (+1/-1). Numbers are written with the
fewest digits that read back to the same float64.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.recording.csv_columns import Columns, read_columns
from dvrk_gravity.recording.csv_rows import RowReader
from dvrk_gravity.recording.samples import CHUNK, QUANTITIES, Coordinates, Samples, TimeBase
from dvrk_gravity.recording.table import Assembly


def iterate_csv(
    path: str | Path,
    coordinates: Coordinates = "joint",
    chunk: int = CHUNK,
    arm: Arm | None = None,
    columns: Columns | None = None,
    time_base: TimeBase = "stamp",
) -> Iterator[Samples]:
    """Yield a CSV file as samples, about ``chunk`` at a time, times relative to its first row.

    What is left out is counted (``repeated``, ``notes``).

    Args:
        path: The file.
        coordinates: What its columns are.
        chunk: Rows read at a time.
        arm: Whose joints are read; ``None``: those that the header names.
        columns: What columns are, see :func:`~dvrk_gravity.recording.csv_columns.read_columns`.
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
            yield from assembly.samples(reader.tables(chunk))
    except UnicodeDecodeError as error:
        raise RecordingError(source, "is not a text file, expected CSV") from error
    except OSError as error:
        raise RecordingError(source, f"cannot be read: {error.strerror or error}") from error


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
