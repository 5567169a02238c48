"""The Python reference: a page for each room of the package, with the names of its face.

`api/ROOM.md` is written before the site is built, from the room's ``__init__.pyi``; autodoc2 has
the docstrings, from the text of the modules. Nothing of the package is imported.
"""

from __future__ import annotations

import ast
from pathlib import Path
from typing import Any

import autodoc2.astroid_utils
from autodoc2.render.myst_ import MystRenderer
from autodoc2.sphinx.utils import get_all_analyser, get_database, load_config
from docutils import nodes
from docutils.statemachine import StringList
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

PACKAGE = Path(__file__).resolve().parents[2] / "dvrk_gravity"


PAGE = """\
# dvrk_gravity.{room}

```{{py:module}} dvrk_gravity.{room}
```

```{{autodoc2-docstring}} dvrk_gravity.{room}
:parser: google_docstrings
```

```{{face}} {room}
```
"""


def public_names(room: str) -> dict[str, str]:
    """Return in which module each name of a room's face is defined, as its stub has it."""
    statements = ast.parse((PACKAGE / room / "__init__.pyi").read_text(encoding="utf-8")).body
    imports = [each for each in statements if isinstance(each, ast.ImportFrom)]
    return {alias.name: each.module or "" for each in imports for alias in each.names}


def is_property(decorator: Any) -> bool:
    """Count a cached property as a property, which autodoc2 does not."""
    return decorator.name == "cached_property" or _is_property(decorator)


_is_property = autodoc2.astroid_utils.is_property_decorator
autodoc2.astroid_utils.is_property_decorator = is_property


class Face(SphinxDirective):
    """``{face} ROOM``: the public names of a room with their docstrings."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Render classes, functions and values, each under the name that one imports."""
        room = f"dvrk_gravity.{self.arguments[0]}"
        database, resolver = get_database(self.env), get_all_analyser(self.env)
        renderer = MystRenderer(database, load_config(self.env.app), all_resolver=resolver)
        rendered: dict[str, list[str]] = {"Classes": [], "Functions": [], "Values": []}
        for name, module in sorted(public_names(self.arguments[0]).items()):
            item = database.get_item(".".join(filter(None, (room, module, name))))
            if item is None:  # a value assigned among others, which autodoc2 does not list
                rendered["Values"] += [f"```{{py:data}} {name}", "```", ""]
            else:
                title = {"function": "Functions", "data": "Values"}.get(item["type"], "Classes")
                rendered[title] += renderer.render_item(item["full_name"])
        lines: list[str] = []
        for title, items in rendered.items():
            lines += [f"## {title}", "", *items] if items else []
        self.env.ref_context["py:module"] = room
        base = nodes.Element()
        content = StringList(lines, source=self.get_source_info()[0])
        self.state.nested_parse(content, 0, base, match_titles=True)
        return base.children


def write_pages(app: Sphinx, _: object) -> None:
    """Write the pages of all rooms; those that are right already stay untouched."""
    folder = Path(app.srcdir) / "api"
    folder.mkdir(exist_ok=True)
    rooms = sorted(stub.parent.name for stub in PACKAGE.glob("*/__init__.pyi"))
    for room in rooms:
        page = folder / f"{room}.md"
        text = PAGE.format(room=room)
        if not page.exists() or page.read_text(encoding="utf-8") != text:
            page.write_text(text, encoding="utf-8")
    for page in folder.glob("*.md"):
        if page.stem not in rooms:
            page.unlink()


def setup(app: Sphinx) -> dict[str, bool]:
    """Register directive and pages."""
    app.add_directive("face", Face)
    app.connect("config-inited", write_pages)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
