"""Where an encoder can be wrong: at joints, and at motors that move several joints."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dvrk_gravity.effects.base import site
from dvrk_gravity.effects.base.evidence import Motion
from dvrk_gravity.effects.base.friction_sites import mixed_motors


def encoder_sites(motion: Motion) -> Iterator[site.Site]:
    """Yield joints that move, and motors that move several joints of which one does.

    None of what does not move: a constant torque at other joints is all that it would show.
    """
    arm, moves = motion.arm, motion.moves
    for joint in np.flatnonzero(moves).tolist():
        yield site.joint(joint)
    for motor in mixed_motors(arm) if motion.present.all() else ():
        if moves[arm.actuator_to_joint[:, motor] != 0.0].any():
            yield site.motor(motor)
