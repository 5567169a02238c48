"""MCAP files, read as a stream: the index at their end, which a crash leaves out, is not needed.

Format: https://mcap.dev/spec, version 0.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import NamedTuple
from zlib import crc32

from dvrk_gravity.recording.bag_file import BagFile, BagFileError, Channel, ros2_type
from dvrk_gravity.recording.unpack import (
    LARGEST_CHUNK,
    LARGEST_MESSAGE,
    TOO_LARGE,
    UnpackError,
    too_large,
    unpacked,
)

MAGIC = b"\x89MCAP0\r\n"
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _DATA_END = 0x02, 0x03, 0x04, 0x05, 0x06, 0x0F
_HEAD = struct.Struct("<BQ")  # of a record: kind, length
_MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, sequence, time of reception, of publication
_CHUNK_HEAD = struct.Struct("<QQQII")  # first and last time, size, checksum, length of a name
_LONGEST_NAME = 100  # of a compression
_TAIL = _HEAD.size + 20 + len(MAGIC)  # footer and magic


class _McapRecord(NamedTuple):
    """A record, or what is there of one: kind, first byte, declared length, bytes there are."""

    kind: int
    start: int
    length: int
    there: int


class McapFile(BagFile):
    """An MCAP file, whole or cut off.

    Raises:
        BagFileError: It is none.
    """

    def __init__(self, path: Path) -> None:
        """Open the file and list its channels."""
        super().__init__()
        self._schemas: dict[int, str] = {0: ""}
        self._file = path.open("rb")
        self._size = os.fstat(self._file.fileno()).st_size
        try:
            if self._file.read(len(MAGIC)) != MAGIC:
                raise BagFileError("does not begin like an MCAP file")
            self._list()
        except BaseException:
            self._file.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _list(self) -> None:
        """Find the channels: in the summary at the end, else in what there is."""
        start = self._summary()
        for record in self._records(start) if start else ():
            if record.kind in (_SCHEMA, _CHANNEL):
                self._note(record.kind, self._read(record))
        if not self.channels:
            for _ in self.messages(()):
                pass
            self.broken = ""
            self.left_out.clear()

    def _summary(self) -> int:
        """Return where the summary begins; 0: there is none."""
        if self._size < len(MAGIC) + _TAIL:
            return 0
        self._file.seek(self._size - _TAIL)
        tail = self._file.read(_TAIL)
        kind, length = _HEAD.unpack_from(tail)
        (start,) = struct.unpack_from("<Q", tail, _HEAD.size)
        sound = kind == _FOOTER and length == 20 and tail.endswith(MAGIC)
        return int(start) if sound and start <= self._size - _TAIL else 0

    def _records(self, start: int) -> Iterator[_McapRecord]:
        """Yield the records from a place on, the last one perhaps cut off."""
        while start + _HEAD.size <= self._size:
            self._file.seek(start)
            kind, length = _HEAD.unpack(self._file.read(_HEAD.size))
            start += _HEAD.size
            yield _McapRecord(kind, start, length, min(length, self._size - start))
            start += length

    def _read(self, record: _McapRecord, most: int = LARGEST_MESSAGE) -> bytes:
        """Return what there is of a record, no more than so many bytes."""
        self._file.seek(record.start)
        return self._file.read(min(record.there, most))

    def messages(self, wanted: Collection[int]) -> Iterator[tuple[int, int, bytes]]:
        """Yield number of the channel, time of reception (ns) and bytes, in the file's order."""
        for record in self._records(len(MAGIC)):
            cut = record.there < record.length
            if record.kind in (_DATA_END, _FOOTER) and not cut:
                return
            if record.kind == _CHUNK:
                yield from self._chunk(record, wanted)
            elif cut:
                break
            elif record.kind == _MESSAGE and record.length > LARGEST_MESSAGE:
                self.left_out[TOO_LARGE] += 1
            elif record.kind in (_SCHEMA, _CHANNEL, _MESSAGE):
                content = self._read(record)
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
            self.channels[number] = Channel(topic, msgtype, encoding)

    def _chunk(
        self, record: _McapRecord, wanted: Collection[int]
    ) -> Iterator[tuple[int, int, bytes]]:
        """Yield the messages of a chunk, sorted by their time of reception."""
        head = self._read(record, _CHUNK_HEAD.size + _LONGEST_NAME + 8)
        if len(head) < _CHUNK_HEAD.size:
            return
        _, _, size, checksum, name = _CHUNK_HEAD.unpack_from(head)
        at = _CHUNK_HEAD.size + name + 8
        if name > _LONGEST_NAME or len(head) < at:
            return
        kind = head[_CHUNK_HEAD.size : at - 8].decode(errors="replace")
        (packed,) = struct.unpack_from("<Q", head, at - 8)
        if max(size, packed) > LARGEST_CHUNK:
            self.left_out[too_large(max(size, packed))] += 1
            return
        self._file.seek(record.start + at)
        data = self._file.read(packed)
        whole = len(data) == packed
        try:
            content = unpacked(data, kind, size, whole)
        except UnpackError as error:
            self.left_out[f"chunk that {error}"] += 1
            return
        if whole and checksum and crc32(content) != checksum:
            self.left_out["chunk of another checksum than it states"] += 1
            return
        yield from sorted(self._inside(content, wanted), key=lambda message: message[1])

    def _inside(self, content: bytes, wanted: Collection[int]) -> Iterator[tuple[int, int, bytes]]:
        at, end = 0, len(content)
        while at + _HEAD.size <= end:
            kind, length = _HEAD.unpack_from(content, at)
            at += _HEAD.size
            if at + length > end:  # the file breaks off there
                return
            if kind == _MESSAGE:
                channel, _, received, _ = _MESSAGE_HEAD.unpack_from(content, at)
                if channel in wanted:
                    if length > LARGEST_MESSAGE:
                        self.left_out[TOO_LARGE] += 1
                    else:
                        yield channel, received, content[at + _MESSAGE_HEAD.size : at + length]
            elif kind in (_SCHEMA, _CHANNEL):
                self._note(kind, content[at : at + length])
            at += length


def _text(content: bytes, at: int) -> tuple[str, int]:
    """Return a text and where it ends."""
    (length,) = struct.unpack_from("<I", content, at)
    at += 4
    if at + length > len(content):
        raise BagFileError(f"a text of {length} bytes at byte {at} of {len(content)}")
    return content[at : at + length].decode(errors="replace"), at + length
