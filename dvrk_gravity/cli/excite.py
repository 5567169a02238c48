"""Move an arm, simulated or real, along a motion for identification, and record it."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from dvrk_gravity.cli import options
from dvrk_gravity.cli.collect import add_moving, carry_out, driver_of, finish
from dvrk_gravity.files import outputs

NAME = "excite"
EXAMPLE = "python -m dvrk_gravity excite --arm mtmr --out my_bag"

DURATIONS = (8.0, 600.0)  # s; below, a motion that eases in and out has hardly begun
MOTIONS = (1, 20)
SEED = 1
COVERED = 0.8  # part of a joint's range; less is reported. Chosen


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("--arm", required=True, help=options.arms())
    parser.add_argument("--out", type=Path, required=True, help="rosbag2 to write measured_js to")
    parser.add_argument("--duration", type=float, default=60.0, metavar="S",
                        help="duration of a motion, s (default: 60)")  # fmt: skip
    parser.add_argument("--seed", type=int, default=SEED,
                        help=f"seed of the first motion (default: {SEED})")  # fmt: skip
    parser.add_argument("--motions", type=int, default=1, metavar="N",
                        help="number of motions, each with its own seed and through the "
                        "joints' whole range (default: 1)")  # fmt: skip
    add_moving(parser)


def run(arguments: argparse.Namespace) -> int:
    """Plan motions through the whole range, and collect them: who calls it consents."""
    from dvrk_gravity.arms import Arm
    from dvrk_gravity.planning import coverage, covering_plan

    options.refuse_ros_args(arguments)
    outputs.check({}, [Arm.file(arguments.arm)], {"--out": arguments.out})
    arm = Arm.load(arguments.arm)
    options.require_bounds(arguments, {"duration": DURATIONS, "motions": MOTIONS})
    with driver_of(arm, arguments, NAME) as driver:
        seeds = range(arguments.seed, arguments.seed + arguments.motions)
        plans = [covering_plan(arm, arguments.duration, seed) for seed in seeds]
        part = coverage([plan.motion for plan in plans], plans[0].limits)
        least_covered = int(np.argmin(part))
        if part[least_covered] < COVERED:
            print(
                f"note: {arm.joint_names[least_covered]} covers {100 * part[least_covered]:.0f} % "
                "of its range: a longer --duration, or more --motions, would cover more",
                flush=True,
            )
        collected = carry_out(plans, driver, arguments)
    following = f"identify {collected.bag} --arm {arguments.arm} --out model.yaml"
    if arguments.seed != SEED:
        following += f"; or, with a model of another motion, evaluate {collected.bag} --model MODEL"
    finish(collected, following)
    return 0
