"""Plan the motion that would teach most about an arm, or that separates causes, within limits."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from dvrk_gravity import command_line
from dvrk_gravity.cli import options
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import outputs, text_file

if TYPE_CHECKING:
    from dvrk_gravity.planning import MotionDesign, SeparationDesign

NAME = "plan"
EXAMPLE = (
    "python -m dvrk_gravity plan --arm mtmr --out plan.yaml\n"
    "         python -m dvrk_gravity plan --separate out/findings.json --out separate.yaml"
)

DURATIONS = (8.0, 600.0)  # s; as excite's
SECONDS = 100.0  # s; the same seed makes the same plan unless they run out
# s, by whether causes are to be separated, and whether by poses; see SeparationSettings
DEFAULTS = {
    (False, False): 60.0, (False, True): 600.0, (True, False): 40.0, (True, True): 120.0,
}  # fmt: skip
LONGEST_POSES = 7200.0  # s
TIMES = (1.0, 3600.0)  # s


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("--arm", help=f"{options.arms()}; without --separate")
    parser.add_argument("--separate", type=Path, metavar="FINDINGS",
                        help="findings.json of a diagnosis: plan what separates the causes that "
                        "it could not")  # fmt: skip
    parser.add_argument("--out", type=Path, required=True,
                        help="plan .yaml to write; its picture is written beside it, as "
                        ".png")  # fmt: skip
    parser.add_argument("--model", type=Path,
                        help="model .yaml of the arm: what it knows is not measured again, and "
                        "its efforts stay within limits; with --separate, the one that was "
                        "diagnosed (default: the file that the findings name)")  # fmt: skip
    parser.add_argument("--limits", type=Path,
                        help="limits .yaml: of joints, combinations of joints, and boxes to stay "
                        "out of (default: the arm's)")  # fmt: skip
    options.add_beyond_defaults(parser)
    parser.add_argument("--duration", type=float, metavar="S",
                        help="duration of the motion, s (default: 60; with --separate "
                        "40)")  # fmt: skip
    parser.add_argument("--poses", action="store_true",
                        help="slow poses, each from both sides, for a static calibration, instead "
                        "of a motion; --duration is the greatest (default: 600; with --separate "
                        "120)")  # fmt: skip
    parser.add_argument("--csv", type=Path, metavar="FILE",
                        help="file for positions and velocities at 1 kHz")  # fmt: skip
    parser.add_argument("--time", type=float, default=SECONDS, metavar="S",
                        help="time of one core after which the search ends, s (default: "
                        f"{SECONDS:g})")  # fmt: skip
    parser.add_argument("--seed", type=int, default=1, help="seed of the search (default: 1)")


def run(arguments: argparse.Namespace) -> int:
    """Search, write the plan, its picture and the CSV, and print what it promises.

    Returns:
        0, or 1 if no motion is expected to separate any of the causes.
    """
    from dvrk_gravity.arms import Arm
    from dvrk_gravity.planning import rediagnosis_command
    from dvrk_gravity.report import limits_text, plan_picture

    if not arguments.out.name:
        raise ConfigError("--out", str(arguments.out), "a .yaml file for the plan")
    separate = arguments.separate
    if (arguments.arm is None) == (separate is None):
        raise ConfigError("--arm", arguments.arm, "an arm, or --separate with findings.json")
    picture = arguments.out.with_suffix(".png")
    outputs.check(
        {"--out": arguments.out, "--out, its picture": picture, "--csv": arguments.csv},
        [
            *([] if arguments.arm is None else [Arm.file(arguments.arm)]),
            separate, arguments.model, arguments.limits,
        ],
    )  # fmt: skip
    if arguments.duration is None:
        arguments.duration = DEFAULTS[separate is not None, arguments.poses]
    longest = LONGEST_POSES if arguments.poses else DURATIONS[1]
    options.require_bounds(arguments, {"duration": (DURATIONS[0], longest), "time": TIMES})
    design, lines, enough = (_separating if separate else _informative)(arguments)
    plan, about = design.plan, arguments.arm or separate
    table = "\n".join(limits_text(design.slacks))
    plan.save(arguments.out, f"Planned by dvrk_gravity for {about}. Its limits:\n\n{table}")
    text_file.write_bytes(picture, plan_picture(plan))
    written = f"{arguments.out}, {picture}"
    if arguments.csv is not None:
        plan.write_csv(arguments.csv)
        written += f", {arguments.csv}"
    for line in lines:
        print(line)
    bag = (
        "my_bag" if separate is None else str(arguments.out.with_name(f"{arguments.out.stem}_bag"))
    )
    watched = f" --model {arguments.model}" if arguments.model and separate is None else ""
    watched += " --beyond-defaults" if arguments.beyond_defaults else ""
    following = "Next" if enough else "It is not expected to separate them; to try all the same"
    # Of an arm from a file it is not known what moves it.
    by_action = (
        "; or, by ros2_control, with --action NAME" if plan.arm.source != plan.arm.name else ""
    )
    print(
        f"written: {written}. {following}: collect {arguments.out} --out {bag}{watched}{by_action}"
    )
    if separate is not None:
        print(f"then: {rediagnosis_command(separate, bag, arguments.poses, arguments.model)}")
    return 0 if enough else 1


def _informative(
    arguments: argparse.Namespace,
) -> tuple[MotionDesign, Iterable[str], bool]:
    """Plan what teaches most."""
    from dvrk_gravity.arms import Arm
    from dvrk_gravity.planning import SolverSettings, design_motion, design_poses, series_basis
    from dvrk_gravity.report import design_text

    arm = Arm.load(arguments.arm)
    model = options.planned_model(arguments, arm)
    if model is not None:
        arm = model.arm
    limits = options.limits_of(arguments, arm)
    with command_line.Progress(NAME, 1.0) as progress:
        if arguments.poses:
            design = design_poses(
                arm, limits, arguments.duration, model, arguments.seed, report=progress.update
            )
        else:
            design = design_motion(
                arm, limits, series_basis(arguments.duration), model, arguments.seed,
                SolverSettings(seconds=arguments.time), progress.update,
            )  # fmt: skip
    had_model = model is not None and model.uncertainty is not None
    return design, design_text(design, had_model), True


def _separating(
    arguments: argparse.Namespace,
) -> tuple[SeparationDesign, Iterable[str], bool]:
    """Plan what separates causes."""
    from dvrk_gravity.planning import SeparationSettings, design_separation, load_unresolved
    from dvrk_gravity.report import separation_text

    unresolved = load_unresolved(arguments.separate, arguments.model)
    usual = SeparationSettings()
    seconds = min(usual.solver.seconds, arguments.time)
    settings = replace(usual, solver=replace(usual.solver, seconds=seconds))
    with command_line.Progress(NAME, 1.0) as progress:
        design = design_separation(
            unresolved, options.limits_of(arguments, unresolved.model.arm), arguments.duration,
            arguments.poses, arguments.seed, settings, progress.update,
        )  # fmt: skip
    return design, separation_text(design), design.separates
