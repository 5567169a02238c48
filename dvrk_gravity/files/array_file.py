"""Files of named arrays (NumPy's .npz), read without running anything that they hold."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import text_file

Array = NDArray[np.float64]

MAX_BYTES = 100_000_000


def write(path: Path, arrays: Mapping[str, NDArray[np.generic]]) -> None:
    """Write arrays by name, whole or not at all.

    Raises:
        OSError: The file cannot be written.
    """
    stream = io.BytesIO()
    np.savez_compressed(stream, allow_pickle=False, **arrays)
    text_file.write_bytes(path, stream.getvalue())


def load(path: Path) -> dict[str, Array]:
    """Return the arrays by name, as numbers.

    Raises:
        ConfigError: No such file, or one of something else; it names the file.
    """
    try:
        if not text_file.is_file(path) or path.stat().st_size > MAX_BYTES:
            raise ConfigError("", "something else", "a file of arrays (.npz)", path)
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as found:
            return {name: _real(name, found[name], path) for name in found.files}
    except OSError as error:
        raise ConfigError("", error.strerror, "a readable file of arrays (.npz)", path) from error
    except (EOFError, zipfile.BadZipFile) as error:
        raise ConfigError("", "a truncated file", "a file of arrays (.npz)", path) from error
    except (ValueError, TypeError, AttributeError) as error:
        raise ConfigError("", "something else", "a file of arrays (.npz)", path) from error


def _real(name: str, array: NDArray[np.generic], path: Path) -> Array:
    # NumPy reads texts and dates as numbers, too, and takes the real part of complex ones.
    if array.dtype.kind not in "iuf":
        raise ConfigError(name, str(array.dtype), "real numbers", path)
    return np.asarray(array, dtype=float)
