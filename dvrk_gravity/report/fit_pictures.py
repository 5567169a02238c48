"""Pictures of a fit as data URLs: measured against predicted torque, and what is left over."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from dvrk_gravity.arms import Arm, Joint
from dvrk_gravity.arrays import Array
from dvrk_gravity.identification import Trace
from dvrk_gravity.report.html import erase, escape, inline, legend, panel, picture, side_by_side
from dvrk_gravity.report.units import effort_in_picture, position_in_picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SHOWN = 15.0  # s of a trajectory
DOTS = 4000
BINS = 25
MEASURED, PREDICTED, DIFFERENCE = "#7f8fa6", "#c0392b", "#2c3e50"


def pictures_by_joint(traces: Sequence[Trace], arm: Arm) -> Iterator[str]:
    """Yield the HTML of each joint's pictures, under its name.

    Of several traces, the longest is shown over time; the differences of all are.

    Args:
        traces: Of the same joints.
        arm: Their arm.
    """
    longest = max(traces, key=lambda trace: len(trace.measured))
    joints = {joint.name: joint for joint in arm.joints}
    shown = [joints[name] for name in longest.joints]
    over_time, left = torque_pictures(longest, shown), residual_pictures(traces, shown)
    for name, torque, residual in zip(longest.joints, over_time, left, strict=True):
        yield f"<h3>{escape(name)}</h3>"
        yield side_by_side(
            picture(torque, f"measured and predicted torque of {name}"),
            *(
                picture(address, f"difference by {variable} of {name}")
                for variable, address in residual.items()
            ),
        )


def torque_pictures(trace: Trace, joints: Sequence[Joint]) -> Iterator[str]:
    """Yield measured and predicted torque of each joint over time, or over the pose number."""
    figure, axes = panel()
    for column, joint in enumerate(joints):
        _torque(axes, trace, column, joint)
        if not figure.legends:
            legend(figure, axes)
        yield inline(figure)
        erase(axes)


def _torque(axes: Axes, trace: Trace, column: int, joint: Joint) -> None:
    if trace.time is None:
        x = np.arange(len(trace.measured), dtype=float)
        shown = np.argsort(trace.measured[:, column])
        axes.set_xlabel("pose, in the order of measured torque")
    else:
        x = trace.time
        shown = np.flatnonzero(x < x[0] + SHOWN)
        x = x[shown]
        axes.set_xlabel("time [s]")
    measured, predicted = trace.measured[shown, column], trace.predicted[shown, column]
    unit, factor = effort_in_picture(joint, measured, predicted)
    axes.plot(x, factor * measured, color=MEASURED, linewidth=1.6, label="measured")
    word = "predicted, held out" if trace.held_out else "predicted"
    axes.plot(x, factor * predicted, color=PREDICTED, linewidth=1.0, label=word)
    axes.plot(
        x, factor * (measured - predicted), color=DIFFERENCE, linewidth=0.7, label="difference"
    )
    word = "force" if joint.kind == "prismatic" else "torque"
    axes.set_ylabel(f"{word} [{unit}]")


def residual_pictures(traces: Sequence[Trace], joints: Sequence[Joint]) -> Iterator[dict[str, str]]:
    """Yield the difference of each joint over its position and its velocity, by their names."""
    positions = np.concatenate([trace.position for trace in traces])
    velocities = [trace.velocity for trace in traces if trace.velocity is not None]
    panels = [("position", "", positions)]
    if len(velocities) == len(traces):
        panels.append(("velocity", "/s", np.concatenate(velocities)))
    residual = np.concatenate([trace.measured - trace.predicted for trace in traces])
    figure, axes = panel()
    for column, joint in enumerate(joints):
        effort_unit, factor = effort_in_picture(joint, residual[:, column])
        unit, scale = position_in_picture(joint)
        axes.set_ylabel(f"difference [{effort_unit}]")
        drawn = {}
        for label, rate, x in panels:
            _scatter(axes, scale * x[:, column], factor * residual[:, column])
            axes.set_xlabel(f"{label} [{unit}{rate}]")
            drawn[label] = inline(figure)
            erase(axes)
        yield drawn


def _scatter(axes: Axes, x: Array, y: Array) -> None:
    step = 1 + len(x) // DOTS
    axes.plot(x[::step], y[::step], ".", markersize=2.0, color=MEASURED)
    axes.axhline(0.0, color="#999999", linewidth=0.6)
    if np.ptp(x) > 0.0:
        edges = np.linspace(x.min(), x.max(), BINS + 1)
        index = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, BINS - 1)
        count = np.bincount(index, minlength=BINS)
        used = count >= 5
        mean = np.bincount(index, y, minlength=BINS)[used] / count[used]
        axes.plot((0.5 * (edges[1:] + edges[:-1]))[used], mean, color=PREDICTED, linewidth=1.5)
