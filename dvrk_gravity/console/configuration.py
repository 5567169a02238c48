"""The console's other files: those of consoles, systems and arms, which name calibration files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import json_file

# In an arm's file, up to dVRK 2.3 and since 2.4.
KEYS = ("gravity-compensation", "gravity_compensation")
# Files that lead to each other. Chosen: a console with its arms has ten.
_MOST_FILES = 100
# What is in files of arms, consoles and systems, and in no calibration file.
_OTHERS = ("kinematic", "arms", "arm_collections", "io", "teleops", *KEYS)


def refuse_configuration(document: Mapping[str, Any], path: Path) -> None:
    """Refuse a configuration of the console, naming the calibration files that it leads to.

    Args:
        document: A file's content.
        path: The file; those that it names are looked for beside it, as the console does.

    Raises:
        ConfigError: It is such a configuration.
    """
    found = dict.fromkeys(_calibration_files(document, path.parent, {path.name}))
    wanted = "a calibration, gc-<ARM>-<serial number>.json"
    if found:
        raise ConfigError("", "a configuration", f"{wanted}: it names {', '.join(found)}", path)
    if any(key in document for key in _OTHERS):
        none = f"{wanted} (this names none: {KEYS[1]} in the file of an arm does)"
        raise ConfigError("", "a configuration", none, path)


def _calibration_files(content: Any, folder: Path, seen: set[str]) -> Iterator[str]:
    """Yield the calibration files that a configuration names, itself or by other files."""
    if isinstance(content, list):
        for item in content:
            yield from _calibration_files(item, folder, seen)
    if not isinstance(content, Mapping):
        return
    for key, value in content.items():
        if not isinstance(value, str):
            yield from _calibration_files(value, folder, seen)
        elif key in KEYS:
            other_file = folder / value
            yield str(other_file) if other_file.is_file() else value
        elif (
            value.endswith(".json")
            and value not in seen
            and len(seen) < _MOST_FILES
            and (folder / value).is_file()
        ):
            seen.add(value)
            try:
                other = json_file.load(folder / value)
            except ConfigError:  # the console looks at it, not we
                continue
            yield from _calibration_files(other, folder, seen)
