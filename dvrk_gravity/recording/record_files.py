"""MCAP files and ROS 1 bags, read as streams of records.

The index at their end, which a crash leaves out, is not needed. Formats: https://mcap.dev/spec,
version 0; http://wiki.ros.org/Bags/Format/2.0.
"""

from __future__ import annotations

import os
import struct
from abc import abstractmethod
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import NamedTuple
from zlib import crc32

from dvrk_gravity.recording.bag_file import (
    LARGEST_CHUNK,
    LARGEST_MESSAGE,
    LONGEST_NAME,
    TOO_LARGE,
    BagFile,
    BagFileError,
    Channel,
    UnpackError,
    ros2_type,
    unpacked,
)

MCAP_MAGIC = b"\x89MCAP0\r\n"
ROS1_MAGIC = b"#ROSBAG V"
_U32 = struct.Struct("<I")


class RecordFile(BagFile):
    """A file that is a sequence of records, whole or cut off.

    Raises:
        BagFileError: It is none.
    """

    def __init__(self, path: Path, size: int) -> None:
        """Open the file and list its channels: from its index, else from its records."""
        super().__init__(size)
        self._file = path.open("rb")
        self._size = os.fstat(self._file.fileno()).st_size
        try:
            self._read_index()
            if not self.channels:
                for _ in self.read(()):
                    pass
                self.broken = ""
                self.left_out.clear()
        except BaseException:
            self._file.close()
            raise

    @abstractmethod
    def _read_index(self) -> None:
        """Check the file's beginning, and note the channels in its index, if it has one."""

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _read(self, start: int, length: int) -> bytes:
        """Return as many bytes as there are, of a message at most."""
        self._file.seek(start)
        return self._file.read(min(length, LARGEST_MESSAGE))

    def _unpacked_chunk(self, start: int, packed: int, kind: str, size: int) -> tuple[bytes, bool]:
        """Return the content of a chunk, empty if it cannot be read, and whether it is complete."""
        declared = max(size, packed)
        if declared > LARGEST_CHUNK:
            self.leave_out(
                f"chunk that declares {declared / 1e6:.4g} MB "
                f"(at most {LARGEST_CHUNK / 1e6:g} are read)"
            )
            return b"", False
        self._file.seek(start)
        data = self._file.read(packed)
        whole = len(data) == packed
        try:
            return unpacked(data, kind, size, self.allowance, whole), whole
        except UnpackError as error:
            self.leave_out(f"chunk that {error}")
            return b"", False


_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _DATA_END = 0x02, 0x03, 0x04, 0x05, 0x06, 0x0F
_HEAD = struct.Struct("<BQ")  # of a record: kind, length
_MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, sequence, time of reception, of publication
_CHUNK_HEAD = struct.Struct("<QQQII")  # first and last time, size, checksum, length of a name
_LONGEST_NAME = 100  # of a compression
_TAIL = _HEAD.size + 20 + len(MCAP_MAGIC)  # footer and magic


class _McapRecord(NamedTuple):
    """A record, perhaps cut off: kind, first byte, declared length, available bytes."""

    kind: int
    start: int
    length: int
    there: int


