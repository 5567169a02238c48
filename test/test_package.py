"""The package as others see it: what is declared, what is installed, what the README says."""

from __future__ import annotations

import ast
import importlib.util
import re
import runpy
import subprocess
import sys
import xml.etree.ElementTree as ElementTree

import pytest
import setuptools
from conftest import REPOSITORY, executables, syntax

import dvrk_gravity
from dvrk_gravity.command_line import VERBS
from dvrk_gravity.effects import effects

DOCS = REPOSITORY / "docs"


def script(name: str):
    """Return a script of the documentation as a module."""
    spec = importlib.util.spec_from_file_location(name, DOCS / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_table_of_parameters_in_the_docs_is_that_of_the_declarations():
    module = script("parameter_table")
    assert "`slew_limit`" in module.table()
    assert module.written() == (REPOSITORY / "docs" / "parameters.md").read_text(encoding="utf-8")
    for file, text in module.helps().items():
        assert file.read_text(encoding="utf-8") == text, "docs/parameter_table.py --write renews it"


def test_the_reference_has_every_verb_option_effect_and_room():
    written = script("reference_pages").pages()
    for file, text in written.items():
        assert file.read_text(encoding="utf-8") == text, "docs/reference_pages.py --write renews it"
    options, findings, _ = written.values()
    assert set(re.findall("^## (.+)$", options, re.MULTILINE)) == set(VERBS)
    assert "`--payload-at LINK[:X,Y,Z]`" in options
    assert all(f"{effect.NAME}" in findings for effect in effects())


def anchors(page: str) -> set[str]:
    """Return the fragments that headings of a Markdown page have."""
    headings = re.findall(r"^#+ (.*)$", page, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize(
    "page", [*REPOSITORY.glob("*.md"), *DOCS.rglob("*.md")], ids=lambda p: p.name
)
def test_links_within_the_documentation_lead_somewhere(page):
    links = re.findall(r"\]\((?!https?:)([^)#]*)(?:#([^)]*))?\)", page.read_text(encoding="utf-8"))
    for path, fragment in links:
        target = (page.parent / path) if path else page
        assert target.exists(), path
        assert not fragment or fragment in anchors(target.read_text(encoding="utf-8")), fragment


def test_every_page_is_in_the_table_of_contents():
    """Sphinx warns of one that is not; here it takes no time."""
    listed = (DOCS / "index.md").read_text(encoding="utf-8").split()
    pages = {path.relative_to(DOCS).with_suffix("").as_posix() for path in DOCS.rglob("*.md")}
    outside = {page for page in pages if not page.startswith("api/")} - {"index"}
    assert outside <= set(listed)


def test_the_readme_is_read_in_two_screens():
    lines = (REPOSITORY / "README.md").read_text(encoding="utf-8").splitlines()
    assert len(lines) <= 120


def test_every_verb_is_an_executable_and_the_other_way_round():
    assert set(executables()) == set(VERBS)


def test_package_xml_is_format_3_and_of_type_ament_python():
    root = ElementTree.parse(REPOSITORY / "package.xml").getroot()
    assert root.get("format") == "3"
    assert root.findtext("export/build_type") == "ament_python"


def test_only_the_package_itself_is_installed(monkeypatch):
    """The oracle that hides effects, ``testing/``, lies beside it."""
    given = {}
    monkeypatch.setattr(setuptools, "setup", given.update)
    monkeypatch.chdir(REPOSITORY)
    runpy.run_path("setup.py")
    assert {name.split(".")[0] for name in given["packages"]} == {"dvrk_gravity"}
    manifest = ElementTree.parse(REPOSITORY / "package.xml").getroot()
    assert given["version"] == manifest.findtext("version") == dvrk_gravity.__version__
    assert {"dvrk_gravity.effects", "dvrk_gravity.simulate"} <= set(given["packages"])
    files = [name for _, names in given["data_files"] for name in names]
    assert not [name for name in files if name.startswith("test")]


def test_the_package_does_not_need_what_is_not_installed():
    for path in (REPOSITORY / "dvrk_gravity").rglob("*.py"):
        for node in syntax(path):
            names: list[str] = []
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                names = [node.module or ""]
            assert not {"testing", "test"} & {name.split(".")[0] for name in names}, path


def test_colcon_takes_it_for_an_ament_python_package():
    pytest.importorskip("colcon_core")
    result = subprocess.run(
        [sys.executable, "-m", "colcon", "list", "--paths", str(REPOSITORY)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert "(ros.ament_python)" in result.stdout, result.stderr


def test_the_public_names_import_without_rclpy():
    code = (
        "import sys; from dvrk_gravity import TorqueModel, Recording; import dvrk_gravity.gravity; "
        "sys.exit('rclpy' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], cwd=REPOSITORY, check=False).returncode == 0
