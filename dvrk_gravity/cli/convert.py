"""Convert a recording (CSV, rosbag2), a dVRK console file (gc-*.json), or a model (URDF, MJCF)."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path

from dvrk_gravity.cli import options
from dvrk_gravity.errors import ConfigError, RecordingError
from dvrk_gravity.files import outputs
from dvrk_gravity.validation import is_urdf

NAME = "convert"
EXAMPLE = "python -m dvrk_gravity convert sweep.csv sweep_bag --topic /MTMR/measured_js"

MODEL_SUFFIXES = (".yaml", ".yml")
DESCRIPTIONS = (".urdf", ".xml", ".mjcf")
_TOPIC = "/measured_js"  # of a written bag, by default


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
        help="new .csv file or rosbag2 folder; model .yaml; gc-<ARM>-<SN>.json (version 2.0); "
        "a model as .urdf, or as MuJoCo's .xml or .mjcf",
    )
    parser.add_argument(
        "--check",
        metavar="FILE",
        type=Path,
        nargs="+",
        help="instead: check whether a console's files can be used (status 1: one needs a repair)",
    )
    parser.add_argument(
        "--json",
        metavar="REPORT",
        type=Path,
        help="also write a report: of --check, or of the differences between a model and a "
        "console's .json, a .urdf or an MJCF",
    )
    parser.add_argument(
        "--storage", choices=("sqlite3", "mcap"), default="sqlite3", help="format of a new bag"
    )
    options.add_reading(parser)


def run(arguments: argparse.Namespace) -> int:
    """Convert by the kind of the input and return 0, or return the check's status."""
    # Pinocchio and SciPy, which these load, are slow to load and --help needs neither.
    from dvrk_gravity.cli import convert_console
    from dvrk_gravity.recording import is_recording

    source, target = arguments.input, arguments.output
    if arguments.check is not None:
        if source is not None:
            raise ConfigError("--check", str(source), "no IN or OUT with it")
        return convert_console.check(arguments.check, arguments.json)
    if target is None:
        raise ConfigError("OUT", None, "IN and OUT, or --check FILE…")
    if target.suffix.lower() in DESCRIPTIONS:
        return _convert_model(source, target, arguments.json)
    if is_recording(source):
        return _convert_recording(arguments)
    kind = source.suffix.lower()
    if is_urdf(source) or (kind in MODEL_SUFFIXES and target.suffix.lower() in MODEL_SUFFIXES):
        return _convert_urdf(source, target, arguments.json)
    if kind in (".json", *MODEL_SUFFIXES):
        return convert_console.convert(source, target, arguments.json)
    raise RecordingError(
        source,
        "expected a recording (a .csv file, a rosbag2 folder, a .db3, .mcap or .bag file), "
        "a console's .json, a model's .yaml or an arm's .urdf",
    )


def _refuse_report(report: Path | None) -> None:
    if report is not None:
        raise ConfigError("--json", str(report), "--check, or a model, with it")


def _convert_recording(arguments: argparse.Namespace) -> int:
    """Convert a recording: CSV, rosbag2, ROS 1; print the numbers of samples read and left out."""
    from dvrk_gravity.recording import (
        Note,
        Samples,
        check_counts,
        is_bag,
        iterate_recording,
        save_recording,
    )

    _refuse_report(arguments.json)
    outputs.check({}, [arguments.input], {"OUT": arguments.output})
    samples = 0
    joints: tuple[str, ...] = ()
    notes: list[Note] = []

    def counted() -> Iterator[Samples]:
        nonlocal samples, joints
        given = options.reading(arguments)
        if not is_bag(arguments.input):
            given["topic"] = None  # of the bag that is written
        for part in iterate_recording(arguments.input, **given):
            samples += len(part)
            notes.extend(part.found)
            joints = part.joints
            yield part

    topic = arguments.topic or _TOPIC
    save_recording(counted(), arguments.output, arguments.storage, topic)
    for warning in check_counts(samples, notes):
        print(f"data: {warning}", file=sys.stderr)
    left_out = sum(each.left_out for each in notes)
    rest = f", {left_out} left out" if left_out else ""
    print(f"{arguments.output}: {samples} samples of {', '.join(joints)}{rest}")
    return 0


def _convert_model(source: Path, target: Path, report: Path | None) -> int:
    """Write a model, or what an arm's file states, as a URDF or an MJCF."""
    from dvrk_gravity.cli import convert_model

    if not is_urdf(source) and source.suffix.lower() not in MODEL_SUFFIXES:
        expected = f"a model's .yaml or an arm's .urdf, for {target.name}"
        raise ConfigError("IN", str(source), f"{expected} (a console's .json to a .yaml first)")
    return convert_model.convert(source, target, report)


def _convert_urdf(source: Path, target: Path, report: Path | None) -> int:
    """Write the model of a URDF's masses (of ``robot.urdf#LINK``, or a YAML that names one)."""
    from dvrk_gravity.cli.convert_console import expect_suffix
    from dvrk_gravity.model import TorqueModel

    _refuse_report(report)
    outputs.check({}, [source], {"OUT": target})
    expect_suffix(target, MODEL_SUFFIXES)
    model = TorqueModel.load(source)
    if not model.of_file:
        expected = "an arm's .urdf, or a .yaml with one"
        raise ConfigError("IN", "a model's parameters", expected, source)
    for doubt in model.arm.warnings:
        print(f"warning: {source}: {doubt}", file=sys.stderr)
    model.save(target, f"The masses stated by {source.name}; nothing was measured.")
    print(f"{target}: {model.arm.name}, {' + '.join(term.NAME for term in model.terms)}")
    return 0
