"""Tell the error of a model, joint by joint, on recordings."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

from dvrk_gravity import command_line
from dvrk_gravity.cli import arm_options
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import outputs, text_file

NAME = "evaluate"
EXAMPLE = "python -m dvrk_gravity evaluate other.csv --model model.yaml"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument(
        "recordings", metavar="RECORDING", type=Path, nargs="+",
        help="rosbag2 or CSV; all of them trajectories, or (no time column) static poses",
    )  # fmt: skip
    parser.add_argument(
        "--model", type=Path, required=True, help="model: a parameter file; or a .urdf: its masses"
    )
    parser.add_argument("--json", type=Path, help="file to write the result to")
    parser.add_argument("--coordinates", choices=("joint", "actuator"),
                        help="of the recordings (default: found out)")  # fmt: skip
    arm_options.add_drive_gains(parser)
    parser.add_argument("--topic", help="topic of bags, if they have several with JointStates")


def run(arguments: argparse.Namespace) -> int:
    """Evaluate, write the JSON and print the table."""
    from dvrk_gravity.identification import evaluate
    from dvrk_gravity.identification.table import evaluation_text
    from dvrk_gravity.model import TorqueModel
    from dvrk_gravity.recording import RecordingFile

    outputs.check({"--json": arguments.json}, [*arguments.recordings, arguments.model])
    model = arm_options.of_model(TorqueModel.load(arguments.model), arguments)
    recordings = [RecordingFile(path, arguments.topic) for path in arguments.recordings]
    try:
        result = evaluate(model, recordings, arguments.coordinates)
    except ConfigError as error:
        raise error.in_file(arguments.model) from None
    if arguments.json is not None:
        text_file.write(arguments.json, json.dumps(result.to_json(), indent=1) + "\n")
    for line in evaluation_text(result, model):
        print(line)
    return 0


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point of ``ros2 run dvrk_gravity evaluate``."""
    return command_line.run(__name__, argv)
