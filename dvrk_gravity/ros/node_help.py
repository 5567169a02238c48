"""The help of a node: all that there is to set are ROS parameters, which it lists."""

from __future__ import annotations

import argparse
from pathlib import Path


def parameter_file(node: str) -> Path:
    """Return the file with a node's parameters, a line each, as docs/parameter_table.py wrote it.

    Written beforehand: Pinocchio, which an arm needs and with it the defaults, is slow to load.
    """
    return Path(__file__).with_name("parameters") / f"{node}.txt"


def add_parameters(parser: argparse.ArgumentParser, node: str) -> None:
    """Declare a node's command line, whose help lists the parameters."""
    parser.usage = "%(prog)s [-h] [--ros-args …]"
    listed = parameter_file(node).read_text(encoding="utf-8")
    parser.epilog = (
        f"parameters, -p NAME:=VALUE or in a --params-file (defaults of mtmr):\n{listed}\n"
        f"and what a model file holds (docs/parameters.md)\n\n{parser.epilog}"
    )
