"""Small text files, read and written whole: one clear line for whatever is wrong with one."""

from __future__ import annotations

import errno
import os
import stat
import tempfile
from pathlib import Path

from dvrk_gravity.errors import ConfigError

# Model, arm, mechanism and calibration files are a few kB; a file far larger is a mistake.
MAX_BYTES = 1_000_000


def is_file(path: str | Path) -> bool:
    """Return whether a path is no pipe and no device: opening one may wait for ever.

    Raises:
        OSError: It does not exist or is not accessible. Folders are left to the caller.
    """
    mode = os.stat(path).st_mode
    return stat.S_ISREG(mode) or stat.S_ISDIR(mode)


def read(path: str | Path, kind: str) -> str:
    """Return the text in a file.

    Args:
        path: The file.
        kind: Expected content (``YAML``, ``JSON``), for the messages.

    Raises:
        ConfigError: No such file, not readable, too large, or not text in UTF-8.
    """
    try:
        if not is_file(path):
            raise ConfigError("", "a pipe or device", f"a {kind} file", path)
        with open(path, "rb") as stream:
            raw = stream.read(MAX_BYTES + 1)
        if len(raw) > MAX_BYTES:
            raise ConfigError("", "a larger file", f"at most {MAX_BYTES} bytes of {kind}", path)
        return raw.decode("utf-8-sig")
    except FileNotFoundError as error:
        raise ConfigError("", "no such file", f"an existing {kind} file", path) from error
    except IsADirectoryError as error:
        raise ConfigError("", "a folder", f"a {kind} file", path) from error
    except UnicodeDecodeError as error:
        raise ConfigError("", "binary data", f"{kind} text in UTF-8", path) from error
    except OSError as error:
        raise ConfigError("", error.strerror, f"a readable {kind} file", path) from error
    except ValueError as error:  # a name that no file can have
        raise ConfigError("", str(error), f"the name of a {kind} file", path) from error


def write(path: str | Path, text: str, wait: bool = True) -> None:
    """Write a text in UTF-8, whole or not at all; see :func:`write_bytes`."""
    write_bytes(path, text.encode(), wait)


def write_bytes(path: str | Path, content: bytes, wait: bool = True) -> None:
    """Write a file whole or not at all: to a temporary name beside it, then moved.

    Args:
        path: The file.
        content: All of it.
        wait: Until the disk has it, which a busy one may take a second for. If not, a killed
            process loses nothing either, but a power cut may.

    Raises:
        OSError: The folder does not exist, is not writable, or is full; it names ``path``.
    """
    target = Path(path)
    if target.exists() and not target.is_file():
        raise OSError(errno.EEXIST, "is a folder or a device, no file", str(target))
    temporary = ""
    try:
        handle, temporary = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.")
        with os.fdopen(handle, "wb") as stream:
            stream.write(content)
            stream.flush()
            if wait:
                os.fsync(stream.fileno())
        os.chmod(temporary, 0o644)
        os.replace(temporary, target)
    except BaseException as error:
        if temporary:
            Path(temporary).unlink(missing_ok=True)
        if isinstance(error, OSError):  # of the file that was asked for, and not of two
            raise OSError(error.errno, error.strerror, str(target)) from error
        raise
