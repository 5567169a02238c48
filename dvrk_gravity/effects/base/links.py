"""Links: which body a joint carries, which can be weighed, changes of their parameters."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import pinocchio as pin

from dvrk_gravity.arms import GRAVITY, Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base import rigid_body
from dvrk_gravity.effects.base.link_prior import samples

AXES = ("x", "y", "z")
PER_LINK = 10
_RANK = 1e-9  # of a norm, that rounding leaves of what others make up


@lru_cache(maxsize=8)
def links_of_joints(arm: Arm) -> tuple[int, ...]:
    """Return the index of the body that each joint carries: of several, what carries the most.

    An MTM's elbow moves forearm, crank and bar; the forearm carries the wrist. Where no body is
    moved by a joint alone (of a PSM's jaws each turns by half of `jaw`) it is one that moves by
    others, too.
    """
    below = np.zeros(len(arm.bodies), dtype=int)
    for index in range(len(arm.bodies) - 1, -1, -1):
        parent = arm.bodies[index].parent
        if parent >= 0:
            below[parent] += 1 + below[index]
    alone = (arm.expand[:, None] == np.eye(arm.n)).all(axis=2)  # (bodies, n), by that joint alone
    worth = np.where(alone, below[:, None] + len(arm.bodies), below[:, None])
    worth = np.where(arm.expand != 0.0, worth, -1)
    return tuple(int(body) for body in np.argmax(worth, axis=0))


def last_link(arm: Arm) -> str:
    """Return the name of the link that the last joint carries, as a rule the hand or the tool.

    It need not be the last body: of a gripper that may be a finger that follows another.
    """
    return arm.body_names[links_of_joints(arm)[-1]]


@lru_cache(maxsize=8)
def joint_of_link(arm: Arm, body: int) -> int:
    """Return the joint that a body is said of: whose link it is, or the last one that moves it."""
    links = links_of_joints(arm)
    if body in links:
        return links.index(body)
    while body >= 0 and not arm.bodies[body].row.any():
        body = arm.bodies[body].parent
    return int(np.flatnonzero(arm.bodies[body].row)[-1])


@lru_cache(maxsize=8)
def identifiable_links(arm: Arm) -> tuple[int, ...]:
    """Return the bodies that can be weighed, of those whose weights look alike only one.

    A joint's own link goes before those that follow it: of a parallelogram's sides that turn alike
    about parallel axes, torque tells the mass and how it turns, and not on which side it is.
    """
    own_links = [links_of_joints(arm)[joint] for joint in joints_with_weight(arm)]
    following_links = [body for body in range(len(arm.bodies)) if body not in links_of_joints(arm)]
    q, qd, qdd = samples(arm)
    whole = rigid_body.regressor(arm, q, qd, qdd, arm.gravity).reshape(
        -1, len(arm.bodies), PER_LINK
    )
    found: list[int] = []
    spans: list[Array] = []
    for body in (*own_links, *following_links):
        columns, size, _ = np.linalg.svd(whole[:, body], full_matrices=False)
        span = columns[:, size > _RANK * size[0]]
        equivalent = any(
            span.shape == known.shape
            and np.linalg.norm(span - known @ (known.T @ span)) < np.sqrt(_RANK)
            for known in spans
        )
        if body in own_links or not equivalent:
            found.append(body)
            spans.append(span)
    return tuple(found)


@lru_cache(maxsize=8)
def joints_with_weight(arm: Arm) -> tuple[int, ...]:
    """Return the joints whose link can be weighed: all but one that turns about the vertical."""
    first = arm.bodies[0]
    axis = first.placement.rotation[:, 2]
    upright = np.linalg.norm(np.cross(axis, arm.gravity)) < 1e-9 * GRAVITY
    turns = first.kind == "revolute" and bool(upright)
    return tuple(joint for joint in range(arm.n) if not (turns and first.row[joint]))


def mass_directions(arm: Arm, body: int, com: Array) -> Array:
    """Return (10, 4) inertial parameters per kg and per kg·m of a point mass on a link.

    They are quadratic in where the mass is, hence linearised there.

    Args:
        arm: The arm.
        body: Index of the link.
        com: (3,) its centre in the link's frame, m.
    """
    frame = arm.bodies[body].frame

    def parameters(where: Array) -> Array:
        point = pin.Inertia(1.0, where, np.zeros((3, 3)))
        return np.asarray(frame.act(point).toDynamicParameters())

    # A central difference of a quadratic is exact.
    slopes = [0.5 * (parameters(com + axis) - parameters(com - axis)) for axis in np.eye(3)]
    base = parameters(com) - np.array(slopes).T @ com
    return np.column_stack([base, *slopes])


def inertia_directions(arm: Arm, body: int, isotropic: bool) -> Array:
    """Return (10, k) inertial parameters per kg·m^2 of rotational inertia of a link.

    Args:
        arm: The arm.
        body: Index of the link.
        isotropic: The same about all axes (k = 1), or one about each axis of its frame (k = 3).
    """
    frame = arm.bodies[body].frame
    tensors = [np.eye(3)] if isotropic else [np.diag(row) for row in np.eye(3)]
    directions = []
    for tensor in tensors:
        turned = frame.rotation @ tensor @ frame.rotation.T
        xx, xy, xz, yy, yz, zz = turned[np.triu_indices(3)]
        directions.append([0.0, 0.0, 0.0, 0.0, xx, xy, yy, xz, yz, zz])
    return np.array(directions).T


def moment_directions(arm: Arm, body: int, axes: Sequence[int]) -> Array:
    """Return (10, k) inertial parameters per N·m of weight moment along a link's axes."""
    directions = np.zeros((PER_LINK, len(axes)))
    frame = arm.bodies[body].frame
    directions[1:4] = frame.rotation[:, list(axes)]
    return directions / GRAVITY
