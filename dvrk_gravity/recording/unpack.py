"""Compressed parts of bags, unpacked no further than their declared, limited size."""

from __future__ import annotations

import bz2
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
COPIED = 1_000_000  # bytes at a time


class UnpackError(ValueError):
    """What cannot be unpacked: of an unknown kind, damaged, or of another size than declared."""


def too_large(size: int) -> str:
    """Return what is wrong with a chunk that declares to be larger than any that is read."""
    return f"chunk that declares {size / 1e6:.4g} MB (at most {LARGEST_CHUNK / 1e6:g} are read)"


class Decompressor(Protocol):
    """What the compressors' libraries share."""

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


def unpacked(data: bytes, kind: str, size: int, whole: bool = True) -> bytes:
    """Return what some bytes hold.

    Args:
        data: Packed bytes.
        kind: ``zstd``, ``lz4``, ``bz2``; ``""`` or ``none``: as they are.
        size: Declared size, or the largest that is accepted where ``whole`` is false.
        whole: Whether they must be of just that size; else a beginning will do.

    Raises:
        UnpackError: They cannot be unpacked, or are of another size.
    """
    if kind in ("", "none"):
        found = data
    else:
        unpack = _decompressor(kind)
        try:
            found = unpack.decompress(data, size + 1)
        except Exception as error:  # each library has its own
            raise UnpackError(f"cannot be unpacked: {error}") from error
    if len(found) > size or (whole and len(found) != size):
        raise UnpackError(f"unpacks to another size than the {size} bytes that it declares")
    return found


def message(data: bytes) -> bytes:
    """Return a message that may have been compressed by itself.

    Raises:
        UnpackError: It cannot be unpacked, or is larger than any JointState.
    """
    if not data.startswith(ZSTD_MAGIC):
        return data
    unpack = _decompressor("zstd")
    try:
        found = unpack.decompress(data, LARGEST_MESSAGE + 1)
    except Exception as error:
        raise UnpackError(f"cannot be unpacked: {error}") from error
    if len(found) > LARGEST_MESSAGE or not unpack.eof:
        raise UnpackError(f"unpacks to more than {LARGEST_MESSAGE} bytes")
    return found


def unpack_file(packed: Path, target: Path, most: int) -> bool:
    """Unpack a file that was compressed by zstd as a whole; return whether to its end.

    Raises:
        UnpackError: It would take more than ``most`` bytes.
        OSError: It cannot be read or written.
    """
    written = 0
    with zstd.open(packed, "rb") as source, target.open("wb") as file:
        while True:
            try:
                part = source.read(COPIED)
            except (EOFError, zstd.ZstdError):
                return False
            if not part:
                return True
            written += len(part)
            if written > most:
                raise UnpackError(f"unpacks to more than {most / 1e9:.3g} GB")
            file.write(part)
