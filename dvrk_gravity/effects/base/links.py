"""Links by the joint that carries them: names, bodies of the tree, changes of their parameters."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from dvrk_gravity.arms import Arm
from dvrk_gravity.arms.description import GRAVITY
from dvrk_gravity.effects.base.evidence import Motion

Array = NDArray[np.float64]

AXES = ("x", "y", "z")
PER_LINK = 10


@lru_cache(maxsize=8)
def links_of_joints(arm: Arm) -> tuple[int, ...]:
    """Return the index of the body that each joint carries: of several, what carries the most.

    An MTM's elbow moves forearm, crank and bar; the forearm carries the wrist.
    """
    below = np.zeros(len(arm.bodies), dtype=int)
    for index in range(len(arm.bodies) - 1, -1, -1):
        parent = arm.bodies[index].parent
        if parent >= 0:
            below[parent] += 1 + below[index]
    moved = (arm.expand[:, None] == np.eye(arm.n)).all(axis=2)  # (bodies, n), by that joint alone
    return tuple(int(np.argmax(np.where(moved[:, joint], below, -1))) for joint in range(arm.n))


@lru_cache(maxsize=8)
def joints_with_weight(arm: Arm) -> tuple[int, ...]:
    """Return the joints whose link can be weighed: all but one that turns about the vertical."""
    first = arm.bodies[0]
    axis = first.placement.rotation[:, 2]
    upright = np.linalg.norm(np.cross(axis, arm.gravity)) < 1e-9 * GRAVITY
    turns = first.kind == "revolute" and bool(upright)
    return tuple(joint for joint in range(arm.n) if not (turns and first.row[joint]))


def link_name(arm: Arm, joint: int) -> str:
    """Return the name of the link that a joint carries."""
    return arm.body_names[links_of_joints(arm)[joint]]


def link_columns(motion: Motion, joint: int, directions: Array) -> Array:
    """Return (N, n, k) torques of changes of a link's inertial parameters.

    Args:
        motion: The motion.
        joint: Index of the link's joint.
        directions: (10, k) changes in Pinocchio's joint frame.
    """
    return motion.link_torque(links_of_joints(motion.arm)[joint], directions)


def mass_directions(arm: Arm, joint: int, place: Array) -> Array:
    """Return (10, 4) inertial parameters per kg and per kg·m of a point mass on a link.

    They are quadratic in where the mass is, hence linearised there.

    Args:
        arm: The arm.
        joint: Index of the link's joint.
        place: (3,) in the link's frame, m.
    """
    frame = arm.bodies[links_of_joints(arm)[joint]].frame

    def parameters(where: Array) -> Array:
        point = pin.Inertia(1.0, where, np.zeros((3, 3)))
        return np.asarray(frame.act(point).toDynamicParameters())

    # A central difference of a quadratic is exact.
    slopes = [0.5 * (parameters(place + axis) - parameters(place - axis)) for axis in np.eye(3)]
    base = parameters(place) - np.array(slopes).T @ place
    return np.column_stack([base, *slopes])


def inertia_directions(arm: Arm, joint: int, isotropic: bool) -> Array:
    """Return (10, k) inertial parameters per kg·m^2 of rotational inertia of a link.

    Args:
        arm: The arm.
        joint: Index of the link's joint.
        isotropic: The same about all axes (k = 1), or one about each axis of its frame (k = 3).
    """
    frame = arm.bodies[links_of_joints(arm)[joint]].frame
    tensors = [np.eye(3)] if isotropic else [np.diag(row) for row in np.eye(3)]
    directions = []
    for tensor in tensors:
        turned = frame.rotation @ tensor @ frame.rotation.T
        xx, xy, xz, yy, yz, zz = turned[np.triu_indices(3)]
        directions.append([0.0, 0.0, 0.0, 0.0, xx, xy, yy, xz, yz, zz])
    return np.array(directions).T


def moment_directions(arm: Arm, joint: int, axes: Sequence[int]) -> Array:
    """Return (10, k) inertial parameters per N·m of weight moment along a link's axes."""
    directions = np.zeros((PER_LINK, len(axes)))
    frame = arm.bodies[links_of_joints(arm)[joint]].frame
    directions[1:4] = frame.rotation[:, list(axes)]
    return directions / GRAVITY
