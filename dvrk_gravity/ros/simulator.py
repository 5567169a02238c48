"""Node: an arm as seen from ROS, simulated in real time."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from dvrk_gravity import command_line
from dvrk_gravity.ros.node_help import add_parameters

NAME = "simulator"
EXAMPLE = "ros2 run dvrk_gravity simulator --ros-args -r __ns:=/MTMR -p friction_scale:=0.1"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments: all that there is to set are ROS parameters."""
    add_parameters(parser, NAME)


def run(args: argparse.Namespace) -> int:
    """Run the node until SIGINT or SIGTERM; return the exit status."""
    # Here and not above: rclpy and Pinocchio are slow to load and --help needs neither.
    from dvrk_gravity.ros import runtime
    from dvrk_gravity.ros.simulator_node import Simulator

    return runtime.spin(Simulator, args.ros_args)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the verb and return its exit status."""
    return command_line.run("dvrk_gravity.ros.simulator", argv)


if __name__ == "__main__":
    sys.exit(main())
