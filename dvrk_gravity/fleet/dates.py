"""When a recording was made, and how that is known."""

from __future__ import annotations

import re
from datetime import UTC, datetime
from pathlib import Path, PurePosixPath
from typing import Literal

from dvrk_gravity.errors import DvrkGravityError
from dvrk_gravity.recording import BagReader, is_bag

DateFrom = Literal["bag", "time column", "name", "modified"]
"""The stamp of a bag's first message; a csv's times, if they are of a clock; the date in the name
of the file or of a folder that it is in; when the file was last modified."""

# 2025-03-14, 20250314, 2025_03_14-09_26_53, rosbag2's 2025_03_14-09_26_53, 20250314T092653.
_DATE = re.compile(
    r"(?<!\d)(20\d\d)([-_.]?)(0[1-9]|1[0-2])\2(0[1-9]|[12]\d|3[01])"
    r"(?:[-_T ]?([01]\d|2[0-3])[-_:.h]?([0-5]\d)[-_:.m]?([0-5]\d))?(?!\d)"
)
_EARLIEST = datetime(2000, 1, 1, tzinfo=UTC).timestamp()  # stamps before are a robot's own clock
_LATEST = datetime(2100, 1, 1, tzinfo=UTC).timestamp()


def date_of(path: Path) -> tuple[datetime, DateFrom]:
    """Return when a recording began, in UTC, and where that is from: the first that there is."""
    if is_bag(path):
        if (stamp := _first_message(path)) is not None:
            return stamp, "bag"
    elif (stamp := _first_time(path)) is not None:
        return stamp, "time column"
    named = date_in(str(path))
    if named is not None:
        return named, "name"
    return datetime.fromtimestamp(path.stat().st_mtime, UTC), "modified"


def date_in(name: str) -> datetime | None:
    """Return the date in a path, as UTC: the last one, of the file rather than of its folder."""
    for part in reversed(PurePosixPath(name).parts):
        for match in reversed(list(_DATE.finditer(part))):
            year, _, month, day, *clock = match.groups()
            try:
                hour, minute, second = (int(number or 0) for number in clock)
                return datetime(int(year), int(month), int(day), hour, minute, second, tzinfo=UTC)
            except ValueError:  # the 31st of June
                continue
    return None


def _first_message(path: Path) -> datetime | None:
    try:
        with BagReader(path) as bag:
            for _, received, _ in bag.raw(*bag.topics):
                return _plausible(received * 1e-9)
    except DvrkGravityError:  # the work unit says what is wrong with it
        return None
    return None


def _first_time(path: Path) -> datetime | None:
    """Return the first number under a header that names a time, if it is one of a clock."""
    with path.open("rb") as stream:
        head = stream.readline(100_000).decode("utf-8", "replace").strip()
        first = stream.readline(100_000).decode("utf-8", "replace").strip()
    separator = next((each for each in (",", ";", "\t") if each in head), " ")
    names = [name.strip(' "').lower() for name in head.split(separator)]
    for name, value in zip(names, first.split(separator), strict=False):
        if re.match(r"time|t\b|stamp", name):
            try:
                seconds = float(value)
            except ValueError:
                continue
            return next(
                (date for unit in (1.0, 1e-3, 1e-9) if (date := _plausible(seconds * unit))), None
            )
    return None


def _plausible(seconds: float) -> datetime | None:
    if not _EARLIEST < seconds < _LATEST:
        return None
    return datetime.fromtimestamp(seconds, UTC)
