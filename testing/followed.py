"""A planned motion as the servo of a simulated arm follows it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.planning import FourierMotion


@dataclass(frozen=True)
class Followed:
    """A planned motion, recorded from its beginning.

    Attributes:
        motion: The motion.
        ramp: For which the arm stands before it, s.
    """

    motion: FourierMotion
    ramp: float = 0.1

    def at(self, moment: Array | float) -> tuple[Array, Array]:
        """Return position and velocity."""
        q, qd, _ = self.motion.at(np.asarray(moment) - self.ramp)
        return q, qd
