"""The package as a user and ROS meet it: what is declared, what is installed, what is promised."""

from __future__ import annotations

import argparse
import pkgutil
import re
import runpy
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import setuptools
from made_results import TIME, example_diagnosis, fit_of
from support import REPOSITORY, executables

import dvrk_gravity
from dvrk_gravity.command_line import VERBS
from dvrk_gravity.files import resources
from dvrk_gravity.identification import evaluate
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Recording

README = (REPOSITORY / "README.md").read_text(encoding="utf-8")
MANIFEST = ElementTree.parse(REPOSITORY / "package.xml").getroot()


def declared(monkeypatch, command: str = "install") -> dict:
    """Return what setup.py declares when it is called with a command."""
    given: dict = {}
    monkeypatch.setattr(setuptools, "setup", given.update)
    monkeypatch.setattr(sys, "argv", ["setup.py", command])
    monkeypatch.chdir(REPOSITORY)
    runpy.run_path("setup.py")
    return given


# --- what ROS relies upon ---------------------------------------------------------------------


def test_package_xml_is_format_3_and_of_type_ament_python():
    assert MANIFEST.get("format") == "3"
    assert MANIFEST.findtext("export/build_type") == "ament_python"


def test_only_the_package_itself_is_installed_with_its_files(monkeypatch):
    """The oracle that hides effects, ``testing/``, lies beside it."""
    given = declared(monkeypatch)
    assert {name.split(".")[0] for name in given["packages"]} == {"dvrk_gravity"}
    assert {"dvrk_gravity.effects", "dvrk_gravity.simulate"} <= set(given["packages"])
    places = {f"{place}/{Path(name).name}" for place, names in given["data_files"]
              for name in names}  # fmt: skip
    for file in (
        "share/ament_index/resource_index/packages/dvrk_gravity", "share/dvrk_gravity/package.xml",
        "share/dvrk_gravity/config/mtmr_28002.yaml", "share/dvrk_gravity/config/arms/psm.yaml",
        "share/dvrk_gravity/config/layouts/monitor.foxglove.json",
        "share/dvrk_gravity/config/layouts/monitor.rviz",
        *(f"share/dvrk_gravity/launch/{path.name}" for path in REPOSITORY.glob("launch/*.py")),
    ):  # fmt: skip
        assert file in places
    assert not [place for place in places if "test" in place]
    (data,) = given["package_data"].values()
    assert {"py.typed", "*/__init__.pyi"} <= set(data)
    assert not given["zip_safe"]  # type checkers do not look into archives


def test_a_wheel_has_one_executable_and_a_ros_package_one_for_each_verb(monkeypatch):
    assert set(executables()) == set(VERBS)
    for command, scripts in (
        ("bdist_wheel", ["dvrk_gravity"]), ("dist_info", ["dvrk_gravity"]), ("install", [*VERBS]),
    ):  # fmt: skip
        lines = declared(monkeypatch, command)["entry_points"]["console_scripts"]
        installed = [line.split(" = ") for line in lines]
        assert sorted(name for name, _ in installed) == sorted(scripts)
        assert all(callable(pkgutil.resolve_name(target)) for _, target in installed)


def test_the_version_is_the_same_everywhere(monkeypatch):
    citation = (REPOSITORY / "CITATION.cff").read_text(encoding="utf-8")
    assert re.findall(r"^version: (.*)$", citation, re.MULTILINE) == [dvrk_gravity.__version__]
    assert declared(monkeypatch)["version"] == dvrk_gravity.__version__
    assert MANIFEST.findtext("version") == dvrk_gravity.__version__


def test_configuration_is_found_beside_the_package_however_it_is_installed(tmp_path, monkeypatch):
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    for case, site in enumerate((  # a prefix or an environment, Debian's, pip --target
        "lib/python3.12/site-packages", "local/lib/python3.12/dist-packages", "",
    )):  # fmt: skip
        installed = tmp_path / str(case) / site
        prefix = tmp_path / str(case) / site.split("lib/")[0]
        config = prefix / "share" / "dvrk_gravity" / "config" / "arms"
        config.mkdir(parents=True)
        (config / "mine.yaml").write_text("")
        module = installed / "dvrk_gravity" / "files" / "resources.py"
        monkeypatch.setattr(resources, "__file__", str(module))
        assert resources.config_path("arms/mine.yaml") == config / "mine.yaml"


# --- what is promised -------------------------------------------------------------------------


def test_the_commands_of_the_readme_exist():
    commands = re.findall(r"ros2 run dvrk_gravity ([\w-]+)(.*)$", README, re.MULTILINE)
    assert len(commands) > 8
    for verb, words in commands:
        parser = argparse.ArgumentParser()
        pkgutil.resolve_name(VERBS[verb][0]).add_arguments(parser)
        options = re.findall(r"(?<=\s)--[\w-]+", words.split("--ros-args")[0])
        known = {option for action in parser._actions for option in action.option_strings}
        assert set(options) <= known, (verb, words)
    targets = re.findall(r"^([\w-]+):", (REPOSITORY / "Makefile").read_text(), re.MULTILINE)
    assert set(re.findall(r"(?<=\bmake )[a-z][\w-]+", README)) <= {*targets, "sure"}
    for script in re.findall(r"python ([\w/]+\.py)", README):
        assert (REPOSITORY / script).is_file(), script


def test_links_of_the_readme_lead_somewhere():
    for target in re.findall(r"\]\((?!https?:)([^)#]+)", README):
        assert (REPOSITORY / target).exists(), target


def keys_of(file: str) -> list[str]:
    """Return the keys that docs/stability.md lists of a file, those of its parts after a `;`."""
    page = (REPOSITORY / "docs" / "stability.md").read_text(encoding="utf-8")
    row = next(line for line in page.splitlines() if line.startswith(f"| `{file}`"))
    return re.findall(r"`(\w+)`", row.split("|")[2])


def test_json_files_have_the_keys_that_are_public():
    diagnosis = example_diagnosis().to_dict()
    assert keys_of("findings.json") == [*diagnosis, *diagnosis["findings"][0]]
    fit = fit_of(TIME)
    assert keys_of("identify --json") == list(fit.to_json())
    arm = fit.model.arm
    effort = [0.01 * arm.effort_limit] * 2
    poses = Recording(arm.joint_names, None, [arm.lower, arm.upper], effort=effort)
    evaluation = evaluate(TorqueModel(arm, ()), poses)
    assert keys_of("evaluate --json") == list(evaluation.to_json())
