"""What a motion teaches of the torques that no column has: where its joints have been.

A model lacks something everywhere: a cable of another shape, friction that differs from place to
place. Its columns alone would leave half of a joint's range unseen, where they need no second half.
"""

from __future__ import annotations

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import State
from dvrk_gravity.planning.information import Knowledge, Objective

PLACES = 8  # along a joint's range, with a torque of their own: as a cable of degree 7 has


class Everywhere(Objective):
    """Log det A of what is known, and of a torque at each of a joint's places beside it.

    That torque's prior standard deviation is the model's error, which is the noise, too. So T s at
    a place add log(1 + T / tau), with the error's correlation time tau. Between two places it is
    linear (a hat function each).
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
