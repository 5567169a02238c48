"""Rigid-body regressor of many samples at once, in closed form over arrays.

The joint torques of a tree of rigid bodies are linear in ten inertial parameters
of each body (Atkeson, An, Hollerbach 1986). With the angular velocity w, angular
acceleration dw and acceleration a of a body's origin (gravity taken off), all in
the body's frame, a joint that gives the body the unit motion (u, v) carries

    m:  v . a        m c:  L' v + a x u,  L = [dw] + [w][w]
    I:  u' I dw + (u x w)' I w

so that one pass down the tree serves all samples; Pinocchio's own regressor, one
sample a call, is the oracle that the tests hold it against.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from dvrk_gravity.arm import N_JOINTS, Arm
from dvrk_gravity.effects.term import Array
from dvrk_gravity.tree import TREE_LINKS, build_tree

PER_LINK = 10
COLUMNS = PER_LINK * len(TREE_LINKS)
_BLOCK = 1000  # samples worked on at a time: their arrays stay in the cache


class Body(NamedTuple):
    """One body of the tree.

    Attributes:
        parent: Index of its parent, -1 for the base.
        rotation: (3, 3) of its joint's frame in the parent's at zero.
        offset: (3,) of its origin in the parent's frame, m.
        joint: Joint of the arm that moves it.
        sign: In which sense.
        joints: Joints of the arm that move it or a body before it, in order.
    """

    parent: int
    rotation: Array
    offset: Array
    joint: int
    sign: float
    joints: tuple[int, ...]


@lru_cache(maxsize=8)
def bodies(arm: Arm) -> tuple[Body, ...]:
    """Return the bodies of an arm in the order of ``TREE_LINKS``."""
    tree = build_tree(arm, {}, np.zeros(3))
    result: list[Body] = []
    for index, row in enumerate(tree.expand, start=1):
        parent = tree.model.parents[index] - 1
        placement = tree.model.jointPlacements[index]
        joint = int(np.flatnonzero(row)[0])
        before = result[parent].joints if parent >= 0 else ()
        result.append(
            Body(
                parent,
                placement.rotation.copy(),
                placement.translation.copy(),
                joint,
                float(row[joint]),
                tuple(sorted({*before, joint})),
            )
        )
    return tuple(result)


def regressor(arm: Arm, q: Array, qd: Array | None, qdd: Array | None, gravity: Array) -> Array:
    """Return the regressor of the joint torques for the links' inertial parameters.

    Args:
        arm: The arm.
        q: (N, 7) positions, rad.
        qd: (N, 7) velocities, rad/s; ``None``: at rest.
        qdd: (N, 7) accelerations, rad/s^2; ``None``: zero.
        gravity: (3,) gravity in the base frame, m/s^2; zeros leave only inertia.

    Returns:
        (N, 7, 90): ten columns a body of ``TREE_LINKS``, in its joint's frame, in Pinocchio's
        order: m, m c (3), Ixx, Ixy, Iyy, Ixz, Iyz, Izz about the frame's origin.
    """
    out = np.empty((len(q), N_JOINTS, COLUMNS))
    for start in range(0, len(q), _BLOCK):
        part = slice(start, start + _BLOCK)
        block = _block(
            bodies(arm),
            q[part].T,
            None if qd is None else qd[part].T,
            None if qdd is None else qdd[part].T,
            gravity,
        )
        out[part] = block.transpose(2, 0, 1)
    return out


def torque(
    arm: Arm, parameters: Array, q: Array, qd: Array | None, qdd: Array | None, gravity: Array
) -> Array:
    """Return (N, 7) torques of (90,) parameters without storing the regressor; see there."""
    out = np.empty(q.shape)
    for start in range(0, len(q), _BLOCK):
        part = slice(start, start + _BLOCK)
        block = _block(
            bodies(arm),
            q[part].T,
            None if qd is None else qd[part].T,
            None if qdd is None else qdd[part].T,
            gravity,
        )
        out[part] = (parameters @ block).T
    return out


class _Motion(NamedTuple):
    """Motion of a body in its own frame, (3, n) each; unit motions by joint."""

    w: Array
    dw: Array
    a: Array
    unit: dict[int, tuple[Array, Array]]


def _block(
    tree: tuple[Body, ...], q: Array, qd: Array | None, qdd: Array | None, gravity: Array
) -> Array:
    """Return (7, 90, n) from (7, n) arrays."""
    n = q.shape[1]
    zeros = np.zeros(n)
    out = np.zeros((N_JOINTS, COLUMNS, n))
    base = _Motion(np.zeros((3, n)), np.zeros((3, n)), np.repeat(-gravity[:, None], n, axis=1), {})
    motions: list[_Motion] = []
    for index, body in enumerate(tree):
        parent = base if body.parent < 0 else motions[body.parent]
        angle = body.sign * q[body.joint]
        rate = zeros if qd is None else body.sign * qd[body.joint]
        gain = zeros if qdd is None else body.sign * qdd[body.joint]
        motion = _step(parent, body, np.cos(angle), np.sin(angle), rate, gain)
        motions.append(motion)
        columns = slice(PER_LINK * index, PER_LINK * (index + 1))
        _fill(out[:, columns], motion)
    return out


def _step(parent: _Motion, body: Body, c: Array, s: Array, rate: Array, gain: Array) -> _Motion:
    """Carry a parent's motion to a body's frame and add its joint's."""

    def into(vector: Array) -> Array:
        x, y, z = body.rotation.T @ vector
        return np.stack([c * x + s * y, c * y - s * x, z])

    w = into(parent.w)
    dw = into(parent.dw)
    # (R' w) x z rate = rate (w_y, -w_x, 0)
    dw[0] += rate * w[1]
    dw[1] -= rate * w[0]
    dw[2] += gain
    w[2] += rate
    offset = body.offset[:, None]
    a = parent.a
    if body.offset.any():
        a = a + _cross(parent.dw, offset) + _cross(parent.w, _cross(parent.w, offset))
    unit = {
        joint: (into(u), into(v + _cross(u, offset) if body.offset.any() else v))
        for joint, (u, v) in parent.unit.items()
    }
    u, v = unit.get(body.joint, (np.zeros((3, len(c))), np.zeros((3, len(c)))))
    u = u.copy()
    u[2] += body.sign
    unit[body.joint] = (u, v)
    return _Motion(w, dw, into(a), unit)


