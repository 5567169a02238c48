"""The launch files, read with stand-ins for ROS's launch."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from support import REPOSITORY, executables

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
                nodes.append(value(entity, known))
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
