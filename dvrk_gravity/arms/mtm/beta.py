"""A tree of rigid bodies whose gravity torques are those of beta."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from dvrk_gravity.arms.description import GRAVITY, Description
from dvrk_gravity.arms.tree import Tree, build_tree
from dvrk_gravity.arrays import Array


def beta_tree(arm: Description, beta: Array, gravity: Array) -> Tree:
    """Build a tree whose gravity torques are those of ``beta``, for Pinocchio to evaluate.

    Masses cannot be told from beta. Every link gets one kilogram, which keeps
    Pinocchio's centres of mass finite, and first moments that make up for it.

    Args:
        arm: An MTM.
        beta: (10,), (12,) or (14,) base parameters, N·m.
        gravity: (3,) gravity in the base frame, m/s^2.
    """
    moment = np.zeros(14)
    moment[: len(beta)] = beta
    moment /= GRAVITY
    upper, fore, wrist = (arm.body(f"link{i}").frame for i in (2, 3, 4))
    # Of a distal frame: a is the way along its own x axis, d the one along the joint's.
    length = [float(frame.rotation[:, 0] @ frame.translation) for frame in (upper, fore)]
    h = float(wrist.translation[2])
    levers = {
        "link1": (moment[12], 0.0, moment[13]),
        "link2": (moment[0] - 6 * length[0], moment[1], 0.0),
        "link3": (moment[2] - 5 * length[1], 0.0, moment[3] - 4 * h),
        "link4": (moment[4], 0.0, 0.0),
        "link5": (moment[7], moment[5], moment[6]),
        "link6": (moment[9], 0.0, moment[8]),
        "link7": (moment[10], moment[11], 0.0),
    }
    inertias = {
        body: pin.Inertia(1.0, np.array(lever), np.zeros((3, 3))) for body, lever in levers.items()
    }
    return build_tree(arm, inertias, gravity)
