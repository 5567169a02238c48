"""What a model on trial says of itself: how its parameters may move, and its known error."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.diagnosis.motion import Motion
from dvrk_gravity.effects import State

Array = NDArray[np.float64]


def model_columns(motion: Motion) -> Array:
    """Return (N, n, d) changes of the model's torque by changes of its parameters.

    In each of d independent directions, of one standard deviation each; none of a model that does
    not tell how sure it is.
    """
    model = motion.model
    uncertainty = model.uncertainty
    if uncertainty is None:
        return np.zeros((*motion.q.shape, 0))
    at_rest = motion.static
    state = State(
        motion.true_q,
        None if at_rest else motion.qd,
        None if at_rest else motion.qdd,
        motion.direction if at_rest else None,
    )
    torque = uncertainty.torque(model.terms, state)
    if uncertainty.offset.any():
        torque -= motion.slope @ uncertainty.offset
    return torque
