"""The demonstration's picture: where the joints go, with and without compensation."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.report import shown_position
from dvrk_gravity.ros.demo.scenario import Kill, Phase

matplotlib.use("Agg")
from matplotlib import pyplot as plt

Part = tuple[str, Sequence[Phase]]
_STYLES = ("-", "--", ":")


def draw(
    path: Path,
    arm: Arm,
    fall: Phase,
    floats: Sequence[Phase],
    pushed: Phase,
    rest: Phase,
    kill: Kill,
) -> None:
    """Draw how far the joints go from where they are let go of, each part in a panel.

    Joints that turn are in the first row, in deg; those that slide in a second one, in mm.
    """
    parts: tuple[Part, ...] = (
        ("Without compensation", (fall,)),
        (f"With it, at {len(floats)} poses", floats),
        ("Pushed by hand, then left alone", (pushed, _going_on(pushed, rest))),
        (f"Compensator killed: held after {kill.hold_after * 1e3:.0f} ms", (kill.after,)),
    )
    units = shown_position(arm)
    rows = tuple(dict.fromkeys(units))
    figure, grid = plt.subplots(
        len(rows), len(parts), figsize=(15, 1.2 + 3.4 * len(rows)), sharey="row", sharex="col",
        squeeze=False, layout="constrained",
    )  # fmt: skip
    for (factor, unit), axes in zip(rows, grid, strict=True):
        joints = [joint for joint in range(arm.n) if units[joint] == (factor, unit)]
        for axis, (_, phases) in zip(axes, parts, strict=True):
            _panel(axis, arm, joints, phases, factor)
        axes[0].set_ylabel(f"way from where it was let go of ({unit})")
    for axis, (title, _) in zip(grid[0], parts, strict=True):
        axis.set_title(title, fontsize=11)
    for axis in grid[-1]:
        axis.set_xlabel("time (s)")
    handles = [line for axes in grid for line in axes[0].get_legend_handles_labels()[0]]
    figure.legend(handles=handles, loc="outside lower center", ncols=7, fontsize=9)
    figure.savefig(path, dpi=110)
    plt.close(figure)


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


def _going_on(first: Phase, then: Phase) -> Phase:
    """Return a phase as the continuation of another: in its time, from where that began."""
    position = np.vstack([first.position[:1], then.position])
    time = np.concatenate([[np.nan], first.time[-1] + then.time])
    return Phase(then.title, time, position)
