"""An arm drawn as a chain of joints, those that a report speaks of in colour."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.planning import link_origins
from dvrk_gravity.report.html import escape, prose

Level = Literal["", "good", "fair", "poor"]
_LEVELS: tuple[Level, ...] = ("", "good", "fair", "poor")
_WIDTH, _HEIGHT, _RADIUS = 320.0, 220.0, 9.0  # of the drawing, and of a joint
_DEPTH, _SLANT = 0.35, 0.5  # of what points away from the reader: a cabinet projection, rad
_DIRECTIONS = 16  # in which a joint is moved aside that would cover another


@dataclass(frozen=True)
class Remark:
    """What a report says of a joint.

    Attributes:
        joint: Its name; ``""`` for the base, or the arm as a whole.
        text: In words, with figures.
        level: ``poor`` and ``fair`` are what to look at; ``""`` is neither good nor bad.
    """

    joint: str
    text: str
    level: Level = ""


def worst_level(levels: Iterable[Level]) -> Level:
    """Return the level that needs attention most; ``""`` of none."""
    return max(levels, key=_LEVELS.index, default="")


def arm_figure(arm: Arm, remarks: Iterable[Remark]) -> str:
    """Return the HTML of an arm's drawing, and of a list of its joints with what is said of them.

    Args:
        arm: The arm; it is drawn in the middle of its range, gravity downwards.
        remarks: Several for a joint are listed in their order, and the worst colours it.
    """
    remarks = list(remarks)
    worst = {
        name: worst_level(remark.level for remark in remarks if remark.joint == name)
        for name in ("", *arm.joint_names)
    }
    lines = []
    for name in arm.joint_names:
        remarks_text = "; ".join(remark.text for remark in remarks if remark.joint == name)
        text = f"<b>{escape(name)}</b>" + (f": {prose(remarks_text)}" if remarks_text else "")
        lines.append(f"<li{_class(worst[name])}>{text}</li>")
    whole = "".join(
        f"<p{_class(remark.level)}><b>the arm</b>: {prose(remark.text)}</p>"
        for remark in remarks
        if not remark.joint
    )
    concerned = [name for name, level in worst.items() if name and level in ("fair", "poor")]
    label = f"{arm.name}: {', '.join(concerned) or 'no joint'} marked"
    return (
        f'<section class="arm">{_svg(arm, worst, label)}\n'
        f"<div>{whole}<ol>{''.join(lines)}</ol></div></section>"
    )


def _class(level: str) -> str:
    return f' class="{level}"' if level else ""


def _svg(arm: Arm, worst: dict[str, Level], label: str) -> str:
    origins = _project(arm)
    base, places = origins[0], origins[1:]
    parts = [
        _line(places[body.parent] if body.parent >= 0 else base, place, "link")
        for body, place in zip(arm.bodies, places, strict=True)
    ]
    x, y = base
    parts.append(
        f'<path class="base{_and(worst[""])}" '
        f'd="M{x - 14:.1f} {y + 5:.1f}h28v-5h-8l-2 -5h-8l-2 5h-8z"/>'
    )
    # The body that a joint moves first; a parallelogram's joint moves several.
    first = [int(np.flatnonzero([body.row[k] for body in arm.bodies])[0]) for k in range(arm.n)]
    true = places[first]
    spread_places = _spread_places(true)
    moved = zip(true, spread_places, strict=True)
    parts += [_line(place, spot, "lead") for place, spot in moved if (spot != place).any()]
    for joint, (x, y), number in zip(arm.joints, spread_places, range(1, arm.n + 1), strict=True):
        shape = (
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{_RADIUS}"/>'
            if joint.kind == "revolute"
            else f'<rect x="{x - _RADIUS:.1f}" y="{y - _RADIUS:.1f}" width="{2 * _RADIUS}" '
            f'height="{2 * _RADIUS}"/>'
        )
        text = f'<text x="{x:.1f}" y="{y + 4:.1f}">{number}</text>'
        parts.append(f'<g class="joint{_and(worst[joint.name])}">{shape}{text}</g>')
    corners = np.vstack([origins, spread_places])
    size = np.maximum(np.ptp(corners, axis=0), (_WIDTH, _HEIGHT)) + 40.0
    left, top = 0.5 * (corners.min(axis=0) + corners.max(axis=0) - size)
    box = f"{left:.0f} {top:.0f} {size[0]:.0f} {size[1]:.0f}"
    return f'<svg viewBox="{box}" role="img" aria-label="{escape(label)}">{"".join(parts)}</svg>'


def _and(level: str) -> str:
    return f" {level}" if level else ""


def _line(start: Array, end: Array, kind: str) -> str:
    (a, b), (c, d) = start, end
    return f'<line class="{kind}" x1="{a:.1f}" y1="{b:.1f}" x2="{c:.1f}" y2="{d:.1f}"/>'


def _project(arm: Arm) -> Array:
    """Return (1 + bodies, 2) places of the base and of the bodies' origins in the drawing."""
    lower, upper = arm.range
    middle = 0.5 * (lower + upper)[None]
    points = np.vstack([np.zeros(3), link_origins(arm, arm.body_names, middle)[0]])
    up = -arm.gravity / np.linalg.norm(arm.gravity)
    height = points @ up
    level = points - height[:, None] * up
    # The arm is seen from where it is broadest, and reaches to the right.
    right = np.linalg.svd(level - level.mean(axis=0))[2][0]
    right -= (right @ up) * up
    right /= np.linalg.norm(right)
    if (level @ right).sum() < 0.0:
        right = -right
    depth = _DEPTH * (level @ np.cross(up, right))
    drawn = np.column_stack(
        [level @ right + depth * math.cos(0.5), -height - depth * math.sin(0.5)]
    )
    size = np.ptp(drawn, axis=0)
    scale = min(_WIDTH / max(size[0], 1e-9), _HEIGHT / max(size[1], 1e-9))
    return np.asarray(scale * (drawn - drawn.min(axis=0)) if size.any() else drawn)


def _spread_places(places: Array) -> Array:
    """Return (n, 2) places near the given ones at which no joint covers another."""
    found: list[Array] = []
    for place in places:
        found.append(next(spot for spot in _nearby_places(place) if _is_free(spot, found)))
    return np.array(found)


def _nearby_places(place: Array) -> Iterable[Array]:
    yield place
    for ring in itertools.count(1):
        for angle in np.linspace(0.0, 2.0 * np.pi, _DIRECTIONS, endpoint=False):
            yield place + ring * _RADIUS * np.array([np.cos(angle), np.sin(angle)])


def _is_free(spot: Array, taken: Sequence[Array]) -> bool:
    return all(np.linalg.norm(spot - other) > 2.2 * _RADIUS for other in taken)