class McapFile(RecordFile):
    """An MCAP file."""

    def _read_index(self) -> None:
        self._schemas: dict[int, str] = {0: ""}
        if self._file.read(len(MCAP_MAGIC)) != MCAP_MAGIC:
            raise BagFileError("does not begin like an MCAP file")
        start = self._summary()
        for record in self._records(start) if start else ():
            if record.kind in (_SCHEMA, _CHANNEL):
                self._note(record.kind, self._read(record.start, record.there))

    def _summary(self) -> int:
        """Return where the summary begins; 0: there is none."""
        if self._size < len(MCAP_MAGIC) + _TAIL:
            return 0
        tail = self._read(self._size - _TAIL, _TAIL)
        kind, length = _HEAD.unpack_from(tail)
        (start,) = struct.unpack_from("<Q", tail, _HEAD.size)
        sound = kind == _FOOTER and length == 20 and tail.endswith(MCAP_MAGIC)
        return int(start) if sound and start <= self._size - _TAIL else 0

    def _records(self, start: int) -> Iterator[_McapRecord]:
        while start + _HEAD.size <= self._size:
            self.allowance.record()
            self._file.seek(start)
            kind, length = _HEAD.unpack(self._file.read(_HEAD.size))
            start += _HEAD.size
            yield _McapRecord(kind, start, length, min(length, self._size - start))
            start += length

    def messages(self, wanted: Collection[int]) -> Iterator[tuple[int, int, bytes]]:
        """Yield number of the channel, time of reception (ns) and bytes, in the file's order."""
        for record in self._records(len(MCAP_MAGIC)):
            cut = record.there < record.length
            if record.kind in (_DATA_END, _FOOTER) and not cut:
                return
            if record.kind == _CHUNK:
                yield from self._chunk(record, wanted)
            elif cut:
                break
            elif record.kind == _MESSAGE and record.length > LARGEST_MESSAGE:
                self.leave_out(TOO_LARGE)
            elif record.kind in (_SCHEMA, _CHANNEL, _MESSAGE):
                content = self._read(record.start, record.there)
                if record.kind == _MESSAGE:
                    channel, _, received, _ = _MESSAGE_HEAD.unpack_from(content)
                    if channel in wanted:
                        yield channel, received, content[_MESSAGE_HEAD.size :]
                else:
                    self._note(record.kind, content)
        self.broken = "has no end: its recorder did not close it, or it was cut off"

    def _note(self, kind: int, content: bytes) -> None:
        """Remember a schema or a channel."""
        (number,) = struct.unpack_from("<H", content)
        if kind == _SCHEMA:
            self._schemas[number] = _text(content, 2)[0]
        else:
            (schema,) = struct.unpack_from("<H", content, 2)
            topic, at = _text(content, 4)
            encoding, _ = _text(content, at)
            msgtype = ros2_type(self._schemas.get(schema, ""))
            self.add_channel(number, Channel(topic, msgtype, encoding))

    def _chunk(
        self, record: _McapRecord, wanted: Collection[int]
    ) -> Iterator[tuple[int, int, bytes]]:
        """Yield the messages of a chunk, sorted by their time of reception."""
        head = self._read(record.start, min(record.there, _CHUNK_HEAD.size + _LONGEST_NAME + 8))
        if len(head) < _CHUNK_HEAD.size:
            return
        _, _, size, checksum, name = _CHUNK_HEAD.unpack_from(head)
        at = _CHUNK_HEAD.size + name + 8
        if name > _LONGEST_NAME or len(head) < at:
            return
        kind = head[_CHUNK_HEAD.size : at - 8].decode(errors="replace")
        (packed,) = struct.unpack_from("<Q", head, at - 8)
        content, whole = self._unpacked_chunk(record.start + at, packed, kind, size)
        if whole and checksum and crc32(content) != checksum:
            self.leave_out("chunk of another checksum than it states")
            return
        yield from sorted(self._inside(content, wanted), key=lambda message: message[1])

    def _inside(self, content: bytes, wanted: Collection[int]) -> Iterator[tuple[int, int, bytes]]:
        at, end = 0, len(content)
        while at + _HEAD.size <= end:
            self.allowance.record()
            kind, length = _HEAD.unpack_from(content, at)
            at += _HEAD.size
            if at + length > end:  # the file breaks off there
                return
            if kind == _MESSAGE:
                channel, _, received, _ = _MESSAGE_HEAD.unpack_from(content, at)
                if channel in wanted:
                    if length > LARGEST_MESSAGE:
                        self.leave_out(TOO_LARGE)
                    else:
                        yield channel, received, content[at + _MESSAGE_HEAD.size : at + length]
            elif kind in (_SCHEMA, _CHANNEL):
                self._note(kind, content[at : at + length])
            at += length


def _text(content: bytes, at: int) -> tuple[str, int]:
    """Return a text and where it ends."""
    (length,) = _U32.unpack_from(content, at)
    at += 4
    if length > LONGEST_NAME or at + length > len(content):
        raise BagFileError(f"a name of {length} bytes at byte {at} of {len(content)}")
    return content[at : at + length].decode(errors="replace"), at + length


_VERSION = ROS1_MAGIC + b"2.0\n"
_ROS1_MESSAGE, _ROS1_BAG, _ROS1_CHUNK, _ROS1_CONNECTION = 2, 3, 5, 7
_LARGEST_HEADER = 100_000  # bytes; that of a connection holds a topic's name
_MOST_FIELDS = 50  # of a header: those of connections have eight


class _BagRecord(NamedTuple):
    """A record: fields of its header, first byte of its data, their length."""

    fields: dict[bytes, bytes]
    start: int
    length: int

    @property
    def kind(self) -> int:
        return self.fields.get(b"op", b"\0")[0]

    def number(self, name: bytes) -> int:
        return int.from_bytes(self.fields.get(name, b"")[:8], "little")

    @property
    def time(self) -> int:
        """Time of reception, ns."""
        seconds, nanoseconds = struct.unpack("<II", self.fields[b"time"])
        return int(seconds) * 1_000_000_000 + int(nanoseconds)


