"""Move an arm along a plan and record it, or learn its free space from a person who moves it."""

from __future__ import annotations

import argparse
import os
import select
import sys
import termios
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from dvrk_gravity import command_line
from dvrk_gravity.cli import options
from dvrk_gravity.errors import ConfigError, DvrkGravityError
from dvrk_gravity.files import outputs

if TYPE_CHECKING:
    from dvrk_gravity.arms import Arm
    from dvrk_gravity.collecting import CollectedRecording, Driver
    from dvrk_gravity.planning import Plan, PlanLimits

NAME = "collect"
EXAMPLE = "python -m dvrk_gravity collect plan.yaml --namespace /MTMR --out my_bag"

RATES = (50.0, 500.0)  # Hz; below, steps are coarse; above, one Python process is late
# A motion may take longer by this, s, and count as undisturbed. Chosen: a measurement every 10 ms
# and one late step of 20 ms lie within.
PAUSED = 0.05
_ASK_EVERY = 0.1  # s, to see a signal while a question waits for its answer


def add_moving(parser: argparse.ArgumentParser) -> None:
    """Declare how an arm is moved."""
    parser.add_argument(
        "--namespace", help="namespace of the arm's topics (default: its name: /MTMR)"
    )
    parser.add_argument("--rate", type=float, default=200.0, metavar="HZ",
                        help="positions per second (default: 200); every measured_js is "
                        "recorded")  # fmt: skip
    parser.add_argument("--timeout", type=float, default=0.1, metavar="S",
                        help="hold the arm after this long without measured_js, s "
                        "(default: 0.1)")  # fmt: skip
    parser.add_argument("--action", metavar="NAME",
                        help="move an arm of ros2_control by this FollowJointTrajectory action, as "
                        "/joint_trajectory_controller/follow_joint_trajectory")  # fmt: skip
    parser.add_argument("--measured", default="joint_states", metavar="TOPIC",
                        help="with --action: where the arm measures (default: "
                        "joint_states)")  # fmt: skip
    options.add_rehearsal(parser)
    parser.add_argument(
        "--resume",
        action="store_true",
        help="go on where an earlier run with the same --out was stopped",
    )
    parser.add_argument("--simulated", nargs="?", const="", metavar="PLANT",
                        help="move a simulated arm in this process, faster than real time and "
                        "without ROS: the arm's plant, or that of a name or file")  # fmt: skip


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("plan", nargs="?", type=Path, help="plan .yaml, as `plan` writes it")
    parser.add_argument("--out", type=Path, help="rosbag2 to write measured_js to")
    parser.add_argument("--model", type=Path,
                        help="model .yaml of the arm: its efforts are watched against the "
                        "model's")  # fmt: skip
    parser.add_argument("--limits", type=Path,
                        help="limits .yaml to keep; before every phase the file is read again "
                        "(default: the plan's own)")  # fmt: skip
    options.add_beyond_defaults(parser)
    parser.add_argument(
        "--yes", action="store_true", help="consent beforehand: do not ask before the arm moves"
    )
    add_moving(parser)
    parser.add_argument("--teach", type=Path, metavar="LIMITS",
                        help="move nothing: write the free space that a person shows by moving "
                        "the arm to its corners, until Ctrl-C")  # fmt: skip
    parser.add_argument("--arm", help=f"with --teach: {options.arms()}")
    parser.add_argument("--from", dest="recording", type=Path, metavar="RECORDING",
                        help="with --teach: the positions of a recording")  # fmt: skip
    parser.add_argument("--margin", type=float, default=2.0, metavar="DEG",
                        help="with --teach: stay so far inside of what was shown, deg, or as far "
                        "at a lever of 0.1 m (default: 2)")  # fmt: skip


def run(arguments: argparse.Namespace) -> int:
    """Collect, or teach."""
    options.refuse_ros_args(arguments)
    if arguments.teach is not None:
        from dvrk_gravity.cli import teach

        return teach.run(arguments)
    for name in ("plan", "out"):
        if getattr(arguments, name) is None:
            expected = "a plan .yaml, or --teach" if name == "plan" else "a rosbag2 to write"
            raise ConfigError("PLAN" if name == "plan" else "--out", None, expected)
    for option, value in (("--arm", arguments.arm), ("--from", arguments.recording)):
        if value is not None:
            raise ConfigError(option, str(value), "--teach, which it is for")
    read = [arguments.plan, arguments.model, arguments.limits]
    outputs.check({}, read, {"--out": arguments.out})

    from dvrk_gravity.collecting import EffortSettings, fingerprint
    from dvrk_gravity.planning import Plan, load_limits

    beyond = arguments.beyond_defaults
    plan = Plan.load(arguments.plan, beyond)
    model = options.planned_model(arguments, plan.arm)
    if model is not None and model.uncertainty is None:
        print(
            f"note: {arguments.model} states no uncertainty: the arm is held where a motor's "
            f"effort differs from it by more than {100 * EffortSettings().margin:g} % of the "
            "motor's greatest. `identify` writes a model with its uncertainty",
            flush=True,
        )

    def limits() -> PlanLimits:
        if arguments.limits is not None:
            return load_limits(arguments.limits, plan.arm, beyond)
        now = Plan.load(arguments.plan, beyond)
        if fingerprint([now]) != fingerprint([plan]):
            raise ConfigError("", "another plan meanwhile", "the one that it began with",
                              arguments.plan)  # fmt: skip
        return now.limits

    limits()
    free = arguments.yes or arguments.simulated is not None
    with driver_of(plan.arm, arguments, NAME) as driver:
        collected = carry_out(
            [plan], driver, arguments, model=model, limits=limits,
            consent=(lambda question: True) if free else terminal_consent(driver),
        )  # fmt: skip
    following = (
        f"identify {collected.bag} --arm {plan.arm.source or plan.arm.name} --out model.yaml"
    )
    if arguments.model is not None:
        following = f"evaluate {collected.bag} --model {arguments.model}"
    finish(collected, following)
    return 0


