"""The face of a room: the names in its ``__init__.pyi``, each imported on first use."""

from __future__ import annotations

import importlib
import re
import sys
from collections.abc import Callable
from importlib.machinery import ModuleSpec
from typing import Any

_LINE = re.compile(r"^from (\.\S+) import (\w+) as \2$", re.MULTILINE)


def attach(spec: ModuleSpec) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return ``__getattr__``, ``__dir__`` and ``__all__`` of a package.

    Its stub is what type checkers read, in lines ``from .module import name as name``.
    """
    path = f"{spec.origin}i"
    text = spec.loader.get_data(path).decode()  # type: ignore[union-attr]  # zip files have it too
    modules = {name: module for module, name in _LINE.findall(text)}

    def get(name: str) -> Any:
        if name not in modules:
            raise AttributeError(f"module {spec.name!r} has no attribute {name!r}")
        value = getattr(importlib.import_module(modules[name], spec.name), name)
        setattr(sys.modules[spec.name], name, value)
        return value

    return get, lambda: sorted(modules), sorted(modules)
