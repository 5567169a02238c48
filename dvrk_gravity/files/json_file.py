"""Read JSON files as the dVRK's console does: one clear line for whatever is wrong with one.

Its reader (jsoncpp's ``Json::Reader``) takes comments, keys that appear twice (the last one
counts), ``1.`` and ``007`` for numbers, and does not look at what follows the object. A comma after
the last item it refuses; its meaning is clear, so it is read here and noted.
"""

from __future__ import annotations

import json
import math
import re
from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import text_file

MAX_DEPTH = 20
MOST_ODDITIES = 100  # that are listed. Chosen: nobody reads more
# A text, or a comment, without an end is one up to the file's end: from each of its characters, the
# search for an end would begin again.
_TEXT = r'"[^"\\]*+(?:\\.[^"\\]*+)*+(?:"|\\?\Z)'
_COMMENT = re.compile(rf"{_TEXT}|//[^\n]*|/\*.*?(?:\*/|(?P<endless>\Z))", re.DOTALL)
_LOOSE = re.compile(rf"{_TEXT}|(?P<comma>,)(?=\s*[]}}])|(?P<number>-?\d[\d.eE+-]*)", re.DOTALL)


class Oddity(NamedTuple):
    """A deviation from JSON.

    Attributes:
        text: Kind and place, in a line.
        refused: Whether the console's reader refuses the file for it.
    """

    text: str
    refused: bool


def load(path: str | Path, finite: bool = True) -> dict[str, Any]:
    """Return the object in a JSON file.

    Args:
        path: The file.
        finite: Refuse NaN and infinite numbers; else the caller checks them.

    Raises:
        ConfigError: No such file, too large, not text, or refused by :func:`loads`.
    """
    return load_with_oddities(path, finite)[0]


def load_with_oddities(
    path: str | Path, finite: bool = True
) -> tuple[dict[str, Any], tuple[Oddity, ...]]:
    """Return the object in a JSON file, and its deviations from JSON; see :func:`load`."""
    text = text_file.read(path, "JSON")
    try:
        return _parse(text, finite)
    except ConfigError as error:
        raise error.in_file(path) from error


def loads(text: str, finite: bool = True) -> dict[str, Any]:
    """Return the object in a JSON text.

    Raises:
        ConfigError: Not JSON, not an object, nesting beyond reason, or, if ``finite``, NaN or an
            infinite number.
    """
    return _parse(text, finite)[0]


def _parse(text: str, finite: bool) -> tuple[dict[str, Any], tuple[Oddity, ...]]:
    oddities: list[Oddity] = []

    def without_doubles(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        content = dict(pairs)
        if len(content) < len(pairs):
            for key, times in Counter(key for key, _ in pairs).items():
                if times > 1:
                    oddities.append(Oddity(f"{key} appears twice, the last one counts", False))
        return content

    plain, commas = _plain(text)
    decoder = json.JSONDecoder(
        parse_constant=_refuse_constant if finite else float,
        parse_float=_finite if finite else float,
        object_pairs_hook=without_doubles,
    )
    try:
        start = len(plain) - len(plain.lstrip())
        content, end = decoder.raw_decode(plain, start)
    except json.JSONDecodeError as error:
        raise ConfigError(f"line {error.lineno}", error.msg, "valid JSON") from error
    except (ValueError, RecursionError) as error:  # an integer of thousands of digits, nesting
        raise ConfigError("", str(error), "valid JSON") from error
    if not isinstance(content, dict):
        raise ConfigError("", type(content).__name__, "a JSON object")
    if rest := plain[end:].strip():
        line = plain.count("\n", 0, plain.index(rest, end)) + 1
        oddities.append(Oddity(f"line {line}: what follows the object is not read", False))
    level: list[Any] = [content]
    for _ in range(MAX_DEPTH):
        inner = [item.values() if isinstance(item, dict) else item for item in level]
        level = [item for items in inner for item in items if isinstance(item, dict | list)]
    if level:
        raise ConfigError("", "deeper nesting", f"at most {MAX_DEPTH} levels of nesting")
    found = [*commas, *oddities]
    if left := found[MOST_ODDITIES:]:
        refused = any(oddity.refused for oddity in left)
        found[MOST_ODDITIES:] = [Oddity(f"and {len(left)} more such deviations", refused)]
    return content, tuple(found)


def _plain(text: str) -> tuple[str, list[Oddity]]:
    """Return strict JSON text with the same lines, and the superfluous commas."""
    commas: list[Oddity] = []
    line, counted = 1, 0  # number of the line at a character

    def blank(match: re.Match[str]) -> str:
        found = match[0]
        plain = found.startswith('"') or match["endless"] is not None
        return found if plain else re.sub(r"[^\n]", " ", found)

    def strict(match: re.Match[str]) -> str:
        nonlocal line, counted
        if match["comma"]:
            line += match.string.count("\n", counted, match.start())
            counted = match.start()
            commas.append(Oddity(f"line {line}: a comma after the last item", True))
            return " "
        number = match["number"]
        if number and (number.endswith(".") or re.match(r"-?0\d|.*\.[eE]", number)):
            try:
                return repr(float(number))
            except ValueError:  # no number at all
                return number
        return match[0]

    return _LOOSE.sub(strict, _COMMENT.sub(blank, text)), commas


def _refuse_constant(name: str) -> NoReturn:
    raise ConfigError("", name, "finite numbers only")


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ConfigError("", text, "finite numbers only")
    return value
