"""Names are imported from the face of their room, in every file of the repository."""

from __future__ import annotations

from imported import PACKAGE, modules, names
from support import REPOSITORY, syntax


def test_others_import_a_room_s_names_from_its_face():
    """A module as such may be deeper: to patch it, or to call its functions by its name."""
    known = modules(PACKAGE)
    users = [
        path
        for folder in ("test", "testing", "benchmark", "docs", "dvrk_gravity")
        for path in (REPOSITORY / folder).rglob("*.py")
    ]
    deep = []
    for path in users:
        own = path.relative_to(REPOSITORY).parts[:2] if PACKAGE in path.parents else ()
        for source, name in names(syntax(path)):
            parts = source.split(".")
            room = PACKAGE / parts[1] if len(parts) > 1 else PACKAGE
            inside = tuple(parts[:2]) == own or not (room / "__init__.pyi").exists()
            if len(parts) > 2 and parts[0] == PACKAGE.name and not inside:
                deep += [(path.name, source, name)] * (f"{source}.{name}" not in known)
    assert deep == []