class Ros1File(RecordFile):
    """A ROS 1 ``.bag`` file; one that was not closed needs no reindexing."""

    def _read_index(self) -> None:
        first = self._file.read(len(_VERSION))
        if first != _VERSION:
            version = first.decode(errors="replace").strip()
            raise BagFileError(f"begins with {version!r}, expected a ROS 1 bag of version 2.0")
        head = next(self._records(len(_VERSION)), None)
        index = head.number(b"index_pos") if head and head.kind == _ROS1_BAG else 0
        for record in self._records(index) if index else ():
            if record.kind == _ROS1_CONNECTION:
                self._note(record, self._read(record.start, record.length))

    def _records(self, start: int) -> Iterator[_BagRecord]:
        """Yield the records from a place on, the last one's data perhaps cut off."""
        while start + 4 <= self._size:
            self.allowance.record()
            self._file.seek(start)
            (length,) = _U32.unpack(self._file.read(4))
            header = self._file.read(min(length, _LARGEST_HEADER) + 4)
            if len(header) < length + 4:
                return
            (data,) = _U32.unpack_from(header, length)
            start += 8 + length
            yield _BagRecord(_fields(header[:length]), start, data)
            start += data

    def messages(self, wanted: Collection[int]) -> Iterator[tuple[int, int, bytes]]:
        """Yield number of the connection, time of reception (ns) and bytes, in the file's order."""
        indexed, end = False, 0
        for record in self._records(len(_VERSION)):
            end = record.start + record.length
            if record.kind == _ROS1_BAG:
                indexed = record.number(b"index_pos") > 0
            elif record.kind == _ROS1_CHUNK:
                yield from self._chunk(record, wanted)
            elif record.kind in (_ROS1_CONNECTION, _ROS1_MESSAGE) and end <= self._size:
                yield from self._message(record, self._read(record.start, record.length), wanted)
        if not indexed or end != self._size:
            self.broken = "has no index: its recorder did not close it, or it was cut off"

    def _message(
        self, record: _BagRecord, data: bytes, wanted: Collection[int]
    ) -> Iterator[tuple[int, int, bytes]]:
        """Yield a record's message, if it is one; remember a connection."""
        if record.kind == _ROS1_CONNECTION:
            self._note(record, data)
        elif record.kind == _ROS1_MESSAGE and record.number(b"conn") in wanted:
            if record.length > LARGEST_MESSAGE:
                self.leave_out(TOO_LARGE)
            else:
                yield record.number(b"conn"), record.time, data

    def _note(self, record: _BagRecord, data: bytes) -> None:
        topic = record.fields.get(b"topic", b"")[:LONGEST_NAME].decode(errors="replace")
        msgtype = _fields(data).get(b"type", b"")[:LONGEST_NAME].decode(errors="replace")
        channel = Channel(topic, ros2_type(msgtype), "ros1")
        self.add_channel(record.number(b"conn"), channel)

    def _chunk(
        self, record: _BagRecord, wanted: Collection[int]
    ) -> Iterator[tuple[int, int, bytes]]:
        kind = record.fields.get(b"compression", b"none").decode(errors="replace")
        size = record.number(b"size")
        content, _ = self._unpacked_chunk(record.start, record.length, kind, size)
        at, end = 0, len(content)
        while at + 4 <= end:
            self.allowance.record()
            (length,) = _U32.unpack_from(content, at)
            start = at + 8 + length
            if length > _LARGEST_HEADER or start > end:
                return
            (count,) = _U32.unpack_from(content, at + 4 + length)
            inner = _BagRecord(_fields(content[at + 4 : at + 4 + length]), start, count)
            at = start + count
            if at <= end:  # else the file breaks off there
                yield from self._message(inner, content[start:at], wanted)


def _fields(header: bytes) -> dict[bytes, bytes]:
    """Return the fields ``name=value`` of a header."""
    found: dict[bytes, bytes] = {}
    at = 0
    for _ in range(_MOST_FIELDS):
        if at + 4 > len(header):
            break
        (length,) = _U32.unpack_from(header, at)
        name, _, value = header[at + 4 : at + 4 + length].partition(b"=")
        found[name] = value
        at += 4 + length
    return found