def _fill(out: Array, motion: _Motion) -> None:
    """Write the ten columns of a body, (7, 10, n), for every joint that moves it."""
    w, dw, a, unit = motion
    (wx, wy, wz), (dx, dy, dz) = w, dw
    # L = [dw] + [w][w], by its entries.
    xy, xz, yz = wx * wy, wx * wz, wy * wz
    xx, yy, zz = wx * wx, wy * wy, wz * wz
    rows = (
        (-yy - zz, xy - dz, xz + dy),
        (xy + dz, -xx - zz, yz - dx),
        (xz - dy, yz + dx, -xx - yy),
    )
    for joint, (u, v) in unit.items():
        t = out[joint]
        t[0] = v[0] * a[0] + v[1] * a[1] + v[2] * a[2]
        t[1:4] = _cross(a, u)
        for k in range(3):
            t[1 + k] += rows[0][k] * v[0] + rows[1][k] * v[1] + rows[2][k] * v[2]
        s = _cross(u, w)
        t[4] = u[0] * dx + s[0] * wx
        t[5] = u[0] * dy + u[1] * dx + s[0] * wy + s[1] * wx
        t[6] = u[1] * dy + s[1] * wy
        t[7] = u[0] * dz + u[2] * dx + s[0] * wz + s[2] * wx
        t[8] = u[1] * dz + u[2] * dy + s[1] * wz + s[2] * wy
        t[9] = u[2] * dz + s[2] * wz


def _cross(a: Array, b: Array) -> Array:
    """Return the cross product of (3, n) or (3, 1) vectors."""
    return np.stack(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )
