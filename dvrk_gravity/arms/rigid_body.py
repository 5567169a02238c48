"""Rigid-body regressor and torque of many samples at once, in closed form over arrays.

The joint efforts of a tree of rigid bodies are linear in ten inertial parameters
of each body (Atkeson, An, Hollerbach 1986). With the angular velocity w, angular
acceleration dw and acceleration a of a body's origin (gravity taken off), all in
the body's frame, a joint that gives the body the unit motion (u, v) carries

    m:  v . a        m c:  L' v + a x u,  L = [dw] + [w][w]
    I:  u' I dw + (u x w)' I w

so that one pass down the tree serves all samples. Where only the efforts of known
parameters are asked for, the recursion of Newton and Euler (Luh, Walker, Paul 1980)
gives them in a pass down and one back. Pinocchio, one sample a call, is the oracle
that the tests hold both against. Bodies turn about their z axis or slide along it,
by any constant combination of the arm's joints.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from dvrk_gravity.arms.arm import Arm
from dvrk_gravity.arrays import Array

PER_LINK = 10
OF_WEIGHT = 4  # of these, what weight knows of: m, m c (3)
_BLOCK = 1000  # samples worked on at a time: their arrays stay in the cache
_BLOCK_OF_TORQUE = 4000  # likewise, of the fewer arrays that torque alone needs


class TreeBody(NamedTuple):
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
        (joint, factor), *rest = self.moved_by or ((0, 0.0),)
        whole = factor * q[joint]
        for joint, factor in rest:
            whole += factor * q[joint]
        return whole


@lru_cache(maxsize=8)
def bodies(arm: Arm) -> tuple[TreeBody, ...]:
    """Return the bodies of an arm in their order."""
    result: list[TreeBody] = []
    for body in arm.bodies:
        before = result[body.parent].joints if body.parent >= 0 else ()
        own_joints = [int(joint) for joint in np.flatnonzero(body.row)]
        result.append(
            TreeBody(
                body.parent,
                body.placement.rotation.copy(),
                body.placement.translation[:, None].copy(),
                bool(body.placement.translation.any()),
                body.kind == "prismatic",
                tuple((joint, float(body.row[joint])) for joint in own_joints),
                tuple(sorted({*before, *own_joints})),
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
    tree = bodies(arm)
    for part, coordinates, base in _blocks(tree, _BLOCK, gravity, q, qd, qdd):
        out[part] = _regressor(tree, coordinates, base, arm.n).transpose(2, 0, 1)
    return out


def weight_regressor(arm: Arm, q: Array, gravity: Array) -> Array:
    """Return (N, n, 4 bodies) torques of each body's mass and first moment at (N, n) positions."""
    by_body = regressor(arm, q, None, None, gravity).reshape(*q.shape, len(arm.bodies), PER_LINK)
    return by_body[..., :OF_WEIGHT].reshape(*q.shape, -1)


