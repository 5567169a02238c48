"""Import statements of files, and the names that a room shows."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

from support import REPOSITORY, syntax

PACKAGE = REPOSITORY / "dvrk_gravity"


def modules(package: Path) -> dict[str, Path]:
    """Return the files of a package by the modules' names."""
    found = {}
    for path in package.rglob("*.py"):
        parts = path.relative_to(package.parent).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def names(nodes: Iterable[ast.AST]) -> Iterator[tuple[str, str]]:
    """Yield (module, name or nothing) of every import statement."""
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from ((alias.name, "") for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, "relative imports are not used here"
            yield from ((node.module or "", alias.name) for alias in node.names)


@cache
def face(package: str) -> dict[str, str]:
    """Return which module has each public name of a package, as its stub says."""
    stub = PACKAGE.parent.joinpath(*package.split("."), "__init__.pyi")
    if not stub.exists():
        return {}
    return {
        alias.name: f"{package}.{node.module}" if node.module else f"{package}.{alias.name}"
        for node in syntax(stub)
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
