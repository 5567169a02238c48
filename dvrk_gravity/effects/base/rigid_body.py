"""Rigid-body regressor of many samples at once, in closed form over arrays.

The joint efforts of a tree of rigid bodies are linear in ten inertial parameters
of each body (Atkeson, An, Hollerbach 1986). With the angular velocity w, angular
acceleration dw and acceleration a of a body's origin (gravity taken off), all in
the body's frame, a joint that gives the body the unit motion (u, v) carries

    m:  v . a        m c:  L' v + a x u,  L = [dw] + [w][w]
    I:  u' I dw + (u x w)' I w

so that one pass down the tree serves all samples; Pinocchio's own regressor, one
sample a call, is the oracle that the tests hold it against. Bodies turn about
their z axis or slide along it, by any constant combination of the arm's joints.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from dvrk_gravity.arms import Arm, mtm
from dvrk_gravity.effects.base.arrays import Array

PER_LINK = 10
COLUMNS = PER_LINK * len(mtm.BODIES)  # of an MTM
_BLOCK = 1000  # samples worked on at a time: their arrays stay in the cache


class Body(NamedTuple):
    """One body of the tree.

    Attributes:
        parent: Index of its parent, -1 for the base.
        rotation: (3, 3) of its joint's frame in the parent's at zero.
        offset: (3, 1) of its origin in the parent's frame at zero, m.
        apart: Whether that is not zero.
        slides: Whether its joint is prismatic.
        moved_by: Joints of the arm that move its coordinate, and by how much.
        joints: Joints of the arm that move it or a body before it, in order.
    """

    parent: int
    rotation: Array
    offset: Array
    apart: bool
    slides: bool
    moved_by: tuple[tuple[int, float], ...]
    joints: tuple[int, ...]

    def coordinate(self, q: Array | None, n: int) -> Array:
        """Return its coordinate (n,), or one's rate, from those of the joints, (joints, n)."""
        if q is None:
            return np.zeros(n)
        (joint, factor), *others = self.moved_by or ((0, 0.0),)
        whole = factor * q[joint]
        for joint, factor in others:
            whole += factor * q[joint]
        return whole


@lru_cache(maxsize=8)
def bodies(arm: Arm) -> tuple[Body, ...]:
    """Return the bodies of an arm in their order."""
    result: list[Body] = []
    for body in arm.bodies:
        before = result[body.parent].joints if body.parent >= 0 else ()
        own = [int(joint) for joint in np.flatnonzero(body.row)]
        result.append(
            Body(
                body.parent,
                body.placement.rotation.copy(),
                body.placement.translation[:, None].copy(),
                bool(body.placement.translation.any()),
                body.kind == "prismatic",
                tuple((joint, float(body.row[joint])) for joint in own),
                tuple(sorted({*before, *own})),
            )
        )
    return tuple(result)


def regressor(arm: Arm, q: Array, qd: Array | None, qdd: Array | None, gravity: Array) -> Array:
    """Return the regressor of the joint efforts for the bodies' inertial parameters.

    Args:
        arm: The arm, with n joints.
        q: (N, n) positions, rad or m.
        qd: (N, n) velocities, rad/s or m/s; ``None``: at rest.
        qdd: (N, n) accelerations, rad/s^2 or m/s^2; ``None``: zero.
        gravity: (3,) gravity in the base frame, m/s^2; zeros leave only inertia.

    Returns:
        (N, n, 10 bodies): ten columns a body of ``arm.bodies``, in its joint's frame, in
        Pinocchio's order: m, m c (3), Ixx, Ixy, Iyy, Ixz, Iyz, Izz about the frame's origin.
    """
    out = np.empty((*q.shape, PER_LINK * len(arm.bodies)))
    for part, block in _blocks(arm, q, qd, qdd, gravity):
        out[part] = block.transpose(2, 0, 1)
    return out


