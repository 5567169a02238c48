"""Recordings behind a URL: listed, described and fetched by fsspec, where they are worked on."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path, PurePosixPath
from typing import Any

from dvrk_gravity.errors import RecordingError


def list_matches(pattern: str) -> list[str]:
    """Return the URLs that a pattern matches, sorted.

    Raises:
        RecordingError: No such place, or a protocol that needs a package.
    """
    system, path = _system(pattern)
    try:
        found = system.glob(path) if any(mark in path for mark in "*?[") else [path]
    except Exception as error:  # whatever the protocol's client raises
        raise RecordingError(pattern, _line(error)) from error
    return sorted(system.unstrip_protocol(each) for each in found)


def file_info(url: str) -> tuple[int, datetime | None]:
    """Return size, bytes, and time of modification, where the system keeps one.

    Raises:
        RecordingError: It is not there, or not accessible.
    """
    system, path = _system(url)
    try:
        size = int(system.info(path)["size"] or 0)
    except Exception as error:
        raise RecordingError(url, _line(error)) from error
    try:
        return size, system.modified(path).astimezone(UTC)
    except Exception:  # many protocols have no such time
        return size, None


@contextmanager
def fetch(url: str) -> Iterator[Path]:
    """Give a copy of what is behind a URL, a file of the same name, for as long as it is used.

    Raises:
        RecordingError: It is not there, or the copy breaks off.
    """
    system, path = _system(url)
    with tempfile.TemporaryDirectory(prefix="dvrk_gravity-") as folder:
        target = Path(folder, PurePosixPath(path.rstrip("/")).name)
        try:
            system.get(path, str(target), recursive=system.isdir(path))
        except Exception as error:
            raise RecordingError(url, _line(error)) from error
        yield target


def _system(url: str) -> tuple[Any, str]:
    from fsspec.core import url_to_fs

    try:
        system, path = url_to_fs(url)
    except (ImportError, ValueError) as error:
        raise RecordingError(url, _line(error)) from error
    return system, path


def _line(error: Exception) -> str:
    return f"cannot be read: {error or type(error).__name__}"
