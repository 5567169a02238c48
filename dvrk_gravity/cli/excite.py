"""Move an arm, simulated or real, along a motion for identification, and record it."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dvrk_gravity import command_line
from dvrk_gravity.cli import options
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import outputs

if TYPE_CHECKING:
    from dvrk_gravity.arms import Arm
    from dvrk_gravity.planning import Multisine
    from dvrk_gravity.ros import Mover

NAME = "excite"
EXAMPLE = "python -m dvrk_gravity excite --arm mtmr --out my_bag"

DURATIONS = (8.0, 600.0)  # s; below, a motion that eases in and out has hardly begun
MOTIONS = (1, 20)
RATES = (50.0, 500.0)  # Hz; below, steps are coarse; above, one Python process is late
TIMEOUTS = (0.02, 1.0)  # s; as the compensator's
# A motion may take longer by this, s, and count as undisturbed. Chosen: a measurement every 10 ms
# and one late step of 20 ms lie within.
PAUSED = 0.05
COVERED = 0.8  # part of a joint's range; less is reported. Chosen
REHEARSAL = 3.0  # times as long as the motion: a ninth of its acceleration
_JOINT_STATE = "sensor_msgs/msg/JointState"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("--arm", required=True, help=options.arms())
    parser.add_argument("--out", type=Path, required=True, help="rosbag2 to write measured_js to")
    parser.add_argument(
        "--namespace", help="namespace of the arm's topics (default: its name: /MTMR)"
    )
    parser.add_argument("--duration", type=float, default=60.0, metavar="S",
                        help="duration of a motion, s (default: 60)")  # fmt: skip
    parser.add_argument("--rate", type=float, default=200.0, metavar="HZ",
                        help="positions per second (default: 200); every measured_js is "
                        "recorded")  # fmt: skip
    parser.add_argument("--seed", type=int, default=1, help="seed of the first motion (default: 1)")
    parser.add_argument("--motions", type=int, default=1, metavar="N",
                        help="number of motions, each with its own seed and through the "
                        "joints' whole range (default: 1)")  # fmt: skip
    parser.add_argument("--timeout", type=float, default=0.1, metavar="S",
                        help="hold the arm after this long without measured_js, s "
                        "(default: 0.1)")  # fmt: skip
    parser.add_argument("--no-rehearsal", action="store_true",
                        help=f"skip the rehearsal of the motion at 1/{REHEARSAL:g} of its "
                        "speed")  # fmt: skip


def run(arguments: argparse.Namespace) -> int:
    """Approach, rehearse, move and record, hold."""
    from dvrk_gravity.arms import Arm

    if arguments.ros_args:
        raise ConfigError("--ros-args", " ".join(arguments.ros_args), "none: use --namespace")
    outputs.check({}, [Arm.file(arguments.arm)], {"--out": arguments.out})
    arm = Arm.load(arguments.arm)
    bounds = (
        ("duration", DURATIONS), ("motions", MOTIONS), ("rate", RATES), ("timeout", TIMEOUTS),
    )  # fmt: skip
    for name, (least, most) in bounds:
        if not least <= getattr(arguments, name) <= most:
            raise ConfigError(f"--{name}", getattr(arguments, name), f"{least:g} to {most:g}")
    if arguments.seed < 0:
        raise ConfigError("--seed", arguments.seed, "0 or more")

    # Here and not above: rclpy is slow to load, and bad arguments need none of it.
    from dvrk_gravity.ros import Client, Mover, namespace_of

    namespace = namespace_of(arm, arguments.namespace)
    with (
        Client(namespace, "excite") as client,
        Mover(client, arm, arguments.rate, arguments.timeout) as mover,
    ):
        count, seconds, longer = _drive(mover, arm, arguments)
    if longer > PAUSED:
        print(
            f"note: the motion took {longer:.2f} s longer than its {seconds:g} s, because "
            "this computer was busy: accelerations differ from the plan; record again on "
            "an idle computer if the model is poor, or for `diagnose --reference`"
        )
    print(
        f"recorded {count} messages, {count / (seconds + longer):.0f} per second, in "
        f"{arguments.out}; the arm is held. Next: identify {arguments.out} --arm {arguments.arm} "
        "--out model.yaml"
    )
    return 0


def _drive(mover: Mover, arm: Arm, arguments: argparse.Namespace) -> tuple[int, float, float]:
    """Return the number of recorded messages, the planned seconds, and the excess over them."""
    from dvrk_gravity.planning import MotionLimits, Move, coverage, covering_motion
    from dvrk_gravity.recording import BagWriter

    limits = MotionLimits.of(arm)
    seeds = range(arguments.seed, arguments.seed + arguments.motions)
    motions = [covering_motion(limits, arguments.duration, seed) for seed in seeds]
    part = coverage(motions, limits)
    least = int(np.argmin(part))
    if part[least] < COVERED:
        print(
            f"note: {arm.joint_names[least]} covers {100 * part[least]:.0f} % of its range: a "
            "longer --duration, or more --motions, would cover more",
            flush=True,
        )
    where, longer = mover.connect(), 0.0
    # A continuous joint stays within its present turn.
    endless = ~np.isfinite(arm.upper - arm.lower)
    turns = np.where(endless, 2.0 * np.pi * np.round(where / (2.0 * np.pi)), 0.0)
    motions = [replace(motion, middle=motion.middle + turns) for motion in motions]
    # Opened before anything moves: errors in writing show, and no time is lost later.
    with BagWriter(arguments.out) as bag:
        bag.add_topic(mover.topic, _JOINT_STATE)

        def record(data: bytes) -> None:
            bag.write(mover.topic, _JOINT_STATE, data, time.time_ns())

        for number, motion in enumerate(motions, start=1):
            of = f" {number} of {len(motions)}" if len(motions) > 1 else ""
            begin, _ = motion.at(0.0)
            # Half of the limits: the approach passes through untested space.
            approach = Move(where, begin, 0.5 * limits.velocity, 0.5 * limits.acceleration)
            _follow(mover, f"approach{of}", approach.at, approach.duration)
            if not arguments.no_rehearsal:
                slowly = REHEARSAL * motion.duration
                _follow(mover, f"rehearsal{of}", partial(_slowly, motion), slowly)
            longer += _follow(mover, f"motion{of}, recorded", motion.at, motion.duration, record)
            where, _ = motion.at(motion.duration)
        mover.hold()  # before the bag is closed, which may take time on a slow disk
        return bag.count, len(motions) * arguments.duration, longer


def _slowly(motion: Multisine, moment: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a motion's (n,) position and velocity at a moment of its rehearsal."""
    position, velocity = motion.at(moment / REHEARSAL)
    return position, velocity / REHEARSAL


def _follow(
    mover: Mover,
    what: str,
    path: Callable[[float], tuple[np.ndarray, np.ndarray]],
    duration: float,
    record: Callable[[bytes], None] | None = None,
) -> float:
    print(f"{what}: {duration:.0f} s; Ctrl-C holds the arm", flush=True)
    progress = command_line.Progress(what, 100)
    try:
        return mover.follow(path, duration, record, lambda part: progress.update(round(100 * part)))
    finally:
        progress.done()
