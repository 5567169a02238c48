"""Calibrate an arm: plan, move, identify, check, diagnose, compensate, and certify."""

from __future__ import annotations

import argparse
import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from dvrk_gravity import command_line
from dvrk_gravity.cli import options
from dvrk_gravity.cli.collect import terminal_consent
from dvrk_gravity.cli.diagnose import STAGES as OF_DIAGNOSE
from dvrk_gravity.cli.identify import STAGES as OF_IDENTIFY
from dvrk_gravity.files import outputs

if TYPE_CHECKING:
    from dvrk_gravity.arms import Arm
    from dvrk_gravity.calibration import CalibrationSettings, Pages, Rig
    from dvrk_gravity.planning import PlanLimits

NAME = "calibrate"
EXAMPLE = (
    "python -m dvrk_gravity calibrate --arm mtmr --simulated --out out/mtmr\n"
    "         python -m dvrk_gravity calibrate --arm mtmr --namespace /MTMR --limits limits.yaml "
    "--out out/mtmr"
)

DURATIONS = (10.0, 120.0)  # s; below, hardly anything is identified
TIMES = (1.0, 120.0)  # s, for each plan
POSES = (1, 100)
# Evaluations per second of one fast core of a first plan: 7 (MTM, PSM) to 13 (UR5), measured on
# two busy cores. Those that use a model, about 1.
_PACE = 10.0
_STAGES = {"identify": OF_IDENTIFY, "diagnose": OF_DIAGNOSE}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("--arm", required=True, help=options.arms())
    parser.add_argument("--out", required=True, metavar="DIR",
                        help="folder for plans, recordings, models and the certificate; the same "
                        "command goes on with one that was interrupted")  # fmt: skip
    parser.add_argument(
        "--namespace", help="namespace of the arm's topics (default: its name: /MTMR)"
    )
    parser.add_argument("--timeout", type=float, default=0.1, metavar="S",
                        help="hold the arm after this long without measured_js, or without a "
                        "command, s (default: 0.1)")  # fmt: skip
    parser.add_argument("--simulated", nargs="?", const="", metavar="MODEL",
                        help="a simulated arm in this process, faster than real time, with errors "
                        "drawn by --seed: the arm's plant, or the one of a model or plant "
                        "file")  # fmt: skip
    parser.add_argument("--limits", type=Path,
                        help="limits .yaml: of joints, combinations of joints, and boxes to stay "
                        "out of (default: the arm's)")  # fmt: skip
    options.add_beyond_defaults(parser)
    parser.add_argument("--duration", type=float, default=60.0, metavar="S",
                        help="duration of the motion that is identified, s; those after it last "
                        "half of it, and two thirds (default: 60)")  # fmt: skip
    parser.add_argument("--poses", type=int, default=20, metavar="N",
                        help="poses at which the arm is released (default: 20)")  # fmt: skip
    parser.add_argument("--time", type=float, default=10.0, metavar="S",
                        help="effort of each plan: about this time of one fast core, s, for the "
                        "first, up to eight times as much for those that use a model; a number of "
                        "steps, so that the same seed plans the same (default: 10)")  # fmt: skip
    parser.add_argument(
        "--yes", action="store_true", help="consent beforehand: do not ask before the arm moves"
    )
    options.add_rehearsal(parser)
    parser.add_argument("--seed", type=int, default=1,
                        help="seed of plans, poses and simulated errors (default: 1)")  # fmt: skip


