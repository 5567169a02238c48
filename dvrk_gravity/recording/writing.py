"""Writing recordings: rosbag2 (sqlite3, mcap, without ROS) and CSV, complete or not at all.

CSV columns: ``time`` (s; absent: static poses), ``<joint>.position``, ``<joint>.velocity``,
``<joint>.effort``, and ``direction`` or ``<joint>.direction`` (+1/-1), in SI units. Numbers have
the fewest digits that read back to the same float64.
"""

from __future__ import annotations

import logging
import os
import shutil
import tempfile
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any, TextIO

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.recording.bag import SUFFIXES
from dvrk_gravity.recording.cdr import JOINT_STATE, CdrError, encode_joint_state, typestore
from dvrk_gravity.recording.samples import Samples, Storage, converted

URI_MARKS = "?#%"  # the library opens sqlite3 files by URI and does not quote these
COMMIT_INTERVAL = 1.0  # s; what a killed process loses at most of a sqlite3 bag
# A stamp of 0 marks invalid data, so a recording without an absolute time starts at 1 s.
DEFAULT_START_NS = 1_000_000_000
# Names that would promise something else than the folder of a bag.
FOREIGN_SUFFIXES = (".json", ".yaml", ".yml", ".txt", ".tsv")

_log = logging.getLogger(__name__)


class BagWriter:
    """A new rosbag2 that appears under its name only when complete (context manager).

    Until then it lies in ``<path>.partial-…/<name>``. If an exception ends the ``with`` block, the
    partial bag is closed so that it can be read, and stays there; the log says where.

    Attributes:
        path: Folder of the bag.
        partial: Folder in which it is being written.
        count: Messages written so far.
    """

    def __init__(
        self, path: str | Path, storage: Storage = "sqlite3", keep_partial: bool = True
    ) -> None:
        """Store the arguments; nothing is created before ``with``.

        Args:
            path: Folder of the bag; must not exist.
            storage: ``"sqlite3"`` (survives a kill up to the last second) or ``"mcap"``.
            keep_partial: Keep the partial bag when an exception ends the block.

        Raises:
            RecordingError: If the storage is unknown, or cannot be under such a path.
        """
        if storage not in ("sqlite3", "mcap"):
            raise RecordingError(path, f"storage {storage!r}, expected 'sqlite3' or 'mcap'")
        if storage == "sqlite3" and any(mark in str(path) for mark in URI_MARKS):
            raise RecordingError(
                path, f"expected a path without any of {URI_MARKS} for sqlite3, or mcap"
            )
        self.path = Path(path)
        self.partial = Path()
        self.count = 0
        self._storage = storage
        self._keep_partial = keep_partial

    def __enter__(self) -> BagWriter:
        """Create the partial bag; raise ``RecordingError`` if the target exists or cannot be."""
        from rosbags.rosbag2 import StoragePlugin, Writer

        if self.path.exists():
            raise RecordingError(self.path, "exists already, expected a new name")
        try:
            self._temporary = Path(
                tempfile.mkdtemp(prefix=f"{self.path.name}.partial-", dir=self.path.parent)
            )
        except OSError as error:
            raise self._failed(error) from error
        # The folder's name is also the name of the file in it: it must be the final one.
        self.partial = self._temporary / self.path.name
        plugin = StoragePlugin.MCAP if self._storage == "mcap" else StoragePlugin.SQLITE3
        self._writer = Writer(self.partial, version=9, storage_plugin=plugin)
        self._connections: dict[str, Any] = {}
        self._last_commit = time.monotonic()
        try:
            self._writer.open()
            self._hurry()
        except Exception as error:
            shutil.rmtree(self._temporary, ignore_errors=True)
            raise self._failed(error) from error
        return self

    def _failed(self, error: Exception) -> RecordingError:
        text = getattr(error, "strerror", None) or str(error) or type(error).__name__
        kept = f"; what was written is in {self.partial}" if self.count else ""
        return RecordingError(self.path, f"cannot be written: {text}{kept}")

    def add_topic(self, topic: str, msgtype: str) -> None:
        """Announce a topic (``/MTMR/measured_js``), so that it is in the bag without messages, too.

        Raises:
            RecordingError: If the type is unknown, or the topic has another one already.
        """
        known = self._connections.get(topic)
        if known is not None:
            if known.msgtype != msgtype:
                raise RecordingError(
                    self.path, f"topic {topic} is {known.msgtype}, expected it to stay so"
                )
            return
        if msgtype not in typestore().fielddefs:
            raise RecordingError(self.path, f"message type {msgtype!r} of {topic} is not known")
        self._connections[topic] = self._writer.add_connection(
            topic, msgtype, typestore=typestore()
        )

    def write(self, topic: str, msgtype: str, message: Any, receive_ns: int) -> None:
        """Write one message: CDR bytes or a ``rosbags`` object of its type, received at ns.

        Raises:
            RecordingError: If the type is unknown, the message is not of it, or the disk refuses.
        """
        self.add_topic(topic, msgtype)
        data = message
        if not isinstance(message, bytes | bytearray | memoryview):
            try:
                data = typestore().serialize_cdr(message, msgtype)
            except Exception as error:
                raise RecordingError(
                    self.path, f"a message for {topic} is not a {msgtype}: {error}"
                ) from error
        try:
            self._writer.write(self._connections[topic], receive_ns, bytes(data))
            if time.monotonic() - self._last_commit > COMMIT_INTERVAL:
                self._commit()
        except Exception as error:
            raise self._failed(error) from error
        self.count += 1

    def _hurry(self) -> None:
        """Let sqlite3 not wait for the disk, which may take a second: whoever records may drive."""
        from rosbags.rosbag2.storage_sqlite3 import Sqlite3Writer

        if isinstance(self._writer.storage, Sqlite3Writer):
            self._writer.storage.conn.execute("PRAGMA synchronous = OFF")

    def flush(self) -> None:
        """Let a killed process lose none of the messages until now.

        Raises:
            RecordingError: The disk refuses.
        """
        try:
            self._commit()
        except Exception as error:
            raise self._failed(error) from error

    def _commit(self) -> None:
        """Put sqlite3's pending messages on disk, as the library does only at the end."""
        from rosbags.rosbag2.storage_sqlite3 import Sqlite3Writer

        if isinstance(self._writer.storage, Sqlite3Writer):
            self._writer.storage.conn.commit()
        self._last_commit = time.monotonic()

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Complete the bag and give it its name, or close the partial one and log where it is."""
        if error is not None and (not self._keep_partial or not self.count):
            self._writer.abort()
            shutil.rmtree(self._temporary, ignore_errors=True)
            return
        try:
            self._writer.close()
            if error is None:
                _settle(self.partial)
                os.rename(self.partial, self.path)
                self._temporary.rmdir()
        except Exception as failure:
            self._writer.abort()
            if error is None:
                raise self._failed(failure) from failure
            _log.warning("%s: could not be completed: %s", self.partial, failure)
        if error is not None:
            _log.warning("%s: cut short; what was written is in %s", self.path, self.partial)


def _settle(folder: Path) -> None:
    """Wait until the disk has a folder's files."""
    for path in folder.iterdir():
        with path.open("rb") as file:
            os.fsync(file.fileno())


