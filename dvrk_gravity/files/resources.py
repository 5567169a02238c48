"""Where the package's configuration files are, installed or in a checkout."""

from __future__ import annotations

import os
from pathlib import Path

PACKAGE = "dvrk_gravity"


def config_path(name: str) -> Path:
    """Return the path of a file that the package ships under ``config/``.

    Looked for in this module's checkout, then in every prefix of AMENT_PREFIX_PATH, then in the
    prefix where it is installed; raises ``FileNotFoundError``.
    """
    for folder in _folders():
        path = (folder / name).resolve()
        if path.is_file() and path.is_relative_to(folder.resolve()):
            return path
    raise FileNotFoundError(name)


def shipped(folder: str) -> tuple[str, ...]:
    """Return the names of the YAML files in a folder of ``config/``, wherever they are found."""
    found = {path.stem for config in _folders() for path in (config / folder).glob("*.yaml")}
    return tuple(sorted(found))


def _folders() -> list[Path]:
    """Return the possible ``config/`` folders, the nearest first."""
    package = Path(__file__).resolve().parents[1]
    prefixes = [Path(p) for p in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if p]
    # <prefix>/lib/python3.X/site-packages/dvrk_gravity; <prefix>/dvrk_gravity of `pip --target`
    prefixes += (*package.parents[2:4], package.parent)
    return [
        package.parent / "config",
        *(prefix / "share" / PACKAGE / "config" for prefix in prefixes),
    ]