@contextmanager
def driver_of(arm: Arm, arguments: argparse.Namespace, name: str) -> Iterator[Driver]:
    """Yield what moves the arm: through ROS as a node of a name, or in this process.

    Raises:
        ConfigError: An argument that is out of range.
    """
    options.require_bounds(arguments, {"rate": RATES, "timeout": options.TIMEOUTS})
    if arguments.simulated is not None:
        from dvrk_gravity.collecting import SimulatedDriver

        plant = options.plant_of(arguments, arm)
        with SimulatedDriver(plant, rate=arguments.rate) as driver:
            yield driver
        return
    # Here and not above: rclpy is slow to load, and bad arguments need none of it.
    from dvrk_gravity.ros import Client, Mover, TrajectoryMover, namespace_of, require_name

    if arguments.action is not None:
        for option in ("action", "measured"):
            require_name(f"--{option}", getattr(arguments, option))
        remap = {"measured_js": arguments.measured}
        with (
            Client(namespace_of(arm, arguments.namespace or "/"), name, remap) as client,
            TrajectoryMover(
                client, arm, arguments.action, arguments.rate, arguments.timeout
            ) as trajectory_mover,
        ):
            yield trajectory_mover
        return
    namespace = namespace_of(arm, arguments.namespace)
    with (
        Client(namespace, name) as client,
        Mover(client, arm, arguments.rate, arguments.timeout) as mover,
    ):
        yield mover


def carry_out(
    plans: Sequence[Plan], driver: Driver, arguments: argparse.Namespace, **how: object
) -> CollectedRecording:
    """Collect as the arguments say, with its progress on the terminal."""
    from dvrk_gravity.collecting import collect

    progress = command_line.ProgressBySteps()
    try:
        return collect(
            plans, driver, arguments.out, rehearse=options.wants_rehearsal(arguments),
            resume=arguments.resume, report=lambda line: print(line, flush=True),
            progress=progress, **how,  # type: ignore[arg-type]
        )  # fmt: skip
    finally:
        progress.done()


def finish(collected: CollectedRecording, following: str) -> None:
    """Print what was recorded, and what to do with it: a command."""
    if collected.excess_time > PAUSED:
        print(
            f"note: the motion took {collected.excess_time:.2f} s longer than its "
            f"{collected.seconds:g} s, because this computer was busy: accelerations differ from "
            "the plan; record again on an idle computer if the model is poor, or for `diagnose "
            "--reference`"
        )
    if collected.parts > 1:
        print(
            f"note: recorded in {collected.parts} parts: each later one takes up the motion where "
            "the one before was cut; between their stamps is a gap"
        )
    rate = collected.samples / (collected.seconds + collected.excess_time)
    print(
        f"recorded {collected.samples} messages, {rate:.0f} per second, in {collected.bag}; the "
        f"arm is held. Next: {following}"
    )


def terminal_consent(driver: object) -> Callable[[str], bool]:
    """Return a function that asks for consent on the terminal; Ctrl-C counts while it waits."""
    if sys.stdin is None or not sys.stdin.isatty():  # None: it is closed
        raise DvrkGravityError(
            "the arm is to move, and there is no terminal to ask on: consent beforehand with --yes"
        )

    def ask(question: str) -> bool:
        with suppress(termios.error):  # what was typed before a question is no answer to it
            termios.tcflush(sys.stdin, termios.TCIFLUSH)
        print(f"{question} [y/N] ", end="", flush=True)
        while not select.select([sys.stdin], [], [], _ASK_EVERY)[0]:
            if getattr(driver, "interrupted", False):
                raise KeyboardInterrupt
        # One line of a terminal; a buffer would hide the next one from select.
        answer = os.read(sys.stdin.fileno(), 1024).decode(errors="replace")
        return answer.strip().lower() in ("y", "yes")

    return ask