def write_bag(
    parts: Iterable[Samples],
    path: str | Path,
    storage: Storage = "sqlite3",
    topic: str = "/measured_js",
) -> None:
    """Write consecutive parts of one recording as JointStates, complete or not at all.

    The receive time of each message is its stamp.

    Raises:
        RecordingError: If the target exists or cannot be written, or a part has no time or has
            directions, neither of which JointState can carry.
    """
    with BagWriter(path, storage, keep_partial=False) as bag:
        bag.add_topic(topic, JOINT_STATE)
        for part in parts:
            if part.time is None or part.direction is not None:
                raise RecordingError(
                    part.source, "static poses and directions do not fit in a bag, expected CSV"
                )
            start = part.start_ns if part.start_ns > 0 else DEFAULT_START_NS
            stamps = (start + np.round(part.time * 1e9).astype(np.int64)).tolist()
            empty: list[tuple[float, ...]] = [()] * len(part)
            columns = (
                empty if values is None else values.tolist()
                for values in (part.position, part.velocity, part.effort)
            )
            for stamp, *values in zip(stamps, *columns, strict=True):
                try:
                    data = encode_joint_state(stamp, part.joints, *values)
                except CdrError as error:
                    raise RecordingError(part.source, str(error)) from error
                bag.write(topic, JOINT_STATE, data, stamp)


@contextmanager
def new_file(path: str | Path) -> Iterator[TextIO]:
    """Open a new text file that appears under its name only when complete."""
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
            table = columns(part)
            names = list(table)
            if not header:
                header = names
                file.write(",".join(header) + "\n")
            elif names != header:
                raise RecordingError(part.source, "columns change within the recording")
            rows = np.column_stack(list(table.values())).tolist()
            file.writelines(",".join(map(repr, row)) + "\n" for row in rows)
        if not header:
            raise RecordingError(path, "nothing to write")


def columns(part: Samples) -> dict[str, Array]:
    """Return the columns of a file by name."""
    found: dict[str, Array] = {}
    for quantity, array in part.arrays().items():
        if quantity == "direction" and np.all(array == array[:, :1]):
            array = array[:, 0]
        if array.ndim == 1:
            found[quantity] = array
        else:
            found |= {f"{joint}.{quantity}": array[:, k] for k, joint in enumerate(part.joints)}
    return found


def save_recording(
    parts: Iterable[Samples], path: str | Path, storage: Storage, topic: str
) -> None:
    """Write consecutive parts of one recording; see ``Recording.save``.

    Efforts are written as the arm reads them: a file holds no drive gains.
    """
    parts = (
        replace(part, effort=converted(part.effort, part.position, part.joints, part.arm, None))
        for part in parts
    )
    if Path(path).suffix.lower() == ".csv":
        write_csv(parts, path)
    elif Path(path).name.endswith((*SUFFIXES, *FOREIGN_SUFFIXES)):
        raise RecordingError(path, "expected a .csv file or the name of a new rosbag2 folder")
    else:
        write_bag(parts, path, storage, topic)
