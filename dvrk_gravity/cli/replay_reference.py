"""What the compensator is to send for a model, from the terms themselves.

It shares with the compensator the terms' formulae, and none of the code by which the compensator
evaluates them: each term is asked for all samples at once, through its own ``torque``.
"""

from __future__ import annotations

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import State
from dvrk_gravity.model import TorqueModel


def compensation(
    model: TorqueModel, position: Array, velocity: Array | None, ratio: Array, dead_band: Array
) -> Array:
    """Return the torque that compensates an arm, before any limit.

    Weights and elastic torques; of friction the part that is asked for. Not inertia, neither of
    links nor of what they carry, not what needs the past of the motion, not what only a sensor
    reads.

    Args:
        model: The model.
        position: (N, n) measured positions, rad.
        velocity: (N, n) rad/s; ``None`` where it is not known: friction is then left out.
        ratio: (n,) part of friction that is compensated, at each joint and motor.
        dead_band: (n,) rad/s below which a joint's velocity counts as zero in friction.

    Returns:
        (N, n) N·m.
    """
    q = position - model.joint_offset
    sliding = None if velocity is None else np.where(np.abs(velocity) < dead_band, 0.0, velocity)
    torque = np.zeros_like(q)
    for term in model.terms:
        if not term.COMPENSATED or (term.WEIGHT_OF_ARM and not model.arm.gravity_in_command):
            continue
        smooth, friction = term.split(ratio)
        if smooth is not None:
            torque += smooth.torque(State(q))  # at rest: of what is carried its weight
        if friction is not None:
            torque += friction.torque(State(q, sliding))
    return torque
