"""A link that is another than the model's, put into the model's parameters: weight and inertia."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arms import Arm
from dvrk_gravity.arms.mtm import is_mtm
from dvrk_gravity.effects.gravity import link_beta, with_beta
from dvrk_gravity.effects.link_inertia import with_inertia
from dvrk_gravity.effects.link_weight import with_weight
from dvrk_gravity.effects.links import links_of_joints
from dvrk_gravity.effects.merging import Values

Array = NDArray[np.float64]


def with_link(arm: Arm, values: Values, joint: int, change: Array) -> Values | None:
    """Return a model's parameters with (10,) more of a joint's link, in the joint's frame.

    ``None`` if the model has no weights that could be others.
    """
    index = links_of_joints(arm)[joint]
    body = arm.bodies[index]
    if is_mtm(arm):
        # beta is made of first moments in the link's own frame.
        moment = change[1:4] - change[0] * body.frame.translation
        beta = link_beta(body.name, float(change[0]), body.frame.rotation.T @ moment)
        result = with_beta(values, beta)
    else:
        weights = np.zeros((len(arm.bodies), 4))
        weights[index] = change[:4]
        result = with_weight(arm, values, weights)
    return None if result is None else with_inertia(values=result, body=body.name, change=change)
