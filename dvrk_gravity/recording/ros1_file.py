"""ROS 1 bags (version 2.0), read as a stream: one that was not closed needs no reindexing.

Format: http://wiki.ros.org/Bags/Format/2.0.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import NamedTuple

from dvrk_gravity.recording.bag_file import BagFile, BagFileError, Channel, ros2_type
from dvrk_gravity.recording.unpack import (
    LARGEST_CHUNK,
    LARGEST_MESSAGE,
    TOO_LARGE,
    UnpackError,
    too_large,
    unpacked,
)

MAGIC = b"#ROSBAG V"
_VERSION = MAGIC + b"2.0\n"
_MESSAGE, _BAG, _CHUNK, _CONNECTION = 2, 3, 5, 7
_LARGEST_HEADER = 100_000  # bytes; that of a connection holds a topic's name
_U32 = struct.Struct("<I")


class _BagRecord(NamedTuple):
    """A record: fields of its header, first byte of its data, their length."""

    fields: dict[bytes, bytes]
    start: int
    length: int

    @property
    def kind(self) -> int:
        return self.fields.get(b"op", b"\0")[0]

    def number(self, name: bytes) -> int:
        return int.from_bytes(self.fields.get(name, b""), "little")

    @property
    def time(self) -> int:
        """Time of reception, ns."""
        seconds, nanoseconds = struct.unpack("<II", self.fields[b"time"])
        return int(seconds) * 1_000_000_000 + int(nanoseconds)


class Ros1File(BagFile):
    """A ``.bag`` file, whole, unindexed or cut off.

    Raises:
        BagFileError: It is none.
    """

    def __init__(self, path: Path) -> None:
        """Open the file and list its connections."""
        super().__init__()
        self._file = path.open("rb")
        self._size = os.fstat(self._file.fileno()).st_size
        try:
            first = self._file.read(len(_VERSION))
            if first != _VERSION:
                version = first.decode(errors="replace").strip()
                raise BagFileError(f"begins with {version!r}, expected a ROS 1 bag of version 2.0")
            self._list()
        except BaseException:
            self._file.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _list(self) -> None:
        """Find the connections: in the index at the end, else in what there is."""
        head = next(self._records(len(_VERSION)), None)
        index = head.number(b"index_pos") if head and head.kind == _BAG else 0
        for record in self._records(index) if index else ():
            if record.kind == _CONNECTION:
                self._note(record, self._read(record))
        if not self.channels:
            for _ in self.messages(()):
                pass
            self.broken = ""
            self.left_out.clear()

    def _records(self, start: int) -> Iterator[_BagRecord]:
        """Yield the records from a place on, the last one's data perhaps cut off."""
        while start + 4 <= self._size:
            self._file.seek(start)
            (length,) = _U32.unpack(self._file.read(4))
            header = self._file.read(min(length, _LARGEST_HEADER) + 4)
            if len(header) < length + 4:
                return
            (data,) = _U32.unpack_from(header, length)
            start += 8 + length
            yield _BagRecord(_fields(header[:length]), start, data)
            start += data

    def _read(self, record: _BagRecord, most: int = LARGEST_MESSAGE) -> bytes:
        self._file.seek(record.start)
        return self._file.read(min(record.length, most))

    def messages(self, wanted: Collection[int]) -> Iterator[tuple[int, int, bytes]]:
        """Yield number of the connection, time of reception (ns) and bytes, in the file's order."""
        indexed, end = False, 0
        for record in self._records(len(_VERSION)):
            end = record.start + record.length
            if record.kind == _BAG:
                indexed = record.number(b"index_pos") > 0
            elif record.kind == _CHUNK:
                yield from self._chunk(record, wanted)
            elif record.kind in (_CONNECTION, _MESSAGE) and end <= self._size:
                yield from self._one(record, self._read(record), wanted)
        if not indexed or end != self._size:
            self.broken = "has no index: its recorder did not close it, or it was cut off"

    def _one(
        self, record: _BagRecord, data: bytes, wanted: Collection[int]
    ) -> Iterator[tuple[int, int, bytes]]:
        """Yield a record's message, if it is one; remember a connection."""
        if record.kind == _CONNECTION:
            self._note(record, data)
        elif record.kind == _MESSAGE and record.number(b"conn") in wanted:
            if record.length > LARGEST_MESSAGE:
                self.left_out[TOO_LARGE] += 1
            else:
                yield record.number(b"conn"), record.time, data

    def _note(self, record: _BagRecord, data: bytes) -> None:
        topic = record.fields.get(b"topic", b"").decode(errors="replace")
        msgtype = _fields(data).get(b"type", b"").decode(errors="replace")
        channel = Channel(topic, ros2_type(msgtype), "ros1")
        self.channels[record.number(b"conn")] = channel

    def _chunk(
        self, record: _BagRecord, wanted: Collection[int]
    ) -> Iterator[tuple[int, int, bytes]]:
        size = record.number(b"size")
        if max(size, record.length) > LARGEST_CHUNK:
            self.left_out[too_large(max(size, record.length))] += 1
            return
        data = self._read(record, LARGEST_CHUNK)
        kind = record.fields.get(b"compression", b"none").decode(errors="replace")
        try:
            content = unpacked(data, kind, size, len(data) == record.length)
        except UnpackError as error:
            self.left_out[f"chunk that {error}"] += 1
            return
        at, end = 0, len(content)
        while at + 4 <= end:
            (length,) = _U32.unpack_from(content, at)
            start = at + 8 + length
            if start > end:
                return
            (count,) = _U32.unpack_from(content, at + 4 + length)
            inner = _BagRecord(_fields(content[at + 4 : at + 4 + length]), start, count)
            at = start + count
            if at <= end:  # else the file breaks off there
                yield from self._one(inner, content[start:at], wanted)


def _fields(header: bytes) -> dict[bytes, bytes]:
    """Return the fields ``name=value`` of a header."""
    found, at = {}, 0
    while at + 4 <= len(header):
        (length,) = _U32.unpack_from(header, at)
        name, _, value = header[at + 4 : at + 4 + length].partition(b"=")
        found[name] = value
        at += 4 + length
    return found
