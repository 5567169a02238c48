"""Watch a simulated arm fall, float, be pushed, be held, and get a load that a monitor names."""

from __future__ import annotations

import argparse
import shutil
import textwrap
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dvrk_gravity.cli import options
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import outputs

if TYPE_CHECKING:
    from dvrk_gravity.arms import Arm
    from dvrk_gravity.ros import Kill, MonitorRecord, Phase, Scenario

NAME = "demo"
EXAMPLE = "python -m dvrk_gravity demo --arm mtmr --out out/demo"
PICTURE, BAG = "demo.png", "bag"  # in its folder
_ARM = "mtmr"
_TITLES = 34  # width of their column
_STYLES = ("-", "--", ":")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("--out", default="demo", help="folder for picture and bag")
    parser.add_argument("--arm", help="a name, or an arm's .yaml or .urdf file (default: that of "
                        f"--model, or {_ARM})")  # fmt: skip
    parser.add_argument("--plant", default="", help="plant to simulate: its name or file, or a "
                        "model (default: the arm's plant)")  # fmt: skip
    parser.add_argument("--model", type=Path, help="the compensator's model (default: the one in "
                        "config/ for the arm, or else the plant's own terms)")  # fmt: skip
    parser.add_argument("--output", choices=("servo_jf", "array"), default="servo_jf",
                        help="type of the commands: JointState (default), or ros2_control's "
                        "array")  # fmt: skip
    parser.add_argument(
        "--friction-scale", type=float, default=1.0, help="factor on the simulated arm's friction"
    )


def run(arguments: argparse.Namespace) -> int:
    """Run the demonstration; print a table as it goes, then draw it."""
    # ROS is slow to load, and --help does not need it.
    from dvrk_gravity.arms import Arm
    from dvrk_gravity.ros import (
        MODEL,
        MONITORED,
        SIMULATOR_PARAMETERS,
        Scenario,
        Stage,
        end_on_signals,
        private_domain,
    )

    scale = SIMULATOR_PARAMETERS["friction_scale"]
    replace(scale, name="--friction-scale").check(arguments.friction_scale)
    of_arm = Arm.file(arguments.arm) if arguments.arm else None
    inputs = [arguments.model, of_arm, _file(arguments.plant)]
    written = [PICTURE, MONITORED] if arguments.model else [PICTURE, MONITORED, MODEL]
    out = outputs.check_folder("--out", arguments.out, written, inputs, [BAG])
    arm = _arm(arguments)  # reports its errors before anything starts
    out.mkdir(parents=True, exist_ok=True)
    stage = Stage.of(arm, arguments.plant, arguments.model, out)
    bag = out / BAG
    if bag.exists():
        if not (bag / "metadata.yaml").is_file():
            raise ConfigError("--out", str(bag), "a new folder, or a bag of an earlier demo")
        shutil.rmtree(bag)
    start = time.monotonic()
    end_on_signals()
    with (
        private_domain(),
        Scenario(stage, bag, arguments.friction_scale, arguments.output) as scenario,
    ):
        print(f"simulator, watchdog and compensator of {arm.name} run as three processes")
        own = " (the simulated arm's own terms, so it floats)" if stage.own_model else ""
        print(f"the compensator's model is {stage.model}{own}\n")
        parts = _play(scenario, arm)
    fall, floats, pushed, rest, kill, watched = parts
    print(f"\nthe watchdog sent hold {kill.hold_after * 1e3:.0f} ms after the kill")
    print(f"{watched.mass:g} kg fastened to {watched.link} while the arm moved; the monitor said:")
    for when, sentence in watched.events:
        print(f"  {when - watched.fastened:+.1f} s  {sentence}")
    for reason in scenario.interruptions:
        print(f"repeated a part because the compensator stopped: {reason}")
    target = out / PICTURE
    draw(target, arm, fall, floats, pushed, rest, kill, watched)
    print(f"picture: {target}\nbag:     {bag}\n{time.monotonic() - start:.0f} s in total")
    return 0


def _file(plant: str) -> Path | None:
    """Return a plant's file, ``None`` for one of the package."""
    from dvrk_gravity.validation import is_urdf, split_link

    file = Path(split_link(plant)[0])
    return file if is_urdf(file) or file.suffix.lower() in (".yaml", ".yml") else None


def _arm(arguments: argparse.Namespace) -> Arm:
    from dvrk_gravity.arms import Arm
    from dvrk_gravity.model import TorqueModel

    if arguments.arm or arguments.model is None:
        return Arm.load(arguments.arm or _ARM)
    model = TorqueModel.load(arguments.model)
    options.require_parameters(model, arguments.model)
    return model.arm


def _play(scenario: Scenario, arm: Arm) -> tuple:
    """Play all parts and print a row of each."""
    from dvrk_gravity.report import position_units
    from dvrk_gravity.units import fixed

    units = position_units(arm)
    widths = [max(len(name), 8) + 2 for name in arm.joint_names]
    print(f"{'':{_TITLES}}largest displacement of each joint from its release")
    for words in (arm.joint_names, tuple(unit for _, unit in units)):
        cells = (f"{word:>{width}}" for word, width in zip(words, widths, strict=True))
        print(" " * _TITLES + "".join(cells))

    def row(phase: Phase) -> Phase:
        values = (
            f"{fixed(factor * way, 2):>{width}}"
            for (factor, _), way, width in zip(units, phase.drift.tolist(), widths, strict=True)
        )
        print(f"{phase.title:<{_TITLES}}{''.join(values)}", flush=True)
        return phase

    fall = row(scenario.fall())
    floats = [row(phase) for phase in scenario.floats()]
    pushed, rest = (row(phase) for phase in scenario.push())
    scenario.begin_monitor()
    kill = scenario.kill()
    row(kill.after)
    return fall, floats, pushed, rest, kill, scenario.fasten()


