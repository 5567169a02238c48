"""Limits of an arm's free space, from a person who moves the arm to its corners."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.planning import PlanLimits

# Range that a joint gets at least, rad (Arm.scale), also if it was hardly moved: a plan needs some,
# and a person who moves the other joints lets it wander by as much. Chosen.
LEAST = float(np.radians(1.0))


class TaughtLimits:
    """Ranges of joints, and of their combinations that the arm limits, that were shown.

    What a plan then uses is all that lies within them, also where several joints are at their ends
    at once: corners that were not shown are taken to be free. An endless joint's range is where it
    was shown, less whole turns, and may lie about its back.

    Attributes:
        samples: Measurements that it has seen.
    """

    def __init__(self, arm: Arm) -> None:
        """Nothing is shown yet."""
        self._arm, self._own = arm, PlanLimits.of(arm)
        self._lowest = np.full(len(self._own.rows), np.inf)
        self._highest = -self._lowest
        endless = np.zeros(len(self._lowest), dtype=bool)
        endless[: arm.n] = ~np.isfinite(arm.upper - arm.lower)
        self._endless = endless  # (r,)
        self.samples = 0

    def show(self, position: Array) -> None:
        """Add (n,) or (N, n) measured positions, rad or m."""
        ways = np.atleast_2d(position) @ self._own.rows.T
        self._lowest = np.minimum(self._lowest, ways.min(axis=0))
        self._highest = np.maximum(self._highest, ways.max(axis=0))
        self.samples += len(ways)

    @property
    def coverage(self) -> dict[str, float]:
        """Part of its own range that each joint and combination was moved through."""
        lower, upper = self._own.range
        least, most = self._stops
        with np.errstate(invalid="ignore"):
            within = np.minimum(self._highest, most) - np.maximum(self._lowest, least)
            part = np.nan_to_num(np.clip(within / (upper - lower), 0.0, 1.0))
        return dict(zip(self._own.names, part.tolist(), strict=True))

    @property
    def _stops(self) -> tuple[Array, Array]:
        """(r,) least and (r,) greatest positions that can be taught."""
        lower, upper = self._own.range
        return np.where(self._endless, -np.inf, lower), np.where(self._endless, np.inf, upper)

    def limits(self, margin: float) -> PlanLimits:
        """Return the arm's limits, of which positions are within what was shown.

        Args:
            margin: Distance to the ends of what was shown, rad (``Arm.scale``); less where that
                would leave less than :data:`LEAST`, about the middle.
        """
        own, n = self._own, self._arm.n
        first = [np.flatnonzero(row)[0] for row in own.rows]
        scale = self._arm.scale[first]
        least, most = self._stops
        lower, upper = (np.clip(end, least, most) for end in (self._lowest, self._highest))
        middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
        middle -= np.where(self._endless, 2.0 * np.pi * np.round(middle / (2.0 * np.pi)), 0.0)
        half = np.maximum(half - margin * scale, 0.5 * LEAST * scale)
        lower, upper = np.maximum(middle - half, least), np.minimum(middle + half, most)
        combinations = tuple(
            replace(each, lower=float(lower[n + k]), upper=float(upper[n + k]))
            for k, each in enumerate(own.combinations)
        )
        return replace(own, lower=lower[:n], upper=upper[:n], combinations=combinations)
