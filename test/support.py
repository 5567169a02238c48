"""What tests of all rooms share: where files are, and how many examples a property gets."""

from __future__ import annotations

import ast
import os
from functools import cache
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[1]
CONFIG = REPOSITORY / "config"
MODEL_FILE = CONFIG / "mtmr_28002.yaml"

# `make trials` asks for more.
EXAMPLES = int(os.environ.get("DVRK_GRAVITY_EXAMPLES", "1"))


def examples(count: int) -> int:
    """Return how many examples of a property are tried: ``count``, or a multiple in trials."""
    return count * EXAMPLES


@cache
def syntax(path: Path) -> tuple[ast.AST, ...]:
    """Return the nodes of a module's syntax tree, itself first."""
    return tuple(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))


def executables() -> tuple[str, ...]:
    """Return the verbs that setup.py installs."""
    tree = ast.parse((REPOSITORY / "setup.py").read_text())
    return next(
        ast.literal_eval(node.value)
        for node in tree.body
        if isinstance(node, ast.Assign) and node.targets[0].id == "EXECUTABLES"
    )
