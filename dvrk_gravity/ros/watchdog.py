"""Node: holds the arm when its commands stop (a killed compensator, a vanished machine)."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from dvrk_gravity import command_line
from dvrk_gravity.ros.node_help import add_parameters

NAME = "watchdog"
EXAMPLE = "ros2 run dvrk_gravity watchdog --ros-args -r __ns:=/MTMR -p watchdog_timeout:=0.05"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments: all that there is to set are ROS parameters."""
    add_parameters(parser, NAME)


def run(arguments: argparse.Namespace) -> int:
    """Run the node until SIGINT or SIGTERM; return the exit status."""
    # Here and not above: rclpy and Pinocchio are slow to load and --help needs neither.
    from dvrk_gravity.ros import runtime
    from dvrk_gravity.ros.watchdog_node import Watchdog

    return runtime.spin(Watchdog, arguments.ros_args)


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point of ``ros2 run dvrk_gravity watchdog``."""
    return command_line.run("dvrk_gravity.ros.watchdog", argv)
