"""The nodes as verbs: their settings are ROS parameters, which their help lists."""

from __future__ import annotations

import argparse
from importlib import import_module
from pathlib import Path


def parameter_file(node: str) -> Path:
    """Return the file that lists a node's parameters, written by docs/parameter_table.py.

    Written beforehand: Pinocchio, which an arm and its defaults need, is slow to load.
    """
    return Path(__file__).with_name("parameters") / f"{node}.txt"


def parameters_help(node: str) -> str:
    """Return a node's parameters for its help."""
    table = parameter_file(node).read_text(encoding="utf-8")
    return (
        f"parameters, -p NAME:=VALUE or in a --params-file (defaults of mtmr):\n{table}\n"
        "and those of a model file (docs/parameters.md)"
    )


class NodeVerb:
    """Runs the class of its name in the module NAME_node."""

    NAME: str
    EXAMPLE: str

    @classmethod
    def add_arguments(cls, parser: argparse.ArgumentParser) -> None:
        """Declare the command line: --help lists the parameters."""
        parser.usage = "%(prog)s [-h] [--ros-args …]"
        parser.epilog = f"{parameters_help(cls.NAME)}\n\n{parser.epilog}"

    @classmethod
    def run(cls, arguments: argparse.Namespace) -> int:
        """Run the node until SIGINT or SIGTERM; return the exit status."""
        # rclpy and Pinocchio are slow to load, and --help needs neither.
        from dvrk_gravity.ros import runtime

        module = import_module(f"dvrk_gravity.ros.{cls.NAME}_node")
        return runtime.spin(getattr(module, cls.NAME.capitalize()), arguments.ros_args)


class CompensatorVerb(NodeVerb):
    """Node: makes an arm weightless (measured_js in, servo_jf out)."""

    NAME = "compensator"
    EXAMPLE = (
        "ros2 run dvrk_gravity compensator --ros-args -r __ns:=/MTMR --params-file mtmr_28002.yaml"
    )


class SimulatorVerb(NodeVerb):
    """Node: a simulated arm on its console's topics, in real time."""

    NAME = "simulator"
    EXAMPLE = "ros2 run dvrk_gravity simulator --ros-args -r __ns:=/MTMR -p friction_scale:=0.1"


class WatchdogVerb(NodeVerb):
    """Node: holds the arm when commands stop (a killed compensator, a crashed computer)."""

    NAME = "watchdog"
    EXAMPLE = "ros2 run dvrk_gravity watchdog --ros-args -r __ns:=/MTMR -p watchdog_timeout:=0.05"


class MonitorVerb(NodeVerb):
    """Node: says what pushes an arm and what changed in it; it commands nothing."""

    NAME = "monitor"
    EXAMPLE = "ros2 run dvrk_gravity monitor --ros-args -r __ns:=/MTMR --params-file model.yaml"
