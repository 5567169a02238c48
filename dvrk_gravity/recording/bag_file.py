"""What files of bags have in common: channels, messages, and bounded unpacking of their parts."""

from __future__ import annotations

import bz2
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from backports import zstd
from lz4.frame import LZ4FrameDecompressor  # type: ignore[import-untyped]

from dvrk_gravity.errors import printable

# A JointState of 7 joints takes 400 bytes, of 1000 joints 60 kB.
LARGEST_MESSAGE = 1_000_000
# Bytes of a chunk, packed or not. Recorders close one at some 800 kB, after the message that
# exceeds that: an image or a cloud of points recorded beside an arm has up to 30 MB.
LARGEST_CHUNK = 64_000_000
TOO_LARGE = f"message of more than {LARGEST_MESSAGE} bytes"
# Of topics, and of what else has one in a file: MCAP counts channels with 16 bits, and ROS's names
# have at most 255 characters.
MOST_CHANNELS, LONGEST_NAME = 65_536, 1000
_MOST_KINDS = 20  # of unreadable parts that are counted apart. Chosen: a screen
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
_BLOCK = 1_000_000  # bytes unpacked at a time


class BagFileError(Exception):
    """A file of a bag of which nothing can be read."""


class UnpackError(ValueError):
    """Bytes that cannot be unpacked: unknown compression, damage, or not the declared size."""


@dataclass
class Allowance:
    """What reading a file once may take: a file of 13 kB can unpack to days of work.

    Attributes:
        size: Of the file as it lies on the disk, bytes.
        unpacked: Bytes that were unpacked so far.
        records: Records that were read so far.
    """

    size: int
    unpacked: int = 0
    records: int = 0

    # A chunk, and so many bytes of each byte of the file. Noiseless JointStates of an arm at rest
    # are packed to a thirtieth (their index alone takes 16 bytes a message). Chosen: far beyond.
    PER_BYTE = 1000
    # Records beside one a byte: no record of a recorder takes less than that, packed.
    RECORDS = 1_000_000

    def unpack(self, count: int) -> None:
        """Count unpacked bytes; raise ``BagFileError`` if they are too many for the file."""
        self.unpacked += count
        if self.unpacked > (most := LARGEST_CHUNK + self.PER_BYTE * self.size):
            raise BagFileError(
                f"its {self.size} bytes unpack to more than {most / 1e6:.4g} MB, expected at most "
                f"{self.PER_BYTE} times as many and {LARGEST_CHUNK / 1e6:g} MB"
            )

    def record(self, count: int = 1) -> None:
        """Count records; raise ``BagFileError`` if they are too many for the file."""
        self.records += count
        if self.records > (most := self.RECORDS + self.size):
            raise BagFileError(f"has more than {most} records in its {self.size} bytes")


@dataclass(frozen=True)
class Channel:
    """One source of messages in a file.

    Attributes:
        topic: Its name.
        msgtype: Message type, as ROS 2 writes it.
        encoding: Of its messages: ``cdr``, ``ros1`` or another.
    """

    topic: str
    msgtype: str
    encoding: str

    def __post_init__(self) -> None:
        """Make the names printable."""
        for name in ("topic", "msgtype", "encoding"):
            object.__setattr__(self, name, printable(getattr(self, name)))


class BagFile(ABC):
    """A file of a bag, read from its beginning to where it ends or breaks off.

    Attributes:
        channels: By their number in the file.
        broken: Where and why it breaks off; ``""``: it does not.
        left_out: Numbers of unreadable parts, by what is wrong with them.
        allowance: What the present reading took.
    """

    def __init__(self, size: int) -> None:
        """Begin with nothing found; ``size`` of what lies on the disk, packed, bytes."""
        self.channels: dict[Any, Channel] = {}
        self.broken = ""
        self.left_out: Counter[str] = Counter()
        self.allowance = Allowance(size)

    def add_channel(self, number: Any, channel: Channel) -> None:
        """Remember a channel; raise ``BagFileError`` if there are too many."""
        self.channels[number] = channel
        if len(self.channels) > MOST_CHANNELS:
            raise BagFileError(f"has more than {MOST_CHANNELS} topics")

    def leave_out(self, what: str) -> None:
        """Count an unreadable part by what is wrong with it."""
        known = what in self.left_out or len(self.left_out) < _MOST_KINDS
        self.left_out[what if known else "part with another fault"] += 1

    def read(self, wanted: Collection[Any]) -> Iterator[tuple[Any, Any, Any]]:
        """Yield the messages of some channels, from the beginning, within a new allowance."""
        self.allowance = Allowance(self.allowance.size)
        return self.messages(wanted)

    @abstractmethod
    def messages(self, wanted: Collection[Any]) -> Iterator[tuple[Any, Any, Any]]:
        """Yield number of the channel, time of reception (ns) and bytes of some channels."""

    @abstractmethod
    def close(self) -> None:
        """Close the file."""