def draw(
    path: Path, arm: Arm, fall: Phase, floats: Sequence[Phase], pushed: Phase, rest: Phase,
    kill: Kill, watched: MonitorRecord,
) -> None:  # fmt: skip
    """Draw the motion of the joints from their release, a panel for each part, and the load.

    Revolute joints are in the first row, in deg; prismatic ones in a second one, in mm. Below is
    the torque of the joint that the load changes most, beside what the monitor expected of it.
    """
    import matplotlib

    from dvrk_gravity.report import position_units

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    parts: tuple[tuple[str, Sequence[Phase]], ...] = (
        ("Without compensation", (fall,)),
        (f"With it, at {len(floats)} poses", floats),
        ("Pushed by hand, then released", (pushed, _continuation(pushed, rest))),
        (f"Compensator killed: held after {kill.hold_after * 1e3:.0f} ms", (kill.after,)),
    )
    units = position_units(arm)
    rows = tuple(dict.fromkeys(units))
    height = 1.2 + 3.4 * len(rows)
    figure = plt.figure(figsize=(15, height + 4.0), layout="constrained")
    halves: Any = figure.subfigures(2, 1, height_ratios=(height, 4.0))
    upper, lower = halves
    grid = upper.subplots(len(rows), len(parts), sharey="row", sharex="col", squeeze=False)
    _load(lower.add_subplot(), arm, watched)
    for (factor, unit), axes in zip(rows, grid, strict=True):
        joints = [joint for joint in range(arm.n) if units[joint] == (factor, unit)]
        for axis, (_, phases) in zip(axes, parts, strict=True):
            _panel(axis, arm, joints, phases, factor)
        axes[0].set_ylabel(f"displacement from release ({unit})")
    for axis, (title, _) in zip(grid[0], parts, strict=True):
        axis.set_title(title, fontsize=11)
    for axis in grid[-1]:
        axis.set_xlabel("time (s)")
    handles = [line for axes in grid for line in axes[0].get_legend_handles_labels()[0]]
    upper.legend(handles=handles, loc="outside lower center", ncols=7, fontsize=9)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _load(axis: Any, arm: Arm, watched: MonitorRecord) -> None:
    """Draw the torque of the joint that the load takes furthest out of the band."""
    after = watched.time > watched.fastened
    outside = np.median(np.abs(watched.measured - watched.expected)[after], axis=0)
    joint = int(np.argmax(outside / np.nanmedian(watched.deviation[after], axis=0)))
    expected, band = watched.expected[:, joint], 2.0 * watched.deviation[:, joint]
    axis.fill_between(watched.time, expected - band, expected + band, color="C0", alpha=0.3,
                      label="expected, 95 %")  # fmt: skip
    axis.plot(watched.time, expected, color="C0", linewidth=1.0)
    axis.plot(watched.time, watched.measured[:, joint], color="C3", linewidth=1.4, label="measured")
    axis.axvline(watched.fastened, color="0.2", linestyle="--",
                 label=f"{watched.mass:g} kg fastened to {watched.link}")  # fmt: skip
    for when, _ in watched.events:
        axis.axvline(when, color="C2", linewidth=1.6)
    sentences = (
        f"+{when - watched.fastened:.0f} s: {sentence}" for when, sentence in watched.events
    )
    text = "\n".join(textwrap.fill(each, 64) for each in sentences)
    axis.text(0.01, 0.96, text, va="top", fontsize=8,
              color="C2", transform=axis.transAxes)  # fmt: skip
    axis.set_xlim(watched.fastened - 10.0, max(watched.time[-1], watched.fastened + 15.0))
    axis.set_title(
        "A load is fastened while the arm moves; the monitor says what has changed", fontsize=11
    )
    axis.set_xlabel("time (s)")
    axis.set_ylabel(f"torque of {arm.joint_names[joint]} ({arm.effort_units[joint]})")
    axis.grid(alpha=0.3)
    axis.legend(loc="lower left", fontsize=9)


def _panel(
    axis: Any, arm: Arm, joints: Sequence[int], phases: Sequence[Phase], factor: float
) -> None:
    for number, phase in enumerate(phases):
        way = factor * (phase.position - phase.position[0])
        for joint in joints:
            axis.plot(
                phase.time, way[:, joint], color=f"C{joint}", linewidth=1.6,
                linestyle=_STYLES[number % len(_STYLES)],
                label=arm.joint_names[joint] if number == 0 else None,
            )  # fmt: skip
    axis.grid(alpha=0.3)
    axis.axhline(0.0, color="0.3", linewidth=0.6)


def _continuation(first: Phase, then: Phase) -> Phase:
    """Return a phase as the continuation of another, in its time and from its start."""
    position = np.vstack([first.position[:1], then.position])
    return replace(
        then, time=np.concatenate([[np.nan], first.time[-1] + then.time]), position=position
    )
