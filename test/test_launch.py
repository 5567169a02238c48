"""The launch files, read with stand-ins for ROS's launch, and how what they start ends."""

from __future__ import annotations

import runpy
import signal
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from rclpy.duration import Duration
from std_msgs.msg import Empty
from support import MODEL_FILE, REPOSITORY, executables

from dvrk_gravity.parameters import node_parameters
from dvrk_gravity.ros import Client, NodeProcess

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
        self.name, self.default, self.description = name, default_value, description


class Node:
    def __init__(self, **fields: Any) -> None:
        self.fields = fields


class Include:
    def __init__(self, source: Any, launch_arguments: Any) -> None:
        self.source, self.arguments = source, dict(launch_arguments)


@dataclass
class Started:
    """What a launch file starts: nodes with their values, and the arguments that it takes."""

    nodes: list[dict[str, Any]] = field(default_factory=list)
    arguments: dict[str, Argument] = field(default_factory=dict)


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
        "launch_ros.actions": {"Node": Node},
        "launch_ros.substitutions": substitutions,
    }  # fmt: skip
    for name, content in modules.items():
        module = ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)

    def launch(path: str | Path, given: dict[str, str]) -> Started:
        found, known = Started(), dict(given)
        for entity in runpy.run_path(str(path))["generate_launch_description"]():
            if isinstance(entity, Argument):
                found.arguments[entity.name] = entity
                if entity.name not in known and entity.default is not None:
                    known[entity.name] = value(entity.default, known)
                assert entity.name in known, f"{entity.name} is required"
            elif isinstance(entity, Include):
                inner = {name: value(part, known) for name, part in entity.arguments.items()}
                found.nodes += launch(value(entity.source, known), inner).nodes
            else:
                found.nodes.append(value(entity.fields, known))
        return found

    return launch


def test_every_launch_file_is_tried_here():
    files = {path.name.removesuffix(".launch.py") for path in LAUNCH.iterdir() if path.is_file()}
    assert files == {*REAL, "demo"}


@pytest.mark.parametrize(
    ("name", "given", "expected"),
    [
        ("arm", {"namespace": "KUKA", "model": "k.yaml"}, {"KUKA": "k.yaml"}),
        ("psm", {"model": "p.yaml"}, {"PSM1": "p.yaml"}),
        ("psm", {"model": "p.yaml", "namespace": "PSM2"}, {"PSM2": "p.yaml"}),
        ("ecm", {"model": "e.yaml"}, {"ECM": "e.yaml"}),
        (
            "mtm_pair", {"left_model": "l.yaml", "right_model": "r.yaml"},
            {"MTML": "l.yaml", "MTMR": "r.yaml"},
        ),
    ],
)  # fmt: skip
def test_a_real_arm_gets_compensator_and_watchdog_with_its_model(name, given, expected, launched):
    nodes = launched(LAUNCH / f"{name}.launch.py", given).nodes
    assert all(node["package"] == "dvrk_gravity" for node in nodes)
    assert {node["namespace"]: node["parameters"][0] for node in nodes} == expected
    for namespace in expected:
        started = [node["executable"] for node in nodes if node["namespace"] == namespace]
        assert started == ["watchdog", "compensator"]
    assert {"watchdog", "compensator"} <= set(executables())


@pytest.mark.parametrize("name", REAL)
def test_no_real_arm_is_started_without_a_model_of_its_own(name, launched):
    with pytest.raises(AssertionError, match=r"model is required|namespace is required"):
        launched(LAUNCH / f"{name}.launch.py", {})


@pytest.mark.parametrize("name", [*REAL, "demo"])
def test_the_parameters_of_launched_nodes_are_those_of_the_nodes(name, launched):
    from dvrk_gravity.arms import Arm
    from dvrk_gravity.ros import SIMULATOR_PARAMETERS

    known = {*node_parameters(Arm.load("mtmr")), *SIMULATOR_PARAMETERS}
    models = dict.fromkeys(("namespace", "model", "left_model", "right_model"), "m")
    for node in launched(LAUNCH / f"{name}.launch.py", models).nodes:
        named = [name for part in node["parameters"] if isinstance(part, dict) for name in part]
        assert set(named) <= known


# Half a second and more, which a busy machine may stand still for.
PATIENT = ("-p", "timeout:=0.9", "-p", "watchdog_timeout:=1.0")
PLAYED = ("-p", "disable_builtin:=true", "-p", "max_stamp_age:=0.0", "-p", "ramp_time:=0.2")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_all_that_a_launch_file_started_ends_in_order_however_the_signals_come(domain, number):
    """Ctrl-C reaches every process at once, the simulated arm before those that have to hold it."""
    file = ("--params-file", str(MODEL_FILE))
    with (
        NodeProcess("simulator", "-p", "plant:=mtmr_28002") as arm,
        NodeProcess("watchdog", *file, *PATIENT) as watchdog,
        NodeProcess("compensator", *file, *PATIENT, *PLAYED) as compensator,
    ):
        end = time.monotonic() + 20.0
        while "commanding: compensating" not in compensator.output:
            assert time.monotonic() < end, compensator.output
            time.sleep(0.02)
        nodes = (arm, watchdog, compensator)
        for node in nodes:
            node.signal(number)
        assert [node.wait() for node in nodes] == [0, 0, 0]
        for node in nodes:
            assert "ERROR" not in node.output
            assert "Traceback" not in node.output


def test_a_simulated_arm_does_not_wait_for_ever_for_who_commands_it(domain):
    with NodeProcess("simulator") as arm, Client() as client:
        hold = client.node.create_publisher(Empty, "hold", 1)
        client.wait(lambda: client.connected(hold), "the arm")
        hold.publish(Empty())
        assert hold.wait_for_all_acked(Duration(seconds=5.0)), "it knows who could hold it"
        arm.signal(signal.SIGINT)
        time.sleep(1.0)
        assert arm.process.poll() is None, "it is there for a hold"
        client.node.destroy_publisher(hold)
        client.spin(0.5)
        assert arm.wait(2.0) == 0
