"""The documentation shows what its scripts write, and its links lead somewhere."""

from __future__ import annotations

import importlib.util
import re
from types import ModuleType

from support import REPOSITORY

from dvrk_gravity.command_line import VERBS
from dvrk_gravity.effects import effects

DOCS = REPOSITORY / "docs"
# Those of api/ are written by `make docs`.
PAGES = [path for path in DOCS.rglob("*.md") if path.parent != DOCS / "api"]


def script(name: str) -> ModuleType:
    """Return a script of the documentation as a module."""
    spec = importlib.util.spec_from_file_location(name, DOCS / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_pages_are_what_their_scripts_write():
    for name, page in (
        ("parameter_table", DOCS / "parameters.md"), ("stability_tables", DOCS / "stability.md"),
        ("readme_table", REPOSITORY / "README.md"),
    ):  # fmt: skip
        written, text = script(name).written(), page.read_text(encoding="utf-8")
        assert written == text, f"docs/{name}.py --write renews it"
    for file, text in script("parameter_table").helps().items():
        assert file.read_text(encoding="utf-8") == text, "docs/parameter_table.py --write renews it"
    written = script("reference_pages").pages()
    for file, text in written.items():
        assert file.read_text(encoding="utf-8") == text, "docs/reference_pages.py --write renews it"
    options, findings, _ = written.values()
    assert set(re.findall("^## (.+)$", options, re.MULTILINE)) == set(VERBS)
    assert all(f"{effect.NAME}" in findings for effect in effects())


def test_the_gravity_model_s_page_has_the_derived_tables():
    derive = script("derive_gravity_model")
    page = (DOCS / "gravity_model.md").read_text(encoding="utf-8")
    assert derive.rows_table() in page
    assert derive.beta_table() in page


def anchors(page: str) -> set[str]:
    """Return the fragments that headings of a Markdown page have."""
    headings = re.findall(r"^#+ (.*)$", page, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_links_within_the_documentation_lead_somewhere():
    for page in [*REPOSITORY.glob("*.md"), *PAGES]:
        text = page.read_text(encoding="utf-8")
        for path, fragment in re.findall(r"\]\((?!https?:)([^)#]*)(?:#([^)]*))?\)", text):
            target = (page.parent / path) if path else page
            assert target.exists(), (page, path)
            known = not fragment or fragment in anchors(target.read_text(encoding="utf-8"))
            assert known, (page, fragment)


def test_the_changelog_is_newest_first():
    text = (REPOSITORY / "CHANGELOG.md").read_text(encoding="utf-8")
    first, *released = re.findall(r"^## (\S+)", text, re.MULTILINE)
    assert first == "Unreleased"
    numbers = [tuple(map(int, version.split("."))) for version in released]
    assert numbers == sorted(numbers, reverse=True)
