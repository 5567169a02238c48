"""Entries of a YAML file, strictly read: what is wrong with one is said in a line that names it."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from typing import Any

from dvrk_gravity.errors import ConfigError


def mapping(
    where: str, value: Any, known: Sequence[str] | None = None, required: Sequence[str] = ()
) -> Mapping[str, Any]:
    """Return a mapping.

    Args:
        where: Dotted name of the entry; ``""``: the whole file.
        value: What the file has.
        known: Keys that it may have; ``None``: any.
        required: Keys that it must have.

    Raises:
        ConfigError: Something else, an unknown key, or one that is missing.
    """
    if not isinstance(value, Mapping):
        raise ConfigError(where, value, "a mapping")
    for key in value:
        if known is not None and key not in known:
            raise ConfigError(where, key, ", ".join(known))
    for key in required:
        if key not in value:
            raise ConfigError(f"{where}.{key}".lstrip("."), None, "a value")
    return value


def sequence(where: str, value: Any, length: int | None = None) -> list[Any]:
    """Return a list, of a length if one is given, or raise ConfigError."""
    if not isinstance(value, list) or length not in (None, len(value)):
        raise ConfigError(where, value, "a list" if length is None else f"a list of {length}")
    return value


def check_count(where: str, count: int, most: int) -> None:
    """Check that there are not too many of something, before work grows with their square.

    Raises:
        ConfigError: There are more than ``most``.
    """
    if count > most:
        raise ConfigError(where, f"{count} of them", f"at most {most}")


def number(where: str, value: Any, least: float = -math.inf, most: float = math.inf) -> float:
    """Return a finite number within bounds, or raise ConfigError."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not is_number or not abs(value) <= sys.float_info.max:  # an integer may be longer
        raise ConfigError(where, value, "a finite number")
    if not least <= value <= most:
        raise ConfigError(where, value, f"a number from {least:g} to {most:g}")
    return float(value)


def numbers(
    where: str, value: Any, length: int, least: float = -math.inf, most: float = math.inf
) -> list[float]:
    """Return a list of so many finite numbers within bounds, or raise ConfigError."""
    entries = sequence(where, value, length)
    return [number(f"{where}[{k}]", entry, least, most) for k, entry in enumerate(entries)]
