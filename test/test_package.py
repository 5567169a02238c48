"""The package as others see it: what is declared, what is installed, what the README says."""

from __future__ import annotations

import ast
import importlib
import importlib.util
import os
import pkgutil
import re
import runpy
import subprocess
import sys
import types
import xml.etree.ElementTree as ElementTree

import pytest
import setuptools
import yaml
from support import REPOSITORY, executables, syntax

import dvrk_gravity
from dvrk_gravity.command_line import VERBS, run
from dvrk_gravity.effects import effects
from dvrk_gravity.files import resources

DOCS = REPOSITORY / "docs"
# Those of api/ are written by `make docs`, which may run beside these tests.
PAGES = [path for path in DOCS.rglob("*.md") if path.parent != DOCS / "api"]


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


@pytest.mark.parametrize("page", [*REPOSITORY.glob("*.md"), *PAGES], ids=lambda p: p.name)
def test_links_within_the_documentation_lead_somewhere(page):
    links = re.findall(r"\]\((?!https?:)([^)#]*)(?:#([^)]*))?\)", page.read_text(encoding="utf-8"))
    for path, fragment in links:
        target = (page.parent / path) if path else page
        assert target.exists(), path
        assert not fragment or fragment in anchors(target.read_text(encoding="utf-8")), fragment


def test_every_page_is_in_the_table_of_contents():
    """Sphinx warns of one that is not; here it takes no time."""
    listed = (DOCS / "index.md").read_text(encoding="utf-8").split()
    pages = {path.relative_to(DOCS).with_suffix("").as_posix() for path in PAGES}
    assert pages - {"index"} <= set(listed)


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


@pytest.mark.parametrize(
    ("command", "scripts"),
    [("bdist_wheel", ["dvrk_gravity"]), ("dist_info", ["dvrk_gravity"]), ("install", [*VERBS])],
)
def test_a_wheel_has_one_executable_and_a_ros_package_one_for_each_verb(
    command, scripts, monkeypatch
):
    given = {}
    monkeypatch.setattr(setuptools, "setup", given.update)
    monkeypatch.setattr(sys, "argv", ["setup.py", command])
    monkeypatch.chdir(REPOSITORY)
    runpy.run_path("setup.py")
    installed = [line.split(" = ") for line in given["entry_points"]["console_scripts"]]
    assert sorted(name for name, _ in installed) == sorted(scripts)
    assert all(callable(pkgutil.resolve_name(target)) for _, target in installed)


@pytest.mark.parametrize(
    "words",
    [["compensator"], ["demo", "--out", "new"], ["excite", "--arm", "mtmr", "--out", "new"]],
)
def test_what_needs_ros_says_so_in_one_line_where_there_is_none(words, tmp_path):
    code = (
        "import sys; sys.modules.update(rclpy=None); from dvrk_gravity.__main__ import main; "
        f"sys.exit(main({words!r}))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False,
        env=os.environ | {"PYTHONPATH": str(REPOSITORY)},
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (2, "")
    (line,) = done.stderr.splitlines()
    assert line.startswith(f"dvrk_gravity {words[0]}: needs ROS 2 (no module rclpy")
    assert not list(tmp_path.iterdir())


def test_a_fault_of_our_own_imports_is_not_taken_for_something_to_install(monkeypatch):
    module = types.ModuleType("broken")
    module.NAME, module.EXAMPLE, module.__doc__ = "broken", "broken", "Breaks."
    module.add_arguments = lambda parser: None
    module.run = lambda arguments: importlib.import_module("dvrk_gravity.not_there")
    monkeypatch.setitem(sys.modules, "broken", module)
    with pytest.raises(ModuleNotFoundError):
        run("broken", [])
    module.run = lambda arguments: importlib.import_module("nowhere_to_be_found")
    assert run("broken", []) == 2


def test_the_version_is_the_same_everywhere():
    text = (REPOSITORY / "CITATION.cff").read_text(encoding="utf-8")
    assert re.findall(r"^version: (.*)$", text, re.MULTILINE) == [dvrk_gravity.__version__]


def test_the_readme_s_table_is_that_of_the_measured_page():
    path = REPOSITORY / "docs" / "readme_table.py"
    spec = importlib.util.spec_from_file_location("readme_table", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    readme = (REPOSITORY / "README.md").read_text(encoding="utf-8")
    assert module.written() == readme, "docs/readme_table.py --write renews it"


def test_the_public_workflow_runs_what_ci_runs_on_both_versions():
    workflow = yaml.safe_load((REPOSITORY / ".github" / "workflows" / "ci.yml").read_text())
    jobs = workflow["jobs"]
    assert jobs["test"]["strategy"]["matrix"]["python"] == ["3.11", "3.12"]
    commands = [step["run"] for job in jobs.values() for step in job["steps"] if "run" in step]
    assert commands == [".ci/run", "make docs", "make dist-check"]


def test_the_changelog_is_newest_first():
    text = (REPOSITORY / "CHANGELOG.md").read_text(encoding="utf-8")
    first, *released = re.findall(r"^## (\S+)", text, re.MULTILINE)
    assert first == "Unreleased"
    numbers = [tuple(map(int, version.split("."))) for version in released]
    assert numbers == sorted(numbers, reverse=True)


@pytest.mark.parametrize(
    "site",
    ["lib/python3.12/site-packages", "local/lib/python3.12/dist-packages", ""],
    ids=["a prefix or an environment", "Debian's", "pip --target"],
)
def test_configuration_is_found_beside_the_package_however_it_is_installed(
    site, tmp_path, monkeypatch
):
    prefix = tmp_path / site.split("lib/")[0]
    config = prefix / "share" / "dvrk_gravity" / "config" / "arms"
    config.mkdir(parents=True)
    (config / "mine.yaml").write_text("")
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    monkeypatch.setattr(
        resources, "__file__", str(tmp_path / site / "dvrk_gravity" / "files" / "resources.py")
    )
    assert resources.config_path("arms/mine.yaml") == config / "mine.yaml"
