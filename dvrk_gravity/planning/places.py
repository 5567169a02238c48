"""Where an arm's links are, at many positions of its joints at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array


def link_origins(arm: Arm, links: Sequence[str], q: Array) -> Array:
    """Return the origins of links' frames in the base frame.

    Args:
        arm: The arm.
        links: Names of its bodies.
        q: (N, n) positions, rad or m.

    Returns:
        (N, links, 3) m.
    """
    coordinates = q @ arm.expand.T
    turns: list[Array] = []
    origins: list[Array] = []
    found: dict[str, Array] = {}
    for k, body in enumerate(arm.bodies):
        turn, origin = body.placement.rotation, body.placement.translation
        if body.parent >= 0:
            origin = origins[body.parent] + turns[body.parent] @ origin
            turn = turns[body.parent] @ turn
        along = coordinates[:, k]
        if body.kind == "prismatic":
            origin = origin + along[:, None] * turn[..., 2]
            turn = np.broadcast_to(turn, (len(q), 3, 3))
        else:
            c, s = np.cos(along), np.sin(along)
            about = np.zeros((len(q), 3, 3))
            about[:, 0, 0] = about[:, 1, 1] = c
            about[:, 1, 0], about[:, 0, 1] = s, -s
            about[:, 2, 2] = 1.0
            turn = turn @ about
        turns.append(turn)
        origins.append(np.broadcast_to(origin, (len(q), 3)))
        found[body.name] = origins[-1] + turn @ body.frame.translation
    return np.stack([found[link] for link in links], axis=1)


def levers(arm: Arm, links: Sequence[str], q: Array, step: float = 1e-6) -> Array:
    """Return (N, links, 3, n) derivatives of the origins by the joints' positions.

    Args:
        arm: The arm.
        links: Names of its bodies.
        q: (N, n) positions.
        step: Of the central difference, rad or m: its error is 1e-10 of the arm's reach.
    """
    sides = [
        (link_origins(arm, links, q + change) - link_origins(arm, links, q - change)) / (2.0 * step)
        for change in step * np.eye(arm.n)
    ]
    return np.stack(sides, axis=-1)


def tip(arm: Arm) -> str:
    """Return the name of the last link of the arm's chain."""
    last = max(
        range(len(arm.bodies)),
        key=lambda k: (np.flatnonzero(arm.bodies[k].row).max(initial=-1), -k),
    )
    return arm.bodies[last].name
