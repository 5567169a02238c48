"""The launch files, read with stand-ins for ROS's launch."""

from __future__ import annotations

import ast
import json
import re
import runpy
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import yaml
from support import CONFIG, REPOSITORY, executables

from dvrk_gravity.arms import Arm
from dvrk_gravity.parameters import node_parameters
from dvrk_gravity.ros import SIMULATOR_PARAMETERS

LAUNCH = REPOSITORY / "launch"
REAL = ("arm", "psm", "ecm", "mtm_pair")


class Substitution:
    """Stands for any of launch's substitutions: its class, and what it was made of."""

    def __init__(self, *parts: Any) -> None:
        self.parts = parts

    def value(self, given: dict[str, str]) -> str:
        kind = type(self).__name__
        if kind == "LaunchConfiguration":
            return given[self.parts[0]]
        if kind == "PathJoinSubstitution":
            return str(Path(*(value(part, given) for part in self.parts[0])))
        return {"ThisLaunchFileDir": str(LAUNCH), "FindPackageShare": str(REPOSITORY)}[kind]


def value(entry: Any, given: dict[str, str]) -> Any:
    if isinstance(entry, dict):
        return {name: value(part, given) for name, part in entry.items()}
    if isinstance(entry, list):
        return [value(part, given) for part in entry]
    return entry.value(given) if isinstance(entry, Substitution) else entry


class Argument:
    def __init__(self, name: str, default_value: Any = None, description: str = "") -> None:
        self.name, self.default = name, default_value


class Include:
    def __init__(self, source: Any, launch_arguments: Any) -> None:
        self.source, self.arguments = source, dict(launch_arguments)


@pytest.fixture
def launched(monkeypatch):
    kinds = ("LaunchConfiguration", "PathJoinSubstitution", "ThisLaunchFileDir", "FindPackageShare")
    substitutions = {name: type(name, (Substitution,), {}) for name in kinds}
    modules: dict[str, dict[str, Any]] = {
        "launch": {"LaunchDescription": list},
        "launch.actions": {"DeclareLaunchArgument": Argument, "IncludeLaunchDescription": Include},
        "launch.conditions": {"IfCondition": lambda said: said},
        "launch.launch_description_sources": {"PythonLaunchDescriptionSource": lambda path: path},
        "launch.substitutions": substitutions,
        "launch_ros": {},
        "launch_ros.actions": {"Node": dict},
        "launch_ros.substitutions": substitutions,
    }  # fmt: skip
    for name, content in modules.items():
        module = ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)

    def launch(path: str | Path, given: dict[str, str]) -> list[dict[str, Any]]:
        """Return the nodes that a launch file starts, with their values."""
        nodes, known = [], dict(given)
        for entity in runpy.run_path(str(path))["generate_launch_description"]():
            if isinstance(entity, Argument):
                if entity.name not in known and entity.default is not None:
                    known[entity.name] = value(entity.default, known)
                assert entity.name in known, f"{entity.name} is required"
            elif isinstance(entity, Include):
                inner = {name: value(part, known) for name, part in entity.arguments.items()}
                nodes += launch(value(entity.source, known), inner)
            else:
                made = value(entity, known)
                if made.pop("condition", "true") == "true":
                    nodes.append(made)
        return nodes

    return launch


def test_a_real_arm_gets_compensator_and_watchdog_with_its_model(launched):
    for name, given, expected in (
        ("arm", {"namespace": "KUKA", "model": "k.yaml"}, {"KUKA": "k.yaml"}),
        ("psm", {"model": "p.yaml"}, {"PSM1": "p.yaml"}),
        ("psm", {"model": "p.yaml", "namespace": "PSM2"}, {"PSM2": "p.yaml"}),
        ("ecm", {"model": "e.yaml"}, {"ECM": "e.yaml"}),
        (
            "mtm_pair", {"left_model": "l.yaml", "right_model": "r.yaml"},
            {"MTML": "l.yaml", "MTMR": "r.yaml"},
        ),
    ):  # fmt: skip
        nodes = launched(LAUNCH / f"{name}.launch.py", given)
        assert all(node["package"] == "dvrk_gravity" for node in nodes)
        assert {node["namespace"]: node["parameters"][0] for node in nodes} == expected
        for namespace in expected:
            started = [node["executable"] for node in nodes if node["namespace"] == namespace]
            assert started == ["watchdog", "compensator"], name
    assert {"watchdog", "compensator"} <= set(executables())


def test_the_demonstration_has_a_monitor_where_one_is_asked_for(launched):
    path = LAUNCH / "demo.launch.py"
    plain, watched = (
        [node["executable"] for node in launched(path, given)]
        for given in ({}, {"monitor": "true"})
    )
    assert watched == [*plain, "monitor"]
    assert "monitor" in executables()


def test_layouts_show_what_the_monitor_publishes():
    tree = ast.parse((REPOSITORY / "dvrk_gravity" / "ros" / "monitor_node.py").read_text())
    words = {node.value for node in ast.walk(tree) if isinstance(node, ast.Constant)}
    own = {f"/MTMR/monitor{word[1:]}" for word in words if str(word).startswith("~/")}
    topics = own | {"/MTMR/measured_js", "/MTMR/robot_description", "/diagnostics"}
    joints, layouts = Arm.load("mtmr").joint_names, CONFIG / "layouts"

    foxglove = json.loads((layouts / "monitor.foxglove.json").read_text())
    panels = foxglove["configById"]
    paths = {path["value"] for panel in panels.values() for path in panel.get("paths", ())}
    events = panels["RawMessages!events"]["topicPath"]
    shown = {path.split(".")[0] for path in (*paths, events)}
    assert shown <= topics
    assert {f"/MTMR/monitor/external_js.effort[{n}]" for n in range(len(joints))} <= paths
    assert set(re.findall(r'"(\w+!\w+)"', json.dumps(foxglove["layout"]))) == {*panels}

    juggler = ElementTree.parse(layouts / "monitor.plotjuggler.xml").getroot()
    curves = {entry.get("name", "") for entry in juggler.iter("curve")}
    selected = {entry.get("name") for entry in juggler.iter("topic")}
    assert selected <= topics
    assert all(any(curve.startswith(f"{topic}/") for topic in selected) for curve in curves)
    assert {f"/MTMR/monitor/expected_js/{joint}/effort" for joint in joints} <= curves

    rviz = yaml.safe_load((layouts / "monitor.rviz").read_text())
    displays = rviz["Visualization Manager"]["Displays"]
    (wrench,) = [each for each in displays if each["Class"].endswith("/Wrench")]
    assert wrench["Topic"]["Value"] in own
    named = [value["Value"] for each in displays for value in each.values()
             if isinstance(value, dict) and "Value" in value]  # fmt: skip
    assert {*named} <= topics


def test_no_real_arm_is_started_without_a_model_of_its_own(launched):
    for name in REAL:
        with pytest.raises(AssertionError, match=r"model is required|namespace is required"):
            launched(LAUNCH / f"{name}.launch.py", {})


def test_the_parameters_of_launched_nodes_are_those_of_the_nodes(launched):
    known = {*node_parameters(Arm.load("mtmr")), *SIMULATOR_PARAMETERS}
    models = dict.fromkeys(("namespace", "model", "left_model", "right_model"), "m")
    files = sorted(LAUNCH.glob("*.launch.py"))
    assert {path.name.split(".")[0] for path in files} == {*REAL, "demo"}
    for path in files:
        for node in launched(path, models):
            parts = [part for part in node["parameters"] if isinstance(part, dict)]
            assert {key for part in parts for key in part} <= known, path
