"""Findings written into a model, as far as a model file can carry them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity import effects
from dvrk_gravity.diagnosis.motion import Motion
from dvrk_gravity.effects.base.effect import Hypothesis, Values
from dvrk_gravity.model import TorqueModel

Array = NDArray[np.float64]


def extended(
    motion: Motion, found: Sequence[tuple[Hypothesis, Array]]
) -> tuple[TorqueModel, tuple[bool, ...]]:
    """Return the model with what was found, and which findings it carries.

    What the arm does as a function of its state, its encoders' zeros and its efforts' bias go
    into the file. Wrong readings (scale, delay, clipping, coupling, coordinates) are to be put
    right where they arise, and what happens in time (drift, a push for a while) is no function of
    the state: they are left to the findings.

    Findings are functions of measured positions, a model's terms of true ones: the encoder
    offsets that the findings add are merged first, so that every other finding can take them into
    account.

    Args:
        motion: The motion, for its model and for the range on which cables were fitted.
        found: Hypotheses and their (k,) parameters, in order.
    """
    values: Values = dict(motion.model.parameters())
    carried = [False] * len(found)
    order = sorted(range(len(found)), key=lambda i: not found[i][0].shifts_positions)
    for i in order:
        hypothesis, theta = found[i]
        changed = hypothesis.merge(values, theta, motion)
        carried[i] = changed is not None
        values = values if changed is None else changed
    model = TorqueModel.from_parameters(values)
    names = {term.NAME for term in effects.terms()}
    others = tuple(term for term in motion.model.terms if term.NAME not in names)
    return replace(model, terms=(*model.terms, *others)), tuple(carried)