def torque(
    arm: Arm, parameters: Array, q: Array, qd: Array | None, qdd: Array | None, gravity: Array
) -> Array:
    """Return (…, n) efforts of (10 bodies,) parameters, of a motion; see :func:`regressor`."""
    qd, qdd = (None if each is None else each.reshape(-1, arm.n) for each in (qd, qdd))
    out = np.empty((q.size // arm.n, arm.n))
    tree, links = bodies(arm), parameters.reshape(-1, PER_LINK)
    blocks = _blocks(tree, _BLOCK_OF_TORQUE, gravity, q.reshape(-1, arm.n), qd, qdd)
    for part, coordinates, base in blocks:
        out[part] = _torque(tree, links, coordinates, base, arm.n).T
    return out.reshape(q.shape)


def momentum(arm: Arm, parameters: Array, q: Array, qd: Array) -> tuple[Array, Array]:
    """Return the generalised momentum of bodies in motion, and the slope of their kinetic energy.

    With the momentum H_i (about its origin) of a body and all that it carries, its joint's axis S_i
    and its velocity V_i, all in its frame, the momentum M(q) qd of that joint is S_i' H_i, and the
    slope of the kinetic energy by its position, which is (C' qd)_i, is -S_i' (V_i x* H_i): the
    effort of the bodies without their weight is dp/dt - slope.

    Args:
        arm: The arm, with n joints.
        parameters: (10 bodies,) inertial parameters, as of :func:`regressor`.
        q: (N, n) positions, rad or m.
        qd: (N, n) velocities, rad/s or m/s.

    Returns:
        (N, n) momenta, N·m·s or N·s, and (N, n) slopes, N·m or N.
    """
    momenta, slopes = np.zeros((2, *q.shape))
    tree, links = bodies(arm), parameters.reshape(-1, PER_LINK)
    for start in range(0, len(q), _BLOCK_OF_TORQUE):
        part = slice(start, start + _BLOCK_OF_TORQUE)
        found = _momentum(tree, links, q[part].T, qd[part].T)
        momenta[part], slopes[part] = (each.T for each in found)
    return momenta, slopes


def _momentum(tree: tuple[TreeBody, ...], links: Array, q: Array, qd: Array) -> tuple[Array, Array]:
    """Return (joints, samples) momenta and slopes: down the tree, and back."""
    count = q.shape[1]
    still = np.zeros((3, count))
    frames: list[_Frame] = []
    velocities: list[tuple[Array, Array]] = []
    for body in tree:
        frame = _frame(body, body.coordinate(q, count))
        w, v = (still, still) if body.parent < 0 else velocities[body.parent]
        v = frame.into(v if frame.offset is None else v + _cross(w, frame.offset))
        w = frame.into(w)
        (v if body.slides else w)[2] += body.coordinate(qd, count)
        frames.append(frame)
        velocities.append((w, v))
    carried = [_momentum_of(link, *each) for link, each in zip(links, velocities, strict=True)]
    momenta, slopes = np.zeros((2, *q.shape))
    for body, frame, (w, v), (linear, angular) in zip(
        reversed(tree), reversed(frames), reversed(velocities), reversed(carried), strict=True
    ):
        turned = (
            _cross(w, linear)[2] if body.slides else (_cross(w, angular) + _cross(v, linear))[2]
        )
        for joint, factor in body.moved_by:
            momenta[joint] += factor * (linear if body.slides else angular)[2]
            slopes[joint] -= factor * turned
        if body.parent < 0:
            continue
        before, own = carried[body.parent], frame.transport(linear, angular)
        carried[body.parent] = before[0] + own[0], before[1] + own[1]
    return momenta, slopes


def _momentum_of(link: Array, w: Array, v: Array) -> tuple[Array, Array]:
    """Return (3, samples) linear momentum of a body, and angular momentum about its origin."""
    mass, first = link[0], link[1:4, None]
    return mass * v + _cross(w, first), _cross(first, v) + _inertia(link) @ w


def _inertia(link: Array) -> Array:
    """Return the (3, 3) inertia of (10,) parameters about the frame's origin."""
    xx, xy, yy, xz, yz, zz = link[4:]
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


class _Coordinate(NamedTuple):
    """Coordinate of a body's joint, its rate and gain, (samples,) each."""

    position: Array
    rate: Array
    gain: Array


class _Motion(NamedTuple):
    """Motion of a body in its own frame.

    Attributes:
        spin: Its angular velocity and acceleration, (3, samples) each; ``None``: the arm rests.
        a: (3, samples) acceleration of its origin, gravity taken off.
    """

    spin: tuple[Array, Array] | None
    a: Array


def _blocks(
    tree: tuple[TreeBody, ...],
    size: int,
    gravity: Array,
    q: Array,
    qd: Array | None,
    qdd: Array | None,
) -> Iterator[tuple[slice, list[_Coordinate], _Motion]]:
    """Yield slices of the samples, every body's coordinate there, and the base's motion."""
    for start in range(0, len(q), size):
        part = slice(start, start + size)
        arrays = [None if array is None else array[part].T for array in (q, qd, qdd)]
        count = len(q[part])
        still = None if qd is None and qdd is None else (np.zeros((3, count)),) * 2
        base = _Motion(still, np.repeat(-gravity[:, None], count, axis=1))
        coordinates = [_Coordinate(*(b.coordinate(array, count) for array in arrays)) for b in tree]
        yield part, coordinates, base


class _Frame(NamedTuple):
    """Where a body is in its parent's frame.

    Attributes:
        rotation: (3, 3) of its joint's frame.
        turn: Cosine and sine of its turn about z, (samples,) each; ``None``: it slides.
        offset: (3, 1) or (3, samples) of its origin, m; ``None``: in its parent's.
    """

    rotation: Array
    turn: tuple[Array, Array] | None
    offset: Array | None

    def into(self, vector: Array) -> Array:
        """Return a (3, samples) vector of the parent's frame in the body's."""
        vector = self.rotation.T @ vector
        if self.turn is None:
            return vector
        (c, s), (x, y) = self.turn, vector[:2].copy()
        np.add(c * x, s * y, out=vector[0])
        np.subtract(c * y, s * x, out=vector[1])
        return vector

    def out_of(self, vector: Array) -> Array:
        """Return a (3, samples) vector of the body's frame in its parent's."""
        if self.turn is not None:
            (x, y, z), (c, s) = vector, self.turn
            vector = np.stack([c * x - s * y, s * x + c * y, z])
        return self.rotation @ vector

    def transport(self, linear: Array, angular: Array) -> tuple[Array, Array]:
        """Return a force and a moment about the body's origin as the parent's: about its own.

        So it is with a linear and an angular momentum.
        """
        linear, angular = self.out_of(linear), self.out_of(angular)
        if self.offset is not None:
            angular = angular + _cross(self.offset, linear)
        return linear, angular


def _frame(body: TreeBody, position: Array) -> _Frame:
    if body.slides:
        return _Frame(body.rotation, None, body.offset + body.rotation[:, 2:] * position)
    turn = np.cos(position), np.sin(position)
    return _Frame(body.rotation, turn, body.offset if body.apart else None)


def _propagate_motion(parent: _Motion, frame: _Frame, rate: Array, gain: Array) -> _Motion:
    """Carry a parent's motion to the frame of a body, and add its joint's."""
    spin, a = parent
    if spin is None:
        return _Motion(None, frame.into(a))
    w, dw = spin
    if frame.offset is not None:
        a = a + _cross(dw, frame.offset) + _cross(w, _cross(w, frame.offset))
    w, dw, a = frame.into(w), frame.into(dw), frame.into(a)
    if frame.turn is None:
        # 2 w x z rate (Coriolis) and z gain
        a[0] += 2.0 * rate * w[1]
        a[1] -= 2.0 * rate * w[0]
        a[2] += gain
    else:
        # (R' w) x z rate = rate (w_y, -w_x, 0)
        dw[0] += rate * w[1]
        dw[1] -= rate * w[0]
        dw[2] += gain
        w[2] += rate
    return _Motion((w, dw), a)


def _torque(
    tree: tuple[TreeBody, ...],
    links: Array,
    coordinates: list[_Coordinate],
    base: _Motion,
    joints: int,
) -> Array:
    """Return (joints, samples) efforts of (bodies, 10) parameters: down the tree, and back."""
    frames: list[_Frame] = []
    motions: list[_Motion] = []
    for body, (position, rate, gain) in zip(tree, coordinates, strict=True):
        frames.append(_frame(body, position))
        parent = base if body.parent < 0 else motions[body.parent]
        motions.append(_propagate_motion(parent, frames[-1], rate, gain))
    # What each body takes to move, and carries on.
    wrenches = [_wrench(link, motion) for link, motion in zip(links, motions, strict=True)]
    out = np.zeros((joints, base.a.shape[1]))
    for body, frame, (force, moment) in zip(
        reversed(tree), reversed(frames), reversed(wrenches), strict=True
    ):
        for joint, factor in body.moved_by:
            out[joint] += factor * (force if body.slides else moment)[2]
        if body.parent < 0:
            continue
        before, own = wrenches[body.parent], frame.transport(force, moment)
        wrenches[body.parent] = before[0] + own[0], before[1] + own[1]
    return out


def _wrench(link: Array, motion: _Motion) -> tuple[Array, Array]:
    """Return force and moment about its origin, (3, samples), that move a body so."""
    spin, a = motion
    if not link.any():
        return np.zeros(a.shape), np.zeros(a.shape)
    mass, first = link[0], link[1:4, None]
    if spin is None:
        return mass * a, _cross(first, a)
    w, dw = spin
    inertia = _inertia(link)
    force = mass * a + _cross(dw, first) + _cross(w, _cross(w, first))
    return force, _cross(first, a) + inertia @ dw + _cross(w, inertia @ w)


def _regressor(
    tree: tuple[TreeBody, ...], coordinates: list[_Coordinate], base: _Motion, joints: int
) -> Array:
    """Return (joints, columns, samples)."""
    samples = base.a.shape[1]
    out = np.zeros((joints, PER_LINK * len(tree), samples))
    fixed = dict[int, tuple[Array, Array]]()
    motions: list[_Motion] = []
    units: list[dict[int, tuple[Array, Array]]] = []
    for index, (body, (position, rate, gain)) in enumerate(zip(tree, coordinates, strict=True)):
        parent, unit = (
            (base, fixed) if body.parent < 0 else (motions[body.parent], units[body.parent])
        )
        frame = _frame(body, position)
        motions.append(_propagate_motion(parent, frame, rate, gain))
        units.append(_units(unit, body, frame, samples))
        _fill(out[:, PER_LINK * index : PER_LINK * (index + 1)], motions[-1], units[-1])
    return out


def _units(
    parent: dict[int, tuple[Array, Array]], body: TreeBody, frame: _Frame, samples: int
) -> dict[int, tuple[Array, Array]]:
    """Return the unit motions (u, v) that joints give a body, (3, samples) each, by joint."""
    offset = frame.offset
    units = {
        joint: (frame.into(u), frame.into(v if offset is None else v + _cross(u, offset)))
        for joint, (u, v) in parent.items()
    }
    for joint, factor in body.moved_by:
        u, v = units.setdefault(joint, (np.zeros((3, samples)), np.zeros((3, samples))))
        (v if body.slides else u)[2] += factor
    return units


def _fill(out: Array, motion: _Motion, units: dict[int, tuple[Array, Array]]) -> None:
    """Write the ten columns of a body, (7, 10, n), for every joint that moves it."""
    spin, a = motion
    for joint, (u, v) in units.items():
        t = out[joint]
        t[0] = v[0] * a[0] + v[1] * a[1] + v[2] * a[2]
        t[1:4] = _cross(a, u)
    if spin is None:
        return
    w = spin[0]
    (wx, wy, wz), (dx, dy, dz) = spin
    # L = [dw] + [w][w], by its entries.
    xy, xz, yz = wx * wy, wx * wz, wy * wz
    xx, yy, zz = wx * wx, wy * wy, wz * wz
    rows = (
        (-yy - zz, xy - dz, xz + dy),
        (xy + dz, -xx - zz, yz - dx),
        (xz - dy, yz + dx, -xx - yy),
    )
    for joint, (u, v) in units.items():
        t = out[joint]
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
    (ax, ay, az), (bx, by, bz) = a, b
    out = np.empty((3, max(a.shape[1], b.shape[1])))
    np.subtract(ay * bz, az * by, out=out[0])
    np.subtract(az * bx, ax * bz, out=out[1])
    np.subtract(ax * by, ay * bx, out=out[2])
    return out
