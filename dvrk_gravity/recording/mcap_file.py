"""MCAP files, read by the library ``mcap`` as a stream: a crash leaves out the index at their end.

The records are found here, as heads that say how long each is: the library makes an object of every
message and of every entry of an index, which takes twice as long, and gives nothing of a chunk that
is cut off. Format: https://mcap.dev/spec, version 0.
"""

from __future__ import annotations

import struct
from collections.abc import Collection, Iterator
from io import BytesIO
from operator import itemgetter
from pathlib import Path
from typing import IO

import zstandard
from lz4.frame import LZ4FrameDecompressor  # type: ignore[import-untyped]
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel as McapChannel
from mcap.records import Chunk, Schema
from mcap.stream_reader import get_chunk_data_stream

from dvrk_gravity.recording.bag_file import BagFile, Channel

MAGIC = b"\x89MCAP0\r\n"
# Bytes of a chunk, packed or not. Recorders close one at some 800 kB, after the message that
# exceeds that: an image or a cloud of points recorded beside an arm has up to 30 MB.
LARGEST_CHUNK = 64_000_000
_TOO_LARGE = f"chunk or message that declares more than {LARGEST_CHUNK / 1e6:g} MB"
_DAMAGED = "chunk that cannot be unpacked, or has another size or checksum than it states"
_HEAD = struct.Struct("<BQ")  # of a record: kind, length
_MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, sequence, time of reception, of publication


class McapFile(BagFile):
    """An MCAP file, whole or cut off."""

    def __init__(self, path: Path) -> None:
        """Open the file and list its channels."""
        super().__init__()
        self._types = {0: ""}  # of messages, by the number of their schema
        self._file = path.open("rb")
        try:
            self._list_channels()
        except BaseException:
            self._file.close()
            raise

    def _list_channels(self) -> None:
        """Note the channels of the summary at the file's end, or else of its records."""
        try:
            summary = SeekingReader(self._file, record_size_limit=LARGEST_CHUNK).get_summary()
        except (McapError, OSError, ValueError, struct.error):  # cut off
            summary = None
        if summary is not None:
            for schema in summary.schemas.values():
                self._note_schema(schema)
            for channel in summary.channels.values():
                self._note_channel(channel)
        if not self.channels:
            for _ in self.read(()):
                pass
            self.broken = ""
            self.left_out.clear()

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _messages(self, wanted: Collection[int]) -> Iterator[tuple[int, int, bytes]]:
        """Yield number of the channel, time of reception (ns) and bytes, sorted in each chunk."""
        self._file.seek(len(MAGIC))
        for kind, content, whole in self._records(self._file):
            if whole and kind in (Opcode.DATA_END, Opcode.FOOTER):
                return
            if kind == Opcode.CHUNK:
                inside = self._records(self._unpacked(content, whole))
                found = [self._message(*record, wanted) for record in inside]
                yield from sorted(filter(None, found), key=itemgetter(1))
            elif message := self._message(kind, content, whole, wanted):
                yield message
        self.broken = "has no end: its recorder did not close it, or it was cut off"

    def _records(self, stream: IO[bytes]) -> Iterator[tuple[int, bytes, bool]]:
        """Yield kind and content of each record, and whether it is whole: the last may not be."""
        while len(head := stream.read(_HEAD.size)) == _HEAD.size:
            kind, length = _HEAD.unpack(head)
            if length > LARGEST_CHUNK:
                if kind in (Opcode.CHUNK, Opcode.MESSAGE):  # others are of no use here
                    self.left_out[_TOO_LARGE] += 1
                stream.seek(length, 1)
            else:
                content = stream.read(length)
                yield kind, content, len(content) == length

    def _message(
        self, kind: int, content: bytes, whole: bool, wanted: Collection[int]
    ) -> tuple[int, int, bytes] | None:
        """Return the message that a record is, if it is wanted; note a schema or a channel."""
        if whole and kind == Opcode.MESSAGE:
            channel, _, received, _ = _MESSAGE_HEAD.unpack_from(content)
            return (channel, received, content[_MESSAGE_HEAD.size :]) if channel in wanted else None
        if whole and kind == Opcode.SCHEMA:
            self._note_schema(Schema.read(ReadDataStream(BytesIO(content))))
        elif whole and kind == Opcode.CHANNEL:
            self._note_channel(McapChannel.read(ReadDataStream(BytesIO(content))))
        return None

    def _note_schema(self, schema: Schema) -> None:
        package, _, name = schema.name.partition("/")
        ros1 = name and "/" not in name
        self._types[schema.id] = f"{package}/msg/{name}" if ros1 else schema.name

    def _note_channel(self, channel: McapChannel) -> None:
        msgtype = self._types.get(channel.schema_id, "")
        self.channels[channel.id] = Channel(channel.topic, msgtype, channel.message_encoding)

    def _unpacked(self, content: bytes, whole: bool) -> IO[bytes]:
        """Return the records of a chunk; none if it is damaged, or too large."""
        try:
            chunk = Chunk.read(ReadDataStream(BytesIO(content)))
            if chunk.uncompressed_size > LARGEST_CHUNK:
                self.left_out[_TOO_LARGE] += 1
                return BytesIO()
            if not whole:
                return BytesIO(_beginning(chunk))
            stream, size = get_chunk_data_stream(chunk, validate_crc=True)
            if size == chunk.uncompressed_size:
                return BytesIO(stream.read(size))
        except Exception:  # each compression's library has its own
            if not whole:
                return BytesIO()
        self.left_out[_DAMAGED] += 1
        return BytesIO()


def _beginning(chunk: Chunk) -> bytes:
    """Return what can be unpacked of a chunk that is cut off."""
    found: bytes = chunk.data
    if chunk.compression == "zstd":
        found = zstandard.ZstdDecompressor().decompressobj().decompress(chunk.data)
    elif chunk.compression == "lz4":
        found = LZ4FrameDecompressor().decompress(chunk.data)
    return found
