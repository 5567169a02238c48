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

# A JointState of 7 joints takes 400 bytes, of 1000 joints 60 kB.
LARGEST_MESSAGE = 1_000_000
# Bytes of a chunk, packed or not. Recorders close one at some 800 kB, after the message that
# exceeds that: an image or a cloud of points recorded beside an arm has up to 30 MB.
LARGEST_CHUNK = 64_000_000
TOO_LARGE = f"message of more than {LARGEST_MESSAGE} bytes"
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
_BLOCK = 1_000_000  # bytes unpacked at a time


class BagFileError(Exception):
    """A file of a bag of which nothing can be read."""


class UnpackError(ValueError):
    """Bytes that cannot be unpacked: unknown compression, damage, or not the declared size."""


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


class BagFile(ABC):
    """A file of a bag, read from its beginning to where it ends or breaks off.

    Attributes:
        channels: By their number in the file.
        broken: Where and why it breaks off; ``""``: it does not.
        left_out: Numbers of unreadable parts, by what is wrong with them.
    """

    def __init__(self) -> None:
        """Begin with nothing found."""
        self.channels: dict[Any, Channel] = {}
        self.broken = ""
        self.left_out: Counter[str] = Counter()

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


def _decompressed(unpack: Decompressor, data: bytes, most: int) -> bytes:
    try:
        return unpack.decompress(data, most + 1)
    except Exception as error:  # each library has its own
        raise UnpackError(f"cannot be unpacked: {error}") from error


def unpacked(data: bytes, kind: str, size: int, whole: bool = True) -> bytes:
    """Return unpacked bytes.

    Args:
        data: Packed bytes.
        kind: ``zstd``, ``lz4``, ``bz2``; ``""`` or ``none``: not packed.
        size: Declared size, or the largest that is accepted where ``whole`` is false.
        whole: Whether they must have exactly that size; else a beginning will do.

    Raises:
        UnpackError: They cannot be unpacked, or have another size.
    """
    found = data
    if kind not in ("", "none"):
        found = _decompressed(_decompressor(kind), data, size)
    if len(found) > size or (whole and len(found) != size):
        raise UnpackError(f"unpacks to another size than the {size} bytes that it declares")
    return found


def unpacked_message(data: bytes) -> bytes:
    """Return a message that may have been compressed by itself.

    Raises:
        UnpackError: It cannot be unpacked, or is larger than any JointState.
    """
    if not data.startswith(ZSTD_MAGIC):
        return data
    unpack = _decompressor("zstd")
    found = _decompressed(unpack, data, LARGEST_MESSAGE)
    if len(found) > LARGEST_MESSAGE or not unpack.eof:
        raise UnpackError(f"unpacks to more than {LARGEST_MESSAGE} bytes")
    return found


def unpack_file(packed: Path, target: Path, most: int) -> bool:
    """Unpack a file that was compressed by zstd as a whole; return whether it is complete.

    Raises:
        UnpackError: It would take more than ``most`` bytes.
        OSError: It cannot be read or written.
    """
    written = 0
    with zstd.open(packed, "rb") as source, target.open("wb") as file:
        while True:
            try:
                part = source.read(_BLOCK)
            except (EOFError, zstd.ZstdError):
                return False
            if not part:
                return True
            written += len(part)
            if written > most:
                raise UnpackError(f"unpacks to more than {most / 1e9:.3g} GB")
            file.write(part)