def torque(
    arm: Arm, parameters: Array, q: Array, qd: Array | None, qdd: Array | None, gravity: Array
) -> Array:
    """Return (N, n) efforts of (10 bodies,) parameters without storing the regressor."""
    out = np.empty(q.shape)
    for part, block in _blocks(arm, q, qd, qdd, gravity):
        out[part] = (parameters @ block).T
    return out


def _blocks(
    arm: Arm, q: Array, qd: Array | None, qdd: Array | None, gravity: Array
) -> Iterator[tuple[slice, Array]]:
    """Yield slices of the samples and their regressor as (n, columns, samples)."""
    tree = bodies(arm)
    for start in range(0, len(q), _BLOCK):
        part = slice(start, start + _BLOCK)
        yield (
            part,
            _block(
                tree,
                q[part].T,
                None if qd is None else qd[part].T,
                None if qdd is None else qdd[part].T,
                gravity,
            ),
        )


class _Motion(NamedTuple):
    """Motion of a body in its own frame, (3, n) each; unit motions by joint."""

    w: Array
    dw: Array
    a: Array
    unit: dict[int, tuple[Array, Array]]


def _block(
    tree: tuple[Body, ...], q: Array, qd: Array | None, qdd: Array | None, gravity: Array
) -> Array:
    """Return (joints, columns, n) from (joints, n) arrays."""
    joints, n = q.shape
    out = np.zeros((joints, PER_LINK * len(tree), n))
    base = _Motion(np.zeros((3, n)), np.zeros((3, n)), np.repeat(-gravity[:, None], n, axis=1), {})
    motions: list[_Motion] = []
    for index, body in enumerate(tree):
        parent = base if body.parent < 0 else motions[body.parent]
        position, rate, gain = (body.coordinate(array, n) for array in (q, qd, qdd))
        step = _slide if body.slides else _turn
        motion = step(parent, body, position, rate, gain)
        motions.append(motion)
        columns = slice(PER_LINK * index, PER_LINK * (index + 1))
        _fill(out[:, columns], motion)
    return out


def _turn(parent: _Motion, body: Body, angle: Array, rate: Array, gain: Array) -> _Motion:
    """Carry a parent's motion to the frame of a body that turns, and add its joint's."""
    c, s = np.cos(angle), np.sin(angle)

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
    offset = body.offset
    a = parent.a
    if body.apart:
        a = a + _cross(parent.dw, offset) + _cross(parent.w, _cross(parent.w, offset))
    unit = {
        joint: (into(u), into(v + _cross(u, offset) if body.apart else v))
        for joint, (u, v) in parent.unit.items()
    }
    for joint, factor in body.moved_by:
        u, v = _unit(unit, joint, len(c))
        u[2] += factor
        unit[joint] = (u, v)
    return _Motion(w, dw, into(a), unit)


def _slide(parent: _Motion, body: Body, way: Array, rate: Array, gain: Array) -> _Motion:
    """Carry a parent's motion to the frame of a body that slides, and add its joint's."""
    back = body.rotation.T
    offset = body.offset + body.rotation[:, 2:] * way
    w, dw = back @ parent.w, back @ parent.dw
    a = parent.a + _cross(parent.dw, offset) + _cross(parent.w, _cross(parent.w, offset))
    a = back @ a
    # 2 w x z rate (Coriolis) and z gain
    a[0] += 2.0 * rate * w[1]
    a[1] -= 2.0 * rate * w[0]
    a[2] += gain
    unit = {
        joint: (back @ u, back @ (v + _cross(u, offset))) for joint, (u, v) in parent.unit.items()
    }
    for joint, factor in body.moved_by:
        u, v = _unit(unit, joint, len(way))
        v[2] += factor
        unit[joint] = (u, v)
    return _Motion(w, dw, a, unit)


def _unit(unit: dict[int, tuple[Array, Array]], joint: int, n: int) -> tuple[Array, Array]:
    """Return the unit motion that a joint gives a body so far, zero where it gives none."""
    return unit.get(joint) or (np.zeros((3, n)), np.zeros((3, n)))


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
