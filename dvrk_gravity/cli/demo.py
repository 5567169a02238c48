"""See a simulated MTM fall, float, be pushed, and be held when its compensator is killed."""

from __future__ import annotations

import argparse
import shutil
import time
from collections.abc import Sequence
from pathlib import Path

from dvrk_gravity import command_line
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import outputs
from dvrk_gravity.files.resources import config_path

NAME = "demo"
EXAMPLE = "python -m dvrk_gravity demo --out out/demo"
PICTURE, BAG = "demo.png", "bag"  # in its folder


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("--out", type=Path, default=Path("demo"), help="folder for picture and bag")
    parser.add_argument("--model", type=Path, help="model (default: mtmr_28002)")
    parser.add_argument(
        "--friction-scale", type=float, default=1.0, help="factor on the simulated arm's friction"
    )


def run(arguments: argparse.Namespace) -> int:
    """Run the demonstration; print a table as it goes, then draw it."""
    # Here and not above: ROS and matplotlib are slow to load and --help needs neither.
    from dvrk_gravity.arms.mtm import is_mtm
    from dvrk_gravity.model import TorqueModel
    from dvrk_gravity.processes import private_domain
    from dvrk_gravity.ros.demo import picture
    from dvrk_gravity.ros.demo.scenario import POSES, Scenario

    model = arguments.model or config_path("mtmr_28002.yaml")
    outputs.check_folder("--out", arguments.out, [PICTURE], [model], [BAG])
    arm = TorqueModel.load(model).arm  # tells what is wrong with it before anything starts
    if not is_mtm(arm):
        raise ConfigError("arm", arm.name, "a master arm, as the simulated one", model)
    arguments.out.mkdir(parents=True, exist_ok=True)
    bag = arguments.out / BAG
    if bag.exists():
        if not (bag / "metadata.yaml").is_file():
            raise ConfigError("--out", str(bag), "no such folder, or a bag of an earlier demo")
        shutil.rmtree(bag)
    start, joints = time.monotonic(), arm.joint_names
    with private_domain(), Scenario(model, joints, bag, arguments.friction_scale) as scenario:
        print("simulator, watchdog and compensator run as three processes\n")
        print(f"{'':34}largest distance of a joint from where it was let go of, deg")
        print(f"{'':34}{'yaw':>7}{'shoulder':>10}{'elbow':>7}{'platform':>10}"
              f"{'pitch':>7}{'yaw':>7}{'roll':>7}")  # fmt: skip
        fall = scenario.fall()
        _row(fall)
        floats = []
        for phase in scenario.floats():
            floats.append(phase)
            _row(phase)
        assert len(floats) == len(POSES)
        pushed, rest = scenario.push()
        _row(pushed)
        _row(rest)
        kill = scenario.kill()
        _row(kill.after)
    print(f"\nthe watchdog's hold came {kill.hold_after * 1e3:.0f} ms after the kill")
    target = arguments.out / PICTURE
    picture.draw(target, joints, fall, floats, pushed, rest, kill)
    print(f"picture: {target}\nbag:     {bag}\n{time.monotonic() - start:.0f} s in all")
    return 0


def _row(phase: object) -> None:
    from dvrk_gravity.ros.demo.scenario import Phase

    assert isinstance(phase, Phase)
    yaw, shoulder, elbow, platform, pitch, wrist_yaw, roll = phase.drift
    print(f"{phase.title:<34}{yaw:>7.2f}{shoulder:>10.2f}{elbow:>7.2f}{platform:>10.2f}"
          f"{pitch:>7.2f}{wrist_yaw:>7.2f}{roll:>7.2f}", flush=True)  # fmt: skip


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point of ``ros2 run dvrk_gravity demo``."""
    return command_line.run("dvrk_gravity.cli.demo", argv)