def ros2_type(name: str) -> str:
    """Return a message type as ROS 2 writes it: ``package/msg/Name``."""
    package, _, rest = name.partition("/")
    return name if not rest or "/" in rest else f"{package}/msg/{rest}"


class Decompressor(Protocol):
    """The interface that the compressors' libraries share."""

    eof: bool

    def decompress(self, data: bytes, max_length: int = -1) -> bytes:
        """Return at most that many bytes."""
        ...


def _decompressor(kind: str) -> Decompressor:
    made: dict[str, Any] = {
        "zstd": zstd.ZstdDecompressor,
        "lz4": LZ4FrameDecompressor,
        "bz2": bz2.BZ2Decompressor,
    }
    if kind not in made:
        raise UnpackError(f"is compressed by {kind[:40]!r}, expected {', '.join(made)} or none")
    found: Decompressor = made[kind]()
    return found


def _decompressed(unpack: Decompressor, data: bytes, most: int, allowance: Allowance) -> bytes:
    """Return at most one byte more than ``most``, unpacked in blocks: Ctrl-C waits for a call."""
    parts, left = [], most + 1
    while left > 0 and not unpack.eof:
        try:
            part = unpack.decompress(data, min(left, _BLOCK))
        except Exception as error:  # each library has its own
            raise UnpackError(f"cannot be unpacked: {error}") from error
        if not part and not data:
            break
        allowance.unpack(len(part))
        parts.append(part)
        data, left = b"", left - len(part)
    return b"".join(parts)


def unpacked(data: bytes, kind: str, size: int, allowance: Allowance, whole: bool = True) -> bytes:
    """Return unpacked bytes.

    Args:
        data: Packed bytes.
        kind: ``zstd``, ``lz4``, ``bz2``; ``""`` or ``none``: not packed.
        size: Declared size, or the largest that is accepted where ``whole`` is false.
        allowance: Of the file.
        whole: Whether they must have exactly that size; else a beginning will do.

    Raises:
        UnpackError: They cannot be unpacked, or have another size.
        BagFileError: They are too many for the file.
    """
    found = data
    if kind not in ("", "none"):
        found = _decompressed(_decompressor(kind), data, size, allowance)
    if len(found) > size or (whole and len(found) != size):
        raise UnpackError(f"unpacks to another size than the {size} bytes that it declares")
    return found


def unpacked_message(data: bytes, allowance: Allowance) -> bytes:
    """Return a message that may have been compressed by itself.

    Raises:
        UnpackError: It cannot be unpacked, or is larger than any JointState.
        BagFileError: The messages so far are too many bytes for the file.
    """
    if not data.startswith(ZSTD_MAGIC):
        return data
    unpack = _decompressor("zstd")
    found = _decompressed(unpack, data, LARGEST_MESSAGE, allowance)
    if len(found) > LARGEST_MESSAGE or not unpack.eof:
        raise UnpackError(f"unpacks to more than {LARGEST_MESSAGE} bytes")
    return found


def unpack_file(packed: Path, target: Path, most: int) -> bool:
    """Unpack a file that was compressed by zstd as a whole; return whether it is complete.

    Raises:
        UnpackError: It would take more than ``most`` bytes.
        BagFileError: It unpacks to too much for its size.
        OSError: It cannot be read or written.
    """
    allowance = Allowance(packed.stat().st_size)
    with zstd.open(packed, "rb") as source, target.open("wb") as file:
        while True:
            try:
                part = source.read(_BLOCK)
            except (EOFError, zstd.ZstdError):
                return False
            if not part:
                return True
            allowance.unpack(len(part))
            if allowance.unpacked > most:
                raise UnpackError(f"unpacks to more than {most / 1e9:.3g} GB")
            file.write(part)
