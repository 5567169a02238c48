"""Identify a torque model from recordings; status 1 if it is unfit to compensate with.

Terms are chosen by held-out error.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, get_args

from dvrk_gravity import command_line
from dvrk_gravity.cli import options
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import outputs, text_file

if TYPE_CHECKING:
    from dvrk_gravity.observation import KnownPayload
    from dvrk_gravity.recording import Coordinates

NAME = "identify"
EXAMPLE = (
    "python -m dvrk_gravity identify exciting.csv --arm mtmr --out model.yaml\n"
    "         python -m dvrk_gravity identify currents.csv --arm robot.urdf --out model.yaml "
    "--drive-gains 14.9,13.3,11.1,10.6,11.0,11.5\n"
    "         python -m dvrk_gravity identify bare.csv loaded.csv --arm robot.urdf "
    "--known-payload 2.8 --out model.yaml"
)

# Share of the time at the beginning of each: of motions of a real MTM, PSM and UR10e (one to five
# seconds), and of static poses of a real MTM.
STAGES = (
    ("reading", 0.0),
    ("coordinates", 0.1),
    ("regressor", 0.25),
    ("choice of terms", 0.35),
    ("zeros and tilt", 0.5),
    ("choice of terms", 0.6),
    ("what all terms would leave", 0.8),
    ("held-out error", 0.0),
    ("fit", 0.8),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    options.add_recordings(parser)
    parser.add_argument("--arm", required=True, help=options.arms())
    parser.add_argument("--out", type=Path, required=True, help="model .yaml to write")
    parser.add_argument("--report", type=Path, help="HTML report (default: OUT with .html)")
    parser.add_argument("--json", type=Path, help="file for the result")
    parser.add_argument("--terms", help="comma-separated candidate effects (default: all)")
    parser.add_argument("--validate", metavar="RECORDING", type=Path, nargs="+", default=[],
                        help="recordings held out of the fit, to evaluate it")  # fmt: skip
    parser.add_argument("--coordinates",
                        help="joint or actuator, for all recordings or a comma-separated one for "
                        "each (default: detected)")  # fmt: skip
    options.add_at(parser)
    parser.add_argument("--physical", action=argparse.BooleanOptionalAction,
                        help="physically consistent links, positive definite pseudo-inertias "
                        "(default: of trajectories)")  # fmt: skip
    parser.add_argument("--for", dest="for_file", choices=("console", "urdf", "mjcf"),
                        help="only terms that `convert` can write to such a file, so that nothing "
                        "is lost there")  # fmt: skip
    parser.add_argument("--for-console", dest="for_file", action="store_const", const="console",
                        help="the same as --for console")  # fmt: skip
    options.add_drive_gains(parser)
    parser.add_argument("--known-payload", metavar="KG", type=float,
                        help="the last recording, and only that one, was made with a payload of "
                        "this mass, which determines the drive gains; the model is fitted to the "
                        "others")  # fmt: skip
    parser.add_argument("--payload-link", metavar="LINK",
                        help="link that carries the payload (default: the last "
                        "joint's)")  # fmt: skip
    parser.add_argument("--payload-centre", metavar="X,Y,Z",
                        help="the payload's centre of mass in the link's frame, m, if "
                        "known")  # fmt: skip
    parser.add_argument("--bias-is", metavar="[JOINT=]reading|torque",
                        help="what a constant torque is that dry friction does not hold, for all "
                        "joints or a comma-separated one for each: a bias of its reading, which is "
                        "not compensated, or a torque of a spring (default: the compensator's "
                        "first start checks it)")  # fmt: skip
    options.add_reading(parser)
    parser.add_argument("--verbose", action="store_true", help="print every finding and note")


def run(arguments: argparse.Namespace) -> int:
    """Fit, write the model, the report and the JSON, and print a summary.

    Returns:
        0, or 1 if the model, which is written nevertheless, is unfit to compensate with.
    """
    from dvrk_gravity.arms import Arm
    from dvrk_gravity.identification import identify
    from dvrk_gravity.model import VERDICTS, uncertainty_file
    from dvrk_gravity.report import columns, fit_text, identification_page
    from dvrk_gravity.validation import is_urdf

    if is_urdf(arguments.out) or not arguments.out.name:
        raise ConfigError("--out", str(arguments.out), "a .yaml file for the model")
    report = arguments.report or arguments.out.with_suffix(".html")
    uncertainty = uncertainty_file(arguments.out)
    outputs.check(
        {
            "--out": arguments.out,
            "--report": report,
            "--json": arguments.json,
            "--out, its uncertainty": uncertainty,
        },
        [*arguments.recordings, *arguments.validate, Arm.file(arguments.arm)],
    )
    arm = options.with_drive_gains(Arm.load(arguments.arm), arguments)
    carried = _known_payload(arguments)
    coordinates = _coordinates(arguments.coordinates)
    still = options.fixed_positions(arguments.at, arm)
    recordings = options.recordings(arguments.recordings, arguments, arm)
    options.require_as_recorded(arguments.at, still, recordings)
    validate = options.recordings(arguments.validate, arguments, arm)
    terms = arguments.terms.split(",") if arguments.terms else None
    with command_line.Progress(NAME, 1.0) as progress:
        stages = command_line.Stages(progress, STAGES)
        fit = identify(
            recordings, arm, coordinates, terms, validate, arguments.physical, stages, still,
            known_payload=carried, bias_is=arguments.bias_is, for_file=arguments.for_file,
        )  # fmt: skip
    sources = ", ".join(str(path) for path in arguments.recordings)
    fit.model.save(
        arguments.out,
        f"Identified by dvrk_gravity from {sources}.\n"
        f"Verdict: {fit.verdict.words}. {fit.verdict.reason}\n"
        "Held-out |e|/|tau|: "
        + ", ".join(f"{name} {error.nrmse:.3f}" for name, error in fit.held_out.items()),
    )
    text_file.write(report, identification_page(fit, sources))
    if arguments.json is not None:
        text_file.write(arguments.json, json.dumps(fit.to_json(), indent=1) + "\n")
    for line in fit_text(fit, arguments.verbose, columns()):
        print(line)
    print(f"written: {arguments.out}, {uncertainty} (its uncertainty), {report}")
    return int(fit.verdict.level == VERDICTS[-1])


def _known_payload(arguments: argparse.Namespace) -> KnownPayload | None:
    from dvrk_gravity.observation import KnownPayload

    link, centre = arguments.payload_link, arguments.payload_centre
    if arguments.known_payload is None:
        for option, value in (("--payload-link", link), ("--payload-centre", centre)):
            if value is not None:
                raise ConfigError(option, value, "--known-payload beside it")
        return None
    if centre is None:
        return KnownPayload(arguments.known_payload, link or "", None)
    x, y, z = options.numbers("--payload-centre", centre, 3)
    return KnownPayload(arguments.known_payload, link or "", (x, y, z))


def _coordinates(text: str | None) -> Coordinates | list[Coordinates] | None:
    if text is None:
        return None
    from dvrk_gravity.recording import Coordinates

    known: dict[str, Coordinates] = {system: system for system in get_args(Coordinates)}
    found = [known.get(name) for name in text.split(",")]
    sure = [system for system in found if system is not None]
    if len(sure) < len(found):
        raise ConfigError("--coordinates", text, "joint or actuator, one for all or for each")
    return sure[0] if len(sure) == 1 else sure
