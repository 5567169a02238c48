"""One process at a time in a folder."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from dvrk_gravity.errors import ConfigError


@contextmanager
def lock_folder(folder: Path, option: str) -> Iterator[None]:
    """Lock a folder; the system unlocks it when the process ends, for whatever reason.

    Args:
        folder: It exists.
        option: The option that names it.

    Raises:
        ConfigError: Another process has locked it.
    """
    handle = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            expected = "one that no other process is writing: wait for its end, or use another name"
            raise ConfigError(option, str(folder), expected) from None
        except OSError:  # a network's disk without locks
            pass
        yield
    finally:
        os.close(handle)
