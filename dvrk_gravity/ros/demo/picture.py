"""The demonstration's picture: joint angles with and without compensation."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib
import numpy as np

from dvrk_gravity.ros.demo.scenario import Kill, Phase

matplotlib.use("Agg")
from matplotlib import pyplot as plt


def draw(
    path: Path,
    joints: Sequence[str],
    fall: Phase,
    floats: Sequence[Phase],
    pushed: Phase,
    rest: Phase,
    kill: Kill,
) -> None:
    """Draw how far the joints go from where they are let go of, each part in a panel."""
    figure, axes = plt.subplots(1, 4, figsize=(15, 4.6), sharey=True, layout="constrained")
    colours = [f"C{joint}" for joint in range(len(joints))]
    parts = (
        ("Without compensation", (fall,)),
        (f"With it, at {len(floats)} poses", floats),
        ("Pushed by hand, then left alone", (pushed, rest)),
        (f"Compensator killed: held after {kill.hold_after * 1e3:.0f} ms", (kill.after,)),
    )
    for axis, (title, phases) in zip(axes, parts, strict=True):
        for number, phase in enumerate(phases):
            # A part that goes on from another one is drawn on from it.
            going_on = title.startswith("Pushed") and number > 0
            start = phases[0].position[0] if going_on else phase.position[0]
            shift = phases[0].time[-1] if going_on else 0.0
            moved = np.degrees(phase.position - start)
            for joint, name in enumerate(joints):
                axis.plot(
                    phase.time + shift,
                    moved[:, joint],
                    color=colours[joint],
                    linestyle=("-", "--", ":")[0 if going_on else number % 3],
                    label=name if number == 0 else None,
                    linewidth=1.6,
                )
        axis.set_title(title, fontsize=11)
        axis.set_xlabel("time (s)")
        axis.grid(alpha=0.3)
        axis.axhline(0.0, color="0.3", linewidth=0.6)
    axes[0].set_ylabel("joint angle from where it was let go of (deg)")
    figure.legend(
        *axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=7, fontsize=9
    )
    figure.savefig(path, dpi=110)
    plt.close(figure)
