"""Pictures of a fit as data URLs: measured against predicted torque, and what is left over."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from dvrk_gravity.arms import Joint
from dvrk_gravity.arrays import Array
from dvrk_gravity.identification import Trace
from dvrk_gravity.report.html import data_url, png
from dvrk_gravity.report.units import effort_in_picture

SHOWN = 15.0  # s of a trajectory
DOTS = 4000
_SIZE = (9.0, 2.8)  # inches
# Parts of a picture around its axes: room for numbers, labels and legend. Finding it, picture by
# picture, costs as much as drawing.
_ROOM = {"left": 0.09, "right": 0.985, "bottom": 0.18, "top": 0.91, "wspace": 0.05}
BINS = 25
MEASURED, PREDICTED, DIFFERENCE = "#7f8fa6", "#c0392b", "#2c3e50"


def torque_picture(trace: Trace, column: int, joint: Joint) -> str:
    """Return measured and predicted torque of one joint over time, or over the pose number."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=_SIZE)
    axes = figure.subplots(gridspec_kw=_ROOM)
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
    figure.legend(loc="upper right", ncols=3, fontsize=8, frameon=False)
    axes.grid(alpha=0.25)
    return data_url(png(figure, dpi=100))


def residual_picture(traces: Sequence[Trace], column: int, joint: Joint) -> str:
    """Return the difference of one joint over its position and its velocity."""
    from matplotlib.figure import Figure

    residual = np.concatenate([t.measured[:, column] - t.predicted[:, column] for t in traces])
    effort_unit, factor = effort_in_picture(joint, residual)
    unit = joint.unit
    panels = [(f"position [{unit}]", np.concatenate([t.position[:, column] for t in traces]))]
    velocities = [t.velocity[:, column] for t in traces if t.velocity is not None]
    if len(velocities) == len(traces):
        panels.append((f"velocity [{unit}/s]", np.concatenate(velocities)))
    figure = Figure(figsize=_SIZE)
    axes = np.atleast_1d(figure.subplots(1, len(panels), sharey=True, gridspec_kw=_ROOM))
    for ax, (label, x) in zip(axes, panels, strict=True):
        _scatter(ax, x, factor * residual)
        ax.set_xlabel(label)
        ax.locator_params(axis="x", nbins=7)  # numbers that do not touch
    axes[0].set_ylabel(f"difference [{effort_unit}]")
    return data_url(png(figure, dpi=100))


def _scatter(axes: Any, x: Array, y: Array) -> None:
    step = 1 + len(x) // DOTS
    axes.plot(x[::step], y[::step], ".", markersize=2.0, color=MEASURED)
    axes.axhline(0.0, color="#999999", linewidth=0.6)
    axes.grid(alpha=0.25)
    if np.ptp(x) > 0.0:
        edges = np.linspace(x.min(), x.max(), BINS + 1)
        index = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, BINS - 1)
        count = np.bincount(index, minlength=BINS)
        used = count >= 5
        mean = np.bincount(index, y, minlength=BINS)[used] / count[used]
        axes.plot((0.5 * (edges[1:] + edges[:-1]))[used], mean, color=PREDICTED, linewidth=1.5)
