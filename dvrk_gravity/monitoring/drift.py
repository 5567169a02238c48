"""Torque that grows while nothing moves: amplifiers and sensors that warm up, not the arm."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from dvrk_gravity.arrays import Array
from dvrk_gravity.monitoring.observer import white_noise
from dvrk_gravity.monitoring.rows import Rows

_SHORTEST = 60.0  # s at rest, before a trend is looked for. Chosen: settling takes seconds
_MOST = 600  # means that are kept: ten minutes and more


@dataclass(frozen=True, eq=False)
class Trend:
    """A torque that grows linearly at one joint.

    Attributes:
        joint: Index of the joint.
        since: s.
        change: N·m, since then.
        error: Standard error of that, N·m.
    """

    joint: int
    since: float
    change: float
    error: float


@dataclass(frozen=True, eq=False)
class RestPeriod:
    """Means of the residual while an arm rests at one place.

    Attributes:
        q: (n,) where, rad or m.
        time: (k,) s.
        residual: (k, n) N·m.
    """

    q: Array
    time: Array
    residual: Array

    @classmethod
    def of(cls, rows: Rows, unexpected: Array) -> RestPeriod:
        """Return the period of one mean, of (K, n) rows and their torques at rest, N·m."""
        mean = unexpected.mean(axis=0)[None]
        return cls(rows.q.mean(axis=0), rows.time.mean(keepdims=True), mean)

    def extended_by(self, later: RestPeriod, farthest: Array) -> RestPeriod:
        """Return both periods as one; the later one if a joint moved farther than (n,) rad or m."""
        if np.any(np.abs(later.q - self.q) > farthest):
            return later
        time = np.concatenate([self.time, later.time])[-_MOST:]
        residual = np.concatenate([self.residual, later.residual])[-_MOST:]
        return replace(self, time=time, residual=residual)

    def trend(self, false_alarms: float, least: Array) -> Trend | None:
        """Return the clearest trend that is no chance and no minor one, if there is any.

        Args:
            false_alarms: Chance that one is found where there is only white noise.
            least: (n,) change that is minor, N·m.
        """
        duration = float(self.time[-1] - self.time[0])
        if duration < _SHORTEST:
            return None
        away = self.time - self.time.mean()
        square = float(away @ away)
        slope = away @ self.residual / square
        error = np.maximum(white_noise(self.residual), 1e-12) / np.sqrt(square)
        limit = chi2.isf(false_alarms / len(slope), 1)
        grown = ((slope / error) ** 2 > limit) & (np.abs(slope) * duration > least)
        if not grown.any():
            return None
        joint = int(np.argmax(np.where(grown, np.abs(slope) / error, 0.0)))
        change, spread = float(slope[joint]) * duration, float(error[joint]) * duration
        return Trend(joint, float(self.time[0]), change, spread)
