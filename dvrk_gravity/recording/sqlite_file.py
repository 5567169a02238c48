"""The sqlite3 files of a rosbag2, also as a crash leaves them."""

from __future__ import annotations

import shutil
import sqlite3
import tempfile
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote

from dvrk_gravity.recording.bag_file import (
    LARGEST_MESSAGE,
    TOO_LARGE,
    BagFile,
    BagFileError,
    Channel,
)

MAGIC = b"SQLite format 3\0"
# SQLite keeps the last changes, or how to undo them, beside a file while it writes.
_BESIDE = ("-wal", "-journal")


class SqliteFile(BagFile):
    """A ``.db3`` file.

    Raises:
        BagFileError: It is none, or too damaged to list its topics.
    """

    def __init__(self, path: Path) -> None:
        """Open the file and list its topics."""
        super().__init__()
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
            for number, topic, kind, encoding in self._connection.execute(
                "SELECT id, name, type, serialization_format FROM topics"
            ):
                texts = (topic, kind, encoding)
                if not all(isinstance(text, str) for text in texts):
                    raise BagFileError("a topic's name, type or format is no text")
                self.channels[number] = Channel(*texts)
        except sqlite3.Error as error:
            self.close()
            raise BagFileError(str(error)) from error
        except BaseException:
            self.close()
            raise

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
            "SELECT topic_id, timestamp, CASE WHEN length(data) <= ? THEN data END, length(data) "
            f"FROM messages WHERE topic_id IN ({marks})"
        )
        try:
            for number, received, data, size in self._connection.execute(
                query, (LARGEST_MESSAGE, *wanted)
            ):
                if data is None and isinstance(size, int):
                    self.left_out[TOO_LARGE] += 1
                else:
                    yield number, received, data
        except sqlite3.Error as error:
            self.broken = (
                f"is damaged ({error}; `sqlite3 {self._name} .recover | sqlite3 new.db3` may "
                "recover what is there)"
            )
