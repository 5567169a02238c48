"""Plan the motion that would teach most about an arm, within its limits."""

from __future__ import annotations

import argparse
from pathlib import Path

from dvrk_gravity import command_line
from dvrk_gravity.cli import options
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import outputs, text_file

NAME = "plan"
EXAMPLE = "python -m dvrk_gravity plan --arm mtmr --out plan.yaml"

DURATIONS = (8.0, 600.0)  # s; as excite's
SECONDS = 100.0  # s; the same seed makes the same plan unless they run out
POSES_LAST, LONGEST_POSES = 600.0, 7200.0  # s
TIMES = (1.0, 3600.0)  # s


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("--arm", required=True, help=options.arms())
    parser.add_argument("--out", type=Path, required=True,
                        help="plan .yaml to write; its picture is written beside it, as "
                        ".png")  # fmt: skip
    parser.add_argument("--model", type=Path,
                        help="model .yaml of the arm: what it knows is not measured again, and "
                        "its efforts stay within limits")  # fmt: skip
    parser.add_argument("--limits", type=Path,
                        help="limits .yaml: of joints, combinations of joints, and boxes to stay "
                        "out of (default: the arm's)")  # fmt: skip
    parser.add_argument("--duration", type=float, metavar="S",
                        help="duration of the motion, s (default: 60)")  # fmt: skip
    parser.add_argument("--poses", action="store_true",
                        help="slow poses, each from both sides, for a static calibration, instead "
                        "of a motion; --duration is the greatest (default: 600)")  # fmt: skip
    parser.add_argument("--csv", type=Path, metavar="FILE",
                        help="file for positions and velocities at 1 kHz")  # fmt: skip
    parser.add_argument("--time", type=float, default=SECONDS, metavar="S",
                        help="time of one core after which the search ends, s (default: "
                        f"{SECONDS:g})")  # fmt: skip
    parser.add_argument("--seed", type=int, default=1, help="seed of the search (default: 1)")


def run(arguments: argparse.Namespace) -> int:
    """Search, write the plan, its picture and the CSV, and print what it promises."""
    from dvrk_gravity.arms import Arm
    from dvrk_gravity.model import TorqueModel
    from dvrk_gravity.planning import (
        PlanLimits,
        SolverSettings,
        design_motion,
        design_poses,
        load_limits,
        require_arm,
        series_basis,
    )
    from dvrk_gravity.report import design_text, plan_picture

    if not arguments.out.name:
        raise ConfigError("--out", str(arguments.out), "a .yaml file for the plan")
    picture = arguments.out.with_suffix(".png")
    outputs.check(
        {"--out": arguments.out, "--out, its picture": picture, "--csv": arguments.csv},
        [Arm.file(arguments.arm), arguments.model, arguments.limits],
    )
    if arguments.duration is None:
        arguments.duration = POSES_LAST if arguments.poses else 60.0
    longest = LONGEST_POSES if arguments.poses else DURATIONS[1]
    bounds = (("duration", (DURATIONS[0], longest)), ("time", TIMES))
    for name, (least, most) in bounds:
        if not least <= getattr(arguments, name) <= most:
            raise ConfigError(f"--{name}", getattr(arguments, name), f"{least:g} to {most:g}")
    if arguments.seed < 0:
        raise ConfigError("--seed", arguments.seed, "0 or more")
    arm = Arm.load(arguments.arm)
    model = None
    if arguments.model is not None:
        model = TorqueModel.load(arguments.model)
        require_arm(model, arm, str(arguments.model))
        model = model.physical()
        arm = model.arm
    given = arguments.limits
    limits = PlanLimits.of(arm) if given is None else load_limits(given, arm)
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
    design.plan.save(arguments.out, f"Planned by dvrk_gravity for {arguments.arm}.")
    text_file.write_bytes(picture, plan_picture(design.plan))
    written = f"{arguments.out}, {picture}"
    if arguments.csv is not None:
        design.plan.write_csv(arguments.csv)
        written += f", {arguments.csv}"
    for line in design_text(design, model is not None and model.uncertainty is not None):
        print(line)
    print(f"written: {written}. Next: collect {arguments.out} --out my_bag")
    return 0
