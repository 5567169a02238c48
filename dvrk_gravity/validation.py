"""Checks of paths and arrays that are arguments of the Python surface."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.errors import ArgumentError, ConfigError

PATH = (str, os.PathLike)
_WITH_LINK = re.compile(r"(?P<path>.*\.(urdf|xacro))#(?P<link>[^\n]*)", re.IGNORECASE | re.DOTALL)


def path_of(name: str, value: Any, expected: str = "the path of a file") -> Path:
    """Return an argument as a path; raise ArgumentError if it is neither text nor a path."""
    if not isinstance(value, PATH):
        raise ArgumentError(name, value, expected)
    return Path(value)


def split_link(text: str) -> tuple[str, str]:
    """Return path and link of ``robot.urdf#LINK``; of another path ``""`` for the link."""
    found = _WITH_LINK.fullmatch(text)
    return (found["path"], found["link"]) if found else (text, "")


def is_urdf(path: str | os.PathLike[str]) -> bool:
    """Return whether a path, or ``robot.urdf#LINK``, is that of a URDF, or one for xacro."""
    return split_link(str(path))[0].lower().endswith((".urdf", ".xacro"))


def refuse_json(name: str, path: str | os.PathLike[str]) -> None:
    """Refuse a console's JSON where a model's file is expected; raise ConfigError."""
    file = Path(path)
    if file.suffix.lower() == ".json":
        makes = f"`convert {file} {file.stem}.yaml` makes one of the dVRK console's gc-*.json"
        raise ConfigError(name, "a JSON file", f"a model's .yaml: {makes}", file)


def floats(name: str, value: Any) -> NDArray[np.float64]:
    """Return an argument as an array of float64, without a copy if it is one.

    Raises:
        ArgumentError: Not numbers, or rows of different lengths.
    """
    try:
        return np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ArgumentError(name, value, f"an array of numbers ({error})") from error
