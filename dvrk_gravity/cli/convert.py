"""Convert a recording (CSV, rosbag2), a dVRK console file (gc-*.json) or a URDF's masses."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path

from dvrk_gravity import command_line
from dvrk_gravity.cli import arm_options
from dvrk_gravity.errors import ConfigError, RecordingError
from dvrk_gravity.validation import is_urdf

NAME = "convert"
EXAMPLE = "python -m dvrk_gravity convert sweep.csv sweep_bag --topic /MTMR/measured_js"

_YAML = (".yaml", ".yml")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    parser.add_argument(
        "input",
        metavar="IN",
        type=Path,
        nargs="?",
        help="CSV file, rosbag2 folder or file; the console's gc-<ARM>-<SN>.json; model .yaml; "
        "an arm's .urdf",
    )
    parser.add_argument(
        "output",
        metavar="OUT",
        type=Path,
        nargs="?",
        help="new .csv file or rosbag2 folder; model .yaml; gc-<ARM>-<SN>.json (version 2.0)",
    )
    parser.add_argument(
        "--check",
        metavar="FILE",
        type=Path,
        nargs="+",
        help="instead: can the console's files be used, and what to do? (status 1: one cannot be "
        "used as it is)",
    )
    parser.add_argument(
        "--json",
        metavar="REPORT",
        type=Path,
        help="also write there: answers and findings of --check; what a model loses in a "
        "console's .json",
    )
    parser.add_argument(
        "--storage", choices=("sqlite3", "mcap"), default="sqlite3", help="of a written bag"
    )
    arm_options.add_reading(parser)


def run(arguments: argparse.Namespace) -> int:
    """Convert by the kind of the input and return 0, or return the check's status."""
    if arguments.check is not None:
        from dvrk_gravity.cli import convert_console

        if arguments.input is not None:
            raise ConfigError("--check", str(arguments.input), "no IN or OUT beside it")
        return convert_console.check(arguments.check, arguments.json)
    if arguments.output is None:
        raise ConfigError("OUT", None, "IN and OUT, or --check FILE…")
    return _converter(arguments.input, arguments.output)(arguments)


def _converter(path: Path, target: Path) -> Callable[[argparse.Namespace], int]:
    # With SciPy and Pinocchio, each of these: not for --help.
    from dvrk_gravity.recording import is_recording

    if is_recording(path):
        from dvrk_gravity.cli import convert_recording

        return convert_recording.convert
    of_arm = path.suffix.lower() in _YAML and target.suffix.lower() in _YAML
    if of_arm or is_urdf(path):
        from dvrk_gravity.cli import convert_urdf

        return lambda arguments: convert_urdf.convert(
            arguments.input, arguments.output, arguments.json
        )
    if path.suffix.lower() in (".json", *_YAML):
        from dvrk_gravity.cli import convert_console

        return lambda arguments: convert_console.convert(
            arguments.input, arguments.output, arguments.json
        )
    raise RecordingError(
        path,
        "expected a recording (a .csv file, a rosbag2 folder, a .db3, .mcap or .bag file), "
        "a console's .json, a model's .yaml or an arm's .urdf",
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point of ``ros2 run dvrk_gravity convert``."""
    return command_line.run(__name__, argv)
