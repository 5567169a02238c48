"""Files of named arrays (NumPy's .npz), read without executing any of their content."""

from __future__ import annotations

import io
import math
import re
import struct
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arrays import Array
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import text_file

MAX_BYTES = 20_000_000
"""Of a file, and of the declared sizes of all its arrays. Those of models are 1 MB."""

_MAX_DIRECTORY = 20_000  # bytes, of the list of arrays: an entry takes some seventy

_KIND = "a file of arrays (.npz)"

# The end of a .zip that has no comment, and what precedes it where a second end overrules it.
_END = struct.Struct("<4s8xLLH")
_LOCATOR, _LOCATOR_SIZE = b"PK\x06\x07", 20

# The header that NumPy writes. Its own reader evaluates any text, and reserves any size.
_HEADER = re.compile(
    rb"\x93NUMPY\x01\x00..\{'descr': '([<>|][iuf]\d)', 'fortran_order': (True|False), "
    rb"'shape': \(((?:\d{1,9},? ?){0,4})\), \} *\n",
    re.DOTALL,
)


def write(path: Path, arrays: Mapping[str, NDArray[np.generic]]) -> None:
    """Write arrays by name, whole or not at all; raises ``OSError``."""
    stream = io.BytesIO()
    np.savez_compressed(stream, allow_pickle=False, **arrays)
    text_file.write_bytes(path, stream.getvalue())


def load(path: Path) -> dict[str, Array]:
    """Return the arrays by name, as float64.

    Sizes are checked before anything of that size is read: of the file, of its list of arrays, of
    each unpacked array, and of its declared shape.

    Raises:
        ConfigError: No such file, or another kind of file; it names the file.
    """
    try:
        if not text_file.is_file(path):
            raise ConfigError("", "something else", _KIND, path)
        with path.open("rb") as stream:
            _check_ends(stream, path)
            with zipfile.ZipFile(stream) as archive:
                members = archive.infolist()
                if sum(member.file_size for member in members) > MAX_BYTES:
                    raise _too_large("arrays", path)
                found = {}
                for member in members:
                    name = member.filename.removesuffix(".npy")
                    # Other compressions reserve any size that the file asks for.
                    if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                        raise ConfigError(name, "an array packed in another way", _KIND, path)
                    found[name] = _array(name, archive.read(member), path)
                return found
    except OSError as error:
        raise ConfigError("", error.strerror, f"a readable {_KIND[2:]}", path) from error
    except (EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise ConfigError("", "a truncated or damaged file", _KIND, path) from error
    except (RuntimeError, ValueError) as error:  # a password, a name that is no text
        raise ConfigError("", "something else", _KIND, path) from error


def _check_ends(stream: BinaryIO, path: Path) -> None:
    """Refuse a file that is too large, or whose list of arrays would be."""
    begin = stream.read(4)
    size = stream.seek(0, io.SEEK_END)
    if size > MAX_BYTES:
        raise _too_large("file", path)
    stream.seek(max(size - _END.size - _LOCATOR_SIZE, 0))
    before, end = (tail := stream.read())[: -_END.size], tail[-_END.size :]
    if not (end.startswith(b"PK\x05\x06") and len(end) == _END.size):
        what = "a truncated file" if begin in (b"", b"PK\x03\x04") else "something else"
        raise ConfigError("", what, _KIND, path)
    _, directory, _, comment = _END.unpack(end)
    if directory > _MAX_DIRECTORY or comment or before.startswith(_LOCATOR):
        raise _too_large("list of arrays", path)


def _too_large(what: str, path: Path) -> ConfigError:
    return ConfigError("", f"a larger {what}", f"at most {MAX_BYTES} bytes of arrays (.npz)", path)


def _array(name: str, content: bytes, path: Path) -> Array:
    header = _HEADER.match(content)
    if header is None:
        raise ConfigError(name, "something else", "real numbers", path)
    dtype = np.dtype(header[1].decode())
    shape = tuple(int(length) for length in re.findall(rb"\d+", header[3]))
    declared, there = math.prod(shape) * dtype.itemsize, len(content) - header.end()
    if declared != there:
        raise ConfigError(name, f"{there} bytes", f"the {declared} of its shape {shape}", path)
    flat = np.frombuffer(content, dtype, offset=header.end()).astype(float)
    return flat.reshape(shape, order="F" if header[2] == b"True" else "C")
