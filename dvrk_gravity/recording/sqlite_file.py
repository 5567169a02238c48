"""The sqlite3 files of a rosbag2, also as a crash leaves them.

``rosbags`` reads them too, but without what a killed recorder left beside them, and sorted by time.
"""

from __future__ import annotations

import shutil
import sqlite3
import tempfile
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote

from dvrk_gravity.recording.bag_file import BagFile, Channel

MAGIC = b"SQLite format 3\0"
# SQLite keeps the last changes, or how to undo them, beside a file while it writes.
_BESIDE = ("-wal", "-journal")


class SqliteFile(BagFile):
    """A ``.db3`` file."""

    def __init__(self, path: Path) -> None:
        """Open the file and list its topics."""
        super().__init__()
        self._folder: str | None = None
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
        self._connection = sqlite3.connect(f"file:{uri}", uri=True)
        self._connection.text_factory = lambda raw: raw.decode(errors="replace")
        try:
            query = "SELECT id, name, type, serialization_format FROM topics"
            for number, *texts in self._connection.execute(query):
                self.channels[number] = Channel(*map(str, texts))
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the file; remove its copy."""
        self._connection.close()
        if self._folder:
            shutil.rmtree(self._folder, ignore_errors=True)

    def _messages(self, wanted: Collection[Any]) -> Iterator[tuple[Any, Any, Any]]:
        """Yield topic, time of reception and bytes, in the order in which they were written."""
        marks = ",".join("?" * len(wanted))
        query = f"SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN ({marks})"
        yield from self._connection.execute(query, tuple(wanted))
