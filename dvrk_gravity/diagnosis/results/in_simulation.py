"""What the simulator makes of the given and the extended model, as findings.json holds it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from dvrk_gravity.arrays import Array

WINDOW = 0.1  # s of open-loop prediction, which soon diverges
DURATION = 2.0  # s of drift, as long as the console watches it to accept a calibration


@dataclass(frozen=True, eq=False)
class Drift:
    """How an arm moves under compensation after release.

    Attributes:
        friction: Part of the arm's friction, and of its compensation, that is simulated.
        time: (T,) s.
        before: (P, T, n) displacement from each pose with the given model, rad or m.
        after: (P, T, n) the same with the extended model.
    """

    friction: float
    time: Array
    before: Array
    after: Array


@dataclass(frozen=True, eq=False)
class InSimulation:
    """The given and the extended model in the simulator.

    Attributes:
        joints: Names of the joints.
        units: Units of their positions.
        windows: Number of predicted pieces of held-out motion.
        before: (n,) RMS error of predicted positions after :data:`WINDOW` with the given model, rad
            or m; ``None`` where motion could not be simulated.
        after: (n,) the same with the extended model.
        drifts: One for each part of the arm's friction; none without compensation.
        notes: What was not simulated, and why.
    """

    joints: tuple[str, ...]
    units: tuple[str, ...]
    windows: int
    before: Array | None
    after: Array | None
    drifts: tuple[Drift, ...]
    notes: tuple[str, ...]

    def _by_joint(self, values: Array) -> dict[str, float]:
        return dict(zip(self.joints, values.tolist(), strict=True))

    def to_dict(self) -> dict[str, Any]:
        """Return its part of findings.json."""
        motion = None
        if self.before is not None and self.after is not None:
            motion = {
                "seconds": WINDOW,
                "windows": self.windows,
                "rmse_before": self._by_joint(self.before),
                "rmse_after": self._by_joint(self.after),
            }
        drifts = [
            {
                "friction": drift.friction,
                "seconds": DURATION,
                "poses": len(drift.before),
                "largest_before": self._by_joint(np.abs(drift.before).max(axis=(0, 1))),
                "largest_after": self._by_joint(np.abs(drift.after).max(axis=(0, 1))),
            }
            for drift in self.drifts
        ]
        units = dict(zip(self.joints, self.units, strict=True))
        return {"units": units, "motion": motion, "drift": drifts, "notes": list(self.notes)}
