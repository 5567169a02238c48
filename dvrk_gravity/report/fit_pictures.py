"""Pictures of a fit as data URLs: measured against predicted torque, and what is left over."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from dvrk_gravity.arms import Joint
from dvrk_gravity.arrays import Array
from dvrk_gravity.identification import Trace
from dvrk_gravity.report.charts import Curve, Panel, chart
from dvrk_gravity.report.html import data_url
from dvrk_gravity.report.units import effort_in_picture

SHOWN = 15.0  # s of a trajectory
DOTS = 4000
_HEIGHT = 260.0  # px
BINS = 25
MEASURED, PREDICTED, DIFFERENCE = "#7f8fa6", "#c0392b", "#2c3e50"


def torque_pictures(trace: Trace, joints: Sequence[Joint]) -> Iterator[str]:
    """Yield measured and predicted torque of each joint over time, or over the pose number."""
    for column, joint in enumerate(joints):
        yield data_url(chart([[_torque(trace, column, joint)]], _HEIGHT))


def _torque(trace: Trace, column: int, joint: Joint) -> Panel:
    if trace.time is None:
        x = np.arange(len(trace.measured), dtype=float)
        shown = np.argsort(trace.measured[:, column])
        across = "pose, in the order of measured torque"
    else:
        x = trace.time
        shown = np.flatnonzero(x < x[0] + SHOWN)
        x = x[shown]
        across = "time [s]"
    measured, predicted = trace.measured[shown, column], trace.predicted[shown, column]
    unit, factor = effort_in_picture(joint, measured, predicted)
    word = "predicted, held out" if trace.held_out else "predicted"
    curves = (
        Curve(x, factor * measured, MEASURED, 2.2, "measured"),
        Curve(x, factor * predicted, PREDICTED, 1.4, word),
        Curve(x, factor * (measured - predicted), DIFFERENCE, 1.0, "difference"),
    )
    word = "force" if joint.kind == "prismatic" else "torque"
    return Panel(curves, across, f"{word} [{unit}]")


def residual_pictures(traces: Sequence[Trace], joints: Sequence[Joint]) -> Iterator[str]:
    """Yield the difference of each joint over its position and its velocity."""
    positions = np.concatenate([trace.position for trace in traces])
    velocities = [trace.velocity for trace in traces if trace.velocity is not None]
    against = [("position", "", positions)]
    if len(velocities) == len(traces):
        against.append(("velocity", "/s", np.concatenate(velocities)))
    residual = np.concatenate([trace.measured - trace.predicted for trace in traces])
    for column, joint in enumerate(joints):
        unit, factor = effort_in_picture(joint, residual[:, column])
        panels = [
            Panel(
                tuple(_scattered(x[:, column], factor * residual[:, column])),
                f"{label} [{joint.unit}{rate}]", "" if number else f"difference [{unit}]",
                zero=True,
            )
            for number, (label, rate, x) in enumerate(against)
        ]  # fmt: skip
        yield data_url(chart([panels], _HEIGHT))


def _scattered(x: Array, y: Array) -> Iterator[Curve]:
    """Yield samples, and the means of those of each bin that has some."""
    step = 1 + len(x) // DOTS
    yield Curve(x[::step], y[::step], MEASURED, 2.4, dots=True)
    if np.ptp(x) > 0.0:
        edges = np.linspace(x.min(), x.max(), BINS + 1)
        index = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, BINS - 1)
        count = np.bincount(index, minlength=BINS)
        used = count >= 5
        mean = np.bincount(index, y, minlength=BINS)[used] / count[used]
        yield Curve((0.5 * (edges[1:] + edges[:-1]))[used], mean, PREDICTED, 2.0)
