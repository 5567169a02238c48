"""The sqlite3 files of a rosbag2, also as a crash leaves them.

A database is a program as well: a view or a virtual table computes its rows, and pages that name
each other as their children have no end. Only columns that are stored in tables are read, within
bounds.
"""

from __future__ import annotations

import shutil
import sqlite3
import tempfile
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote

from dvrk_gravity.recording.bag_file import (
    LARGEST_CHUNK,
    LARGEST_MESSAGE,
    LONGEST_NAME,
    MOST_CHANNELS,
    TOO_LARGE,
    BagFile,
    BagFileError,
    Channel,
)

MAGIC = b"SQLite format 3\0"
# SQLite keeps the last changes, or how to undo them, beside a file while it writes.
_BESIDE = ("-wal", "-journal")
_COLUMNS = {
    "topics": ("id", "name", "type", "serialization_format"),
    "messages": ("topic_id", "timestamp", "data"),
}
_FUNCTIONS = ("length", "typeof")
# Instructions of SQLite's machine between two looks at Ctrl-C: some ms.
_STEPS = 100_000
# Instructions of one reading: so many, and so many for each byte of the file. A row takes 20 of
# either at most.
_MOST_STEPS, _STEPS_PER_BYTE = 30_000_000, 2


class SqliteFile(BagFile):
    """A ``.db3`` file.

    Raises:
        BagFileError: It is none, or too damaged to list its topics.
    """

    def __init__(self, path: Path, size: int) -> None:
        """Open the file and list its topics."""
        super().__init__(size)
        self._steps, self._most_steps = 0, _MOST_STEPS + _STEPS_PER_BYTE * size
        self._interrupted: BaseException | None = None
        self._folder: str | None = None
        self._name = path.name
        beside = [path.with_name(path.name + end) for end in _BESIDE]
        if any(file.is_file() and file.stat().st_size for file in beside):
            # Read with them, in a copy: SQLite would write the changes into the original.
            self._folder = tempfile.mkdtemp(prefix="dvrk_gravity-")
            for file in (path, *beside):
                if file.is_file():
                    shutil.copy(file, self._folder)
            uri = quote(str(Path(self._folder, path.name)))
        else:
            uri = f"{quote(str(path.absolute()))}?mode=ro&immutable=1"
        try:
            self._connection = sqlite3.connect(f"file:{uri}", uri=True)
            self._connection.text_factory = lambda raw: raw.decode(errors="replace")
            # A file that is cut off has fewer pages than it says: read those that are there.
            self._connection.execute("PRAGMA writable_schema=ON")
            self._connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LARGEST_CHUNK)
            self._connection.set_progress_handler(self._count_steps, _STEPS)
            for table, columns in _COLUMNS.items():
                self._require_stored(table, columns)
            self._connection.set_authorizer(_stored_columns_alone)
            self._list_topics()
        except sqlite3.Error as error:
            self.close()
            raise BagFileError(self._why(error)) from error
        except BaseException:
            self.close()
            raise

    def _count_steps(self) -> bool:
        """Return whether SQLite is to end: of itself after enough steps, or at Ctrl-C."""
        try:
            self._steps += _STEPS
            return self._steps > self._most_steps
        except BaseException as error:  # SQLite would go on without it
            self._interrupted = error
            return True

    def _why(self, error: sqlite3.Error) -> str:
        """Return what ended a reading; raise what interrupted it."""
        if getattr(error, "sqlite_errorcode", 0) != sqlite3.SQLITE_INTERRUPT:
            return str(error)
        if self._steps > self._most_steps:
            return f"its {self.allowance.size} bytes take SQLite more than {self._steps} steps"
        raise self._interrupted or KeyboardInterrupt

    def _require_stored(self, table: str, columns: Collection[str]) -> None:
        """Raise ``BagFileError`` for what is no table, or whose columns are computed."""
        kinds = {row[2] for row in self._connection.execute(f"PRAGMA table_list({table})")}
        if kinds and kinds != {"table"}:
            raise BagFileError(f"its {table} are a {', '.join(kinds)}, expected a table")
        for _, name, *_, hidden in self._connection.execute(f"PRAGMA table_xinfo({table})"):
            if name in columns and hidden:
                raise BagFileError(f"{table}.{name} is computed, expected a stored column")

    def _list_topics(self) -> None:
        """Note the topics."""
        shown = ", ".join(
            f"CASE WHEN length({name}) <= ? THEN {name} END" for name in _COLUMNS["topics"][1:]
        )
        query = f"SELECT id, {shown} FROM topics LIMIT {MOST_CHANNELS + 1}"
        limits = (LONGEST_NAME,) * len(_COLUMNS["topics"][1:])
        for number, *texts in self._connection.execute(query, limits):
            if not all(isinstance(text, str) for text in texts):
                raise BagFileError(
                    "a topic's name, type or format is no text of at most "
                    f"{LONGEST_NAME} characters"
                )
            self.add_channel(number, Channel(*texts))

    def close(self) -> None:
        """Close the file; remove its copy."""
        if hasattr(self, "_connection"):
            self._connection.close()
        if self._folder:
            shutil.rmtree(self._folder, ignore_errors=True)

    def messages(self, wanted: Collection[Any]) -> Iterator[tuple[Any, Any, Any]]:
        """Yield topic, time of reception and bytes, in the order in which they were written."""
        marks = ",".join("?" * len(wanted))
        query = (
            "SELECT topic_id, CASE WHEN typeof(timestamp) IN ('integer', 'real') THEN timestamp "
            "ELSE typeof(timestamp) END, CASE WHEN length(data) <= ? THEN data END, length(data) "
            f"FROM messages WHERE topic_id IN ({marks})"
        )
        self._steps = 0
        try:
            for number, received, data, size in self._connection.execute(
                query, (LARGEST_MESSAGE, *wanted)
            ):
                self.allowance.record()
                if data is None and isinstance(size, int):
                    self.leave_out(TOO_LARGE)
                else:
                    # Pages that are each other's children hold the same message many times.
                    self.allowance.unpack(size if isinstance(size, int) else 0)
                    yield number, received, data
        except sqlite3.Error as error:
            self.broken = (
                f"is damaged ({self._why(error)}; `sqlite3 {self._name} .recover | sqlite3 "
                "new.db3` may recover what is there)"
            )


def _stored_columns_alone(
    action: int, first: str | None, second: str | None, _: str | None, within: str | None
) -> int:
    """Return whether SQLite may do what a query needs; see ``Connection.set_authorizer``.

    Args:
        action: What it is about to do.
        first: The table that it reads.
        second: The column, or the function.
        within: The view or the trigger that asks for it; ``None``: the query itself.
    """
    if within is None and action == sqlite3.SQLITE_SELECT:
        return sqlite3.SQLITE_OK
    if within is None and action == sqlite3.SQLITE_READ and first in _COLUMNS:
        return sqlite3.SQLITE_OK
    if within is None and action == sqlite3.SQLITE_FUNCTION and second in _FUNCTIONS:
        return sqlite3.SQLITE_OK
    return sqlite3.SQLITE_DENY
