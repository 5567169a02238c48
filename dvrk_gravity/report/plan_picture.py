"""A picture of a plan: the joints over time, and the tip's path from three sides."""

from __future__ import annotations

import numpy as np

from dvrk_gravity.planning import Plan, link_origins, tip
from dvrk_gravity.report.html import png
from dvrk_gravity.report.units import position_in_picture

_POINTS = 2000
_PATH, _ENDS, _BOX = "#7f8fa6", "#c0392b", "#2c3e50"
_SIDES = (
    (0, 1, "from above"),
    (0, 2, "from the side (along y)"),
    (1, 2, "from the front (along x)"),
)


def plan_picture(plan: Plan) -> bytes:
    """Return a PNG: each joint with its limits, the tip's path, and boxes."""
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle

    arm, limits = plan.arm, plan.limits
    time = np.linspace(0.0, plan.duration, _POINTS)
    q, _, _ = plan.at(time)
    rows = (arm.n + 1) // 2
    figure = Figure(figsize=(11.0, 1.5 * rows + 4.0), layout="constrained")
    parts = figure.subfigures(2, 1, squeeze=False, height_ratios=[1.5 * rows, 4.0])
    upper, lower = parts[:, 0]
    grid = upper.subplots(rows, 2, sharex=True, squeeze=False)
    for k, axes in enumerate(grid.T.ravel()):
        if k >= arm.n:
            axes.set_axis_off()
            continue
        joint = arm.joints[k]
        unit, factor = position_in_picture(joint)
        axes.plot(time, factor * q[:, k], color=_PATH, linewidth=1.2)
        for limit in (limits.lower[k], limits.upper[k]):
            axes.axhline(factor * limit, color=_ENDS, linewidth=0.7, linestyle="--")
        axes.set_ylabel(f"{joint.name}\n[{unit}]", fontsize=8)
        axes.grid(alpha=0.25)
        axes.tick_params(labelbottom=k in (rows - 1, arm.n - 1))
    upper.supxlabel("time [s]", fontsize=10)
    upper.suptitle(f"{arm.name}, {plan.duration:.4g} s (dashed: limits)", fontsize=10)
    link = tip(arm)
    path = link_origins(arm, (link,), q)[:, 0]
    middle = 0.5 * (path.min(axis=0) + path.max(axis=0))
    half = 0.55 * max(float(np.ptp(path, axis=0).max()), 0.02)
    seen = f"path of {link} in the base frame (dot: start{'; dark: boxes' * bool(limits.boxes)})"
    lower.suptitle(seen, fontsize=10)
    for axes, (x, y, title) in zip(lower.subplots(1, 3), _SIDES, strict=True):
        axes.plot(path[:, x], path[:, y], color=_PATH, linewidth=0.8)
        axes.plot(path[0, x], path[0, y], "o", color=_ENDS, markersize=5)
        # One scale for all sides; a box may be far larger than the path.
        axes.set_xlim(middle[x] - half, middle[x] + half)
        axes.set_ylim(middle[y] - half, middle[y] + half)
        axes.set_aspect("equal")
        for box in limits.boxes:
            corner = box.lower[x], box.lower[y]
            sides = box.upper[x] - box.lower[x], box.upper[y] - box.lower[y]
            if all(0.0 < path[0, a] - c < s for a, c, s in zip((x, y), corner, sides, strict=True)):
                continue  # seen from here it is behind the path, or before it
            axes.add_patch(Rectangle(corner, *sides, color=_BOX, alpha=0.15))
        axes.set_xlabel(f"{'xyz'[x]} [m]")
        axes.set_ylabel(f"{'xyz'[y]} [m]")
        axes.set_title(title, fontsize=9)
        axes.grid(alpha=0.25)
    return png(figure)
