"""An objective that also makes a motion go through all of each joint's range.

Every model lacks something that depends on the position: a cable of another shape, friction that
differs along the range. The model's columns alone are determined by half of a range, and a motion
that is planned for them leaves out the other half.
"""

from __future__ import annotations

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import State
from dvrk_gravity.planning.information import Knowledge, Objective

PLACES = 8  # along a joint's range, with a torque of their own: as a cable of degree 7 has


class CoverageObjective(Objective):
    """Log det A of what is known, and of an unknown torque at each of several places of a joint.

    Its prior standard deviation is the model's error, and so is the noise. T s at a place therefore
    add log(1 + T / tau), with the error's correlation time tau. Between two places the torque is
    linear: each has a hat function.
    """

    def __init__(self, knowledge: Knowledge, lower: Array, upper: Array) -> None:
        """Lay out the places.

        Args:
            knowledge: The rest of A.
            lower: (n,) lowest positions of the motion, rad or m.
            upper: (n,) highest ones.
        """
        self.arm, self.noise = knowledge.arm, knowledge.noise
        self._knowledge, self._lower, self._upper = knowledge, lower, upper

    def regressor(self, state: State) -> Array:
        """Return the columns of what is known."""
        return self._knowledge.regressor(state)

    def score(self, gram: Array) -> tuple[float, Array]:
        """Return log det A of what is known, and its slope."""
        return self._knowledge.score(gram)

    def value(self, state: State, weight: Array) -> float:
        """Return log det A; see :class:`Objective`."""
        return self._knowledge.value(state, weight) + self._of_places(state.q, weight)[0]

    def gradient(self, state: State, weight: Array) -> tuple[float, tuple[Array, Array, Array]]:
        """Return log det A and its slopes; see :class:`Objective`."""
        value, (position, velocity, acceleration) = self._knowledge.gradient(state, weight)
        more, slope = self._of_places(state.q, weight)
        return value + more, (position + slope, velocity, acceleration)

    def _of_places(self, q: Array, weight: Array) -> tuple[float, Array]:
        apart = (self._upper - self._lower) / PLACES
        places = self._lower[:, None] + apart[:, None] * (np.arange(PLACES) + 0.5)
        away = (q[..., None] - places) / apart[:, None]  # (N, n, places)
        share = np.maximum(0.0, 1.0 - np.abs(away))
        tau = self._knowledge.correlation[:, None]
        spent = np.einsum("N,Nnk->nk", weight, share)
        slope = -np.where(share > 0.0, np.sign(away), 0.0) / apart[:, None] / (tau + spent)
        return float(np.log1p(spent / tau).sum()), weight[:, None] * slope.sum(axis=-1)
