"""What pushes an arm, and what changed in it: of recordings, or, with none, as a node."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from dvrk_gravity.cli import options
from dvrk_gravity.command_line import Progress
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import outputs, text_file
from dvrk_gravity.ros import MonitorVerb, parameters_help

NAME = "monitor"
EXAMPLE = (
    f"python -m dvrk_gravity monitor my_bag --model my_arm.yaml\n         {MonitorVerb.EXAMPLE}"
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments; --help lists the node's parameters, too."""
    options.add_recordings(parser, required=False)
    parser.add_argument("--model", type=Path, help="model file; or a .urdf, for its masses")
    parser.add_argument("--json", type=Path, help="file for the result")
    parser.add_argument("--coordinates", choices=("joint", "actuator"),
                        help="coordinates of the recordings that do not state theirs (default: "
                        "joint)")  # fmt: skip
    options.add_drive_gains(parser)
    options.add_reading(parser)
    parser.epilog = f"without a recording it is a node;\n{parameters_help(NAME)}\n\n{parser.epilog}"


def run(arguments: argparse.Namespace) -> int:
    """Monitor recordings as fast as possible, or run the node until a signal ends it."""
    if not arguments.recordings:
        return _run_node(arguments)
    from dvrk_gravity.model import TorqueModel
    from dvrk_gravity.monitoring import monitor
    from dvrk_gravity.report import columns, monitor_json, monitor_text

    if arguments.model is None:
        raise ConfigError("--model", None, "a model file, beside recordings")
    outputs.check({"--json": arguments.json}, [*arguments.recordings, arguments.model])
    model = options.model_with_drive_gains(TorqueModel.load(arguments.model), arguments)
    recordings = options.recordings(arguments.recordings, arguments, model.arm)
    with Progress("monitoring", 1.0) as progress:
        seen = monitor(recordings, model, arguments.coordinates, progress=progress.update)
    if arguments.json is not None:
        text_file.write(arguments.json, json.dumps(monitor_json(seen), indent=1) + "\n")
    for line in monitor_text(seen, columns()):
        print(line)
    return 0


def _run_node(arguments: argparse.Namespace) -> int:
    """Run the node; what only recordings have is refused."""
    for option in ("model", "json", "coordinates"):
        if getattr(arguments, option) is not None:
            expected = "a recording beside it; a node takes --ros-args --params-file MODEL"
            raise ConfigError(f"--{option}", str(getattr(arguments, option)), expected)
    return MonitorVerb.run(arguments)