def run(arguments: argparse.Namespace) -> int:
    """Take the steps that are left.

    Returns:
        0, or 1 if the arm is not certified.
    """
    from dvrk_gravity.arms import Arm
    from dvrk_gravity.calibration import CERTIFICATE, Work, calibrate
    from dvrk_gravity.compensate import MotionError

    options.require_bounds(
        arguments,
        {"duration": DURATIONS, "time": TIMES, "poses": POSES, "timeout": options.TIMEOUTS},
    )
    options.refuse_ros_args(arguments)
    simulated = arguments.simulated is not None
    inputs = [Arm.file(arguments.arm), arguments.limits]
    out = outputs.check_folder("--out", arguments.out, (), inputs)
    arm = Arm.load(arguments.arm)
    limits = options.limits_of(arguments, arm)
    settings = _settings(arguments)
    rig = _rig(arguments, arm, settings)
    free = simulated or arguments.yes
    consent = (lambda question: True) if free else terminal_consent(rig)
    out.mkdir(parents=True, exist_ok=True)
    shown = command_line.ProgressBySteps(_STAGES)

    def report(line: str) -> None:
        shown.done()
        print(line, flush=True)

    requested = _requested_options(arguments)

    def limits_now() -> PlanLimits:
        if _requested_options(arguments) != requested:
            raise MotionError(f"{arguments.limits} or the arm's file has changed meanwhile")
        return limits

    work = Work(
        out, requested, arm, limits, rig, _pages(arm),
        arguments.namespace or f"/{arm.name.upper()}", arguments.seed, settings, limits_now,
        consent, report, shown,
    )  # fmt: skip
    try:
        certificate = calibrate(work)
    except BaseException as error:
        shown.done()
        if command_line.by_signal(error):
            print(
                f"dvrk_gravity {NAME}: interrupted: {_resume_hint(out)}",
                file=sys.stderr,
                flush=True,
            )
        raise
    print(f"written: {out / CERTIFICATE}, {(out / CERTIFICATE).with_suffix('.html')}")
    return 0 if certificate["certified"] else 1


def _resume_hint(out: Path) -> str:
    """Return in words what an interrupted calibration keeps, and how to resume it."""
    from dvrk_gravity.calibration import Logbook

    steps = Logbook.steps_in(out)
    if not steps:
        return f"no step is done yet; the same command begins again in {out}"
    count = f"{len(steps)} steps, the last {steps[-1]!r}" if len(steps) > 1 else repr(steps[0])
    return f"{count}, kept in {out}; the same command goes on from there"


def _settings(arguments: argparse.Namespace) -> CalibrationSettings:
    from dvrk_gravity.calibration import CalibrationSettings

    lasts = arguments.duration
    return CalibrationSettings(
        motion_duration=lasts, check_duration=max(lasts / 2.0, DURATIONS[0]),
        further_duration=max(lasts * 2.0 / 3.0, DURATIONS[0]), search=round(_PACE * arguments.time),
        poses=arguments.poses, rehearsal=options.wants_rehearsal(arguments),
    )  # fmt: skip


def _rig(arguments: argparse.Namespace, arm: Arm, settings: CalibrationSettings) -> Rig:
    from dvrk_gravity.calibration import SimulatedRig, draw_arm

    if arguments.simulated is None:
        # Here and not above: rclpy is slow to load, and bad arguments need none of it.
        from dvrk_gravity.ros import PRIVATE, RosRig, end_on_signals, namespace_of

        end_on_signals()
        namespace = namespace_of(arm, arguments.namespace)
        nobody = f"{namespace}/".startswith(f"{PRIVATE}/")  # no arm has such a name
        simulated = f"the node at {namespace}" if nobody else ""
        return RosRig(arm, namespace, arguments.timeout, simulated)
    plant = options.plant_of(arguments, arm)
    return SimulatedRig(draw_arm(plant, arguments.seed), arguments.seed, settings.friction)


def _requested_options(arguments: argparse.Namespace) -> dict[str, str]:
    """Return the requested value of each option, with the hash of each file."""
    from dvrk_gravity.arms import Arm
    from dvrk_gravity.calibration import file_hash

    def with_hash(name: str, path: Path | None) -> str:
        return name if path is None else f"{name} ({file_hash(path)[:16]})"

    def of_option(name: str) -> str:
        value = getattr(arguments, name)
        path = Path(str(value))
        return with_hash(str(value), path if value and path.is_file() else None)

    file = Arm.file(arguments.arm)
    return {
        "--arm": with_hash(arguments.arm, None if file is None else Path(file)),
        "--namespace": str(arguments.namespace),
        "--simulated": of_option("simulated"),
        "--limits": of_option("limits"),
        "--duration": f"{arguments.duration:g}",
        "--poses": str(arguments.poses),
        "--seed": str(arguments.seed),
    }


def _pages(arm: Arm) -> Pages:
    from dvrk_gravity.calibration import Pages
    from dvrk_gravity.report import (
        certificate_page,
        diagnosis_page,
        identification_page,
        plan_picture,
    )

    return Pages(
        plan_picture, identification_page, diagnosis_page, partial(certificate_page, arm=arm)
    )
