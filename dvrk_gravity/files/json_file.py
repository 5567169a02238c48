"""Read JSON files strictly: one clear line for whatever is wrong with one."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, NoReturn

from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import text_file

MAX_DEPTH = 20


def load(path: str | Path, finite: bool = True) -> dict[str, Any]:
    """Return the object in a JSON file.

    Args:
        path: The file.
        finite: Refuse NaN and infinite numbers; else they are taken, for whoever checks them.

    Raises:
        ConfigError: No such file, too large, not text, or not as :func:`loads` wants it.
    """
    text = text_file.read(path, "JSON")
    try:
        return loads(text, finite)
    except ConfigError as error:
        raise error.in_file(path) from error


def loads(text: str, finite: bool = True) -> dict[str, Any]:
    """Return the object in a JSON text.

    Raises:
        ConfigError: Not JSON, not an object, a key that appears twice, nesting beyond reason,
            or, if ``finite``, NaN or an infinite number.
    """
    try:
        content = json.loads(
            text,
            parse_constant=_refuse_constant if finite else float,
            parse_float=_finite if finite else float,
            object_pairs_hook=_without_doubles,
        )
    except json.JSONDecodeError as error:
        raise ConfigError(f"line {error.lineno}", error.msg, "valid JSON") from error
    except (ValueError, RecursionError) as error:  # an integer of thousands of digits, nesting
        raise ConfigError("", str(error), "valid JSON") from error
    if not isinstance(content, dict):
        raise ConfigError("", type(content).__name__, "a JSON object")
    level: list[Any] = [content]
    for _ in range(MAX_DEPTH):
        inner = [item.values() if isinstance(item, dict) else item for item in level]
        level = [item for items in inner for item in items if isinstance(item, dict | list)]
    if level:
        raise ConfigError("", "deeper nesting", f"at most {MAX_DEPTH} levels of nesting")
    return content


def _refuse_constant(name: str) -> NoReturn:
    raise ConfigError("", name, "finite numbers only")


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ConfigError("", text, "finite numbers only")
    return value


def _without_doubles(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content = dict(pairs)
    if len(content) < len(pairs):
        keys = [key for key, _ in pairs]
        double = next(key for key in keys if keys.count(key) > 1)
        raise ConfigError(double, "the key twice", "each key once")
    return content
