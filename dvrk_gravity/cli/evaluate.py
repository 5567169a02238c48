"""The error of a model on recordings, by joint; status 1 if it is unfit to compensate with."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from dvrk_gravity.cli import options
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import outputs, text_file

NAME = "evaluate"
EXAMPLE = "python -m dvrk_gravity evaluate other.csv --model model.yaml"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    options.add_recordings(parser)
    parser.add_argument(
        "--model", type=Path, required=True, help="model file; or a .urdf, for its masses"
    )
    parser.add_argument("--report", type=Path, help="HTML report to write")
    parser.add_argument("--json", type=Path, help="file for the result")
    parser.add_argument("--coordinates", choices=("joint", "actuator"),
                        help="coordinates of the recordings (default: detected)")  # fmt: skip
    options.add_drive_gains(parser)
    options.add_reading(parser)
    parser.add_argument("--verbose", action="store_true", help="print every finding and note")


def run(arguments: argparse.Namespace) -> int:
    """Evaluate, write the report and the JSON, and print the table.

    Returns:
        0, or 1 if the model is unfit to compensate with, by these errors or by the verdict in its
        file, or if the recordings are of the other arm.
    """
    from dvrk_gravity.identification import POOR, by_errors, evaluate
    from dvrk_gravity.model import TorqueModel
    from dvrk_gravity.observation import contradiction
    from dvrk_gravity.report import columns, evaluation_page, evaluation_text

    outputs.check(
        {"--report": arguments.report, "--json": arguments.json},
        [*arguments.recordings, arguments.model],
    )
    model = options.model_with_drive_gains(TorqueModel.load(arguments.model), arguments)
    recordings = options.recordings(arguments.recordings, arguments, model.arm)
    try:
        result = evaluate(model, recordings, arguments.coordinates)
    except ConfigError as error:
        raise error.in_file(arguments.model) from None
    if arguments.json is not None:
        text_file.write(arguments.json, json.dumps(result.to_json(), indent=1) + "\n")
    if arguments.report is not None:
        sources = ", ".join(str(path) for path in arguments.recordings)
        text_file.write(arguments.report, evaluation_page(result, model, sources))
    for line in evaluation_text(result, model, arguments.verbose, columns()):
        print(line)
    alone = by_errors(model.arm, result.joints, result.coordinates, result.with_friction)
    levels = {model.verdict, *(verdict.level for verdict in alone.values())}
    return int(POOR in levels or bool(contradiction(result.warnings)))
