"""Files of arrays: what they declare is checked before anything of that size is read."""

from __future__ import annotations

import struct
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import array_file

GOOD = {"a": np.arange(6.0).reshape(2, 3), "b/c": np.float32([[1.5], [2.5]]), "d": np.array(3)}


def npy(header: str, data: bytes = b"", version: tuple[int, int] = (1, 0)) -> bytes:
    """Return an array's file with any header."""
    length = struct.pack("<H" if version == (1, 0) else "<I", len(header))
    return b"\x93NUMPY" + bytes(version) + length + header.encode("latin1") + data


def declared(shape: str, data: bytes = b"\0" * 8, descr: str = "'<f8'") -> bytes:
    return npy(f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}\n", data)


def archive(path: Path, method: int = zipfile.ZIP_DEFLATED, **members: bytes) -> None:
    with zipfile.ZipFile(path, "w", method) as zipped:
        for name, content in members.items():
            zipped.writestr(f"{name}.npy", content)


def encrypted(path: Path) -> None:
    archive(path, a=declared("(1,)"))
    content = bytearray(path.read_bytes())
    content[content.rindex(b"PK\x01\x02") + 8] |= 1
    path.write_bytes(content)


def holding(content: bytes, method: int = zipfile.ZIP_DEFLATED) -> Callable[[Path], None]:
    return lambda path: archive(path, method, a=content)


BAD = {
    "1e11 numbers": holding(declared("(100000000000,)")),
    "a password": encrypted,
    "another packing": holding(declared("(1,)"), zipfile.ZIP_LZMA),
    "objects": holding(declared("(1,)", descr="'|O'")),
    "more than declared": holding(declared("(1,)", b"\0" * 16)),
    "a shape that is no shape": holding(declared("'long'")),
    "a header of 4 GB": holding(b"\x93NUMPY\x02\x00\xff\xff\xff\xff{"),
    "a nested header": holding(npy("(" * 9000)),
    "an archive in the archive": holding(b"PK\x05\x06" + b"\0" * 18),
}  # fmt: skip


def test_what_declares_too_much_or_nonsense_is_refused_in_one_line(tmp_path):
    for number, (case, write) in enumerate(BAD.items()):
        path = tmp_path / f"{number}.npz"
        write(path)
        with pytest.raises(ConfigError) as caught:
            array_file.load(path)
        text = str(caught.value)
        assert text.startswith(str(path)), case
        assert "expected" in text, case
        assert "\n" not in text, case


def test_arrays_are_read_as_they_were_written(tmp_path):
    array_file.write(tmp_path / "some.npz", GOOD | {"e": np.asfortranarray(GOOD["a"])})
    again = array_file.load(tmp_path / "some.npz")
    assert list(again) == ["a", "b/c", "d", "e"]
    for name, array in GOOD.items():
        np.testing.assert_array_equal(again[name], array)
    np.testing.assert_array_equal(again["e"], GOOD["a"])
    assert {array.dtype for array in again.values()} == {np.dtype(float)}
    again["a"][0] = 7.0  # and may be changed
