"""Node: makes an arm weightless (measured_js in, servo_jf out)."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from dvrk_gravity import command_line
from dvrk_gravity.ros.node_help import add_parameters

NAME = "compensator"
EXAMPLE = (
    "ros2 run dvrk_gravity compensator --ros-args -r __ns:=/MTMR --params-file mtmr_28002.yaml"
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments: all that there is to set are ROS parameters."""
    add_parameters(parser, NAME)


def run(arguments: argparse.Namespace) -> int:
    """Run the node until SIGINT or SIGTERM; return the exit status."""
    # Here and not above: rclpy and Pinocchio are slow to load and --help needs neither.
    from dvrk_gravity.ros import runtime
    from dvrk_gravity.ros.compensator_node import Compensator

    return runtime.spin(Compensator, arguments.ros_args)


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point of ``ros2 run dvrk_gravity compensator``."""
    return command_line.run("dvrk_gravity.ros.compensator", argv)
