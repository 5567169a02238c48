"""A picture of a plan: the joints over time, and the tip's path from three sides."""

from __future__ import annotations

import numpy as np

from dvrk_gravity.planning import Plan, link_origins, tip
from dvrk_gravity.report.html import png

_POINTS = 2000
_PATH, _ENDS, _BOX = "#7f8fa6", "#c0392b", "#2c3e50"
_SIDES = ((0, 1, "from above"), (0, 2, "from the side (along y)"), (1, 2, "from the front (along x)"))


def plan_picture(plan: Plan) -> bytes:
    """Return a PNG: each joint with its limits, the tip's path, and boxes."""
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle

    arm, limits = plan.arm, plan.limits
    time = np.linspace(0.0, plan.duration, _POINTS)
    q, _, _ = plan.at(time)
    rows = (arm.n + 1) // 2
    figure = Figure(figsize=(11.0, 1.5 * rows + 4.0), layout="constrained")
    upper, lower = figure.subfigures(2, 1, height_ratios=[1.5 * rows, 4.0])
    grid = upper.subplots(rows, 2, sharex=True, squeeze=False)
    for k, axes in enumerate(grid.T.ravel()):
        if k >= arm.n:
            axes.set_axis_off()
            continue
        joint = arm.joints[k]
        turns = joint.kind == "revolute"
        factor, unit = (np.degrees(1.0), "deg") if turns else (1e3, "mm")
        axes.plot(time, factor * q[:, k], color=_PATH, linewidth=1.2)
        for limit in (limits.lower[k], limits.upper[k]):
            axes.axhline(factor * limit, color=_ENDS, linewidth=0.7, linestyle="--")
        axes.set_ylabel(f"{joint.name}\n[{unit}]", fontsize=8)
        axes.grid(alpha=0.25)
        if k in (rows - 1, arm.n - 1):
            axes.set_xlabel("time [s]")
            axes.tick_params(labelbottom=True)
    link = tip(arm)
    path = link_origins(arm, (link,), q)[:, 0]
    for axes, (x, y, title) in zip(lower.subplots(1, 3), _SIDES, strict=True):
        axes.plot(path[:, x], path[:, y], color=_PATH, linewidth=0.8)
        axes.plot(path[0, x], path[0, y], "o", color=_ENDS, markersize=5)
        axes.set_aspect("equal", adjustable="datalim")
        axes.autoscale(False)  # a box may be far larger than the path
        for box in limits.boxes:
            corner = box.lower[x], box.lower[y]
            sides = box.upper[x] - box.lower[x], box.upper[y] - box.lower[y]
            axes.add_patch(Rectangle(corner, *sides, color=_BOX, alpha=0.15))
        axes.set_xlabel(f"{'xyz'[x]} [m]")
        axes.set_ylabel(f"{'xyz'[y]} [m]")
        axes.set_title(f"{link}, {title}", fontsize=9)
        axes.grid(alpha=0.25)
    return png(figure)

