"""Closed-form gravity model of the dVRK master arm: ``tau = Y(q) beta``.

The model is that of "The Symbolic Equation of Gravitational Dynamic Model for
the MTM of dVRK", equation (1), carried beyond it: ten columns as the document
has them, two more for link 7's transverse moments, and two more that only a
tilted base can see. ``docs/gravity_model.md`` sets it beside the printed one.

How it works. Gravity's energy is linear in the links' first moments. Pushed up
the chain, all of them are multiples of fourteen unit vectors ``w_k``, and

    Y[j, k] = axis_j . (w_k x n) = w_k . (n x axis_j),    n = -gravity / 9.81,

for every joint j that carries ``w_k``. One projection on the wrist's unit vectors
therefore serves all rows: of ``n x axis_j`` for joints 1 to 4, and of ``n``
itself for joints 5 to 7, whose axes only permute those vectors.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dvrk_gravity.arms.description import GRAVITY
from dvrk_gravity.arrays import Array
from dvrk_gravity.errors import ConfigError, ShapeError

if TYPE_CHECKING:
    import pinocchio as pin

JOINTS = 7
COLUMNS = (10, 12, 14)
"""Column counts: the document's, with link 7's transverse moments, with a tilted base's."""

BETA_NAMES = (
    "arm_x",  # along the arm (x2): all masses beyond the elbow weigh here
    "arm_y",  # across the arm (y2)
    "forearm_x",  # along the forearm (x3)
    "forearm_z",  # along joint 4's axis (z3)
    "platform_x",  # x4
    "pitch_y",  # y5 = -z4
    "pitch_z",  # z5 = y6
    "pitch_x",  # x5
    "yaw_z",  # z6 = z7
    "yaw_x",  # x6
    "roll_x",  # x7: link 7 off its own axis
    "roll_y",  # y7
    "base_x",  # x1: seen only when gravity is not along joint 1
    "base_z",  # z1, the axis of joints 2 and 3: likewise
)
"""Names of the base parameters: the part and the frame axis that each first moment lies along."""

LINKS = (*(f"link{i}" for i in range(1, JOINTS + 1)), "bar", "crank")
"""Links that carry mass; ``bar`` and ``crank`` are the document's 4' and 5'."""

# Poses worked on at a time: long enough to hide the interpreter, short enough for the cache.
_BLOCK = 4000

# The document's frames at q = 0, as axes in frame 1 (x1 = -y0, y1 = z0, z1 = -x0).
_FRAMES_AT_ZERO = {
    "link1": "+x+y+z",
    "link2": "-y+x+z",
    "link3": "+x-z+y",
    "link4": "+x+y+z",
    "link5": "+x-z+y",
    "link6": "+z+y-x",
    "link7": "+y-z-x",
    "bar": "+y-x+z",
    "crank": "+y-x+z",
}


class Lengths(NamedTuple):
    """The arm's lengths in m, named as in the document. They enter beta, never the regressor."""

    arm: float = 0.2794
    """Shoulder to elbow, ``l_arm`` (a2)."""
    forearm: float = 0.3645
    """Elbow to the foot of the wrist's offset, ``l_forearm`` (a3)."""
    h: float = 0.1506
    """From there to the wrist's centre along joint 4's axis, ``h`` (d4)."""
    crank: float = 0.1
    """Side of the parallelogram along the forearm, ``l'_forearm``."""


LENGTHS = Lengths()


@dataclass(frozen=True)
class LinkMass:
    """Mass and centre of mass of one link.

    Attributes:
        mass: kg.
        com: Centre of mass (x, y, z) in m in the document's frame of that link: the distal
            DH frame for ``link1`` … ``link7``. The bar's and the crank's frames both have
            their origin at the crank's tip; x4' = -x2, y4' = -y2; x5' = z3, y5' = -x3.
    """

    mass: float
    com: tuple[float, float, float] = (0.0, 0.0, 0.0)


def regressor(q: ArrayLike, gravity: ArrayLike = (0.0, 0.0, -GRAVITY), columns: int = 10) -> Array:
    """Return the gravity regressor Y(q), so that the static joint torque is Y(q) @ beta.

    Source: the symbolic gravity model, equation (1) and its rows Y1 … Y7.

    Args:
        q: Joint positions in rad as in ``measured_js``, shape (…, 7), any leading shape.
        gravity: Gravity in the arm's base frame, m/s^2, shape (3,).
        columns: 10 as in the document, 12 with link 7's transverse moments, or 14 with the
            moments that only a tilted base makes visible. The first ten are always the same.

    Returns:
        Shape (…, 7, columns), dimensionless: beta is in N·m and holds 9.81 m/s^2, so that Y
        scales with |gravity| / 9.81.

    Raises:
        ShapeError: q does not end in 7, or gravity is not (3,).
        ConfigError: gravity is not finite, or columns is none of 10, 12, 14.
    """
    q = _positions(q)
    _check_columns(columns)
    out = np.empty((*q.shape[:-1], JOINTS, columns))
    flat = out.reshape(-1, JOINTS, columns)
    for block, y in _blocks(q, gravity, columns):
        flat[block] = y.transpose(2, 0, 1)
    return out


def torque(q: ArrayLike, beta: ArrayLike, gravity: ArrayLike = (0.0, 0.0, -GRAVITY)) -> Array:
    """Return the static joint torque Y(q) @ beta without storing Y for all poses.

    Args:
        q: Joint positions in rad, shape (…, 7).
        beta: Base parameters in N·m, shape (10,), (12,) or (14,).
        gravity: Gravity in the arm's base frame, m/s^2, shape (3,).

    Returns:
        Torque that the actuators apply to hold the pose, N·m, shape (…, 7).

    Raises:
        ShapeError: q does not end in 7, gravity is not (3,), or beta has another length.
        ConfigError: gravity is not finite.
    """
    q = _positions(q)
    beta = np.asarray(beta, dtype=float)
    if beta.ndim != 1 or beta.size not in COLUMNS:
        raise ShapeError("beta", beta.shape, "(10,), (12,) or (14,)")
    out = np.empty(q.shape)
    flat = out.reshape(-1, JOINTS)
    for block, y in _blocks(q, gravity, beta.size):
        flat[block] = (beta @ y).T
    return out


def _positions(q: ArrayLike) -> Array:
    q = np.asarray(q, dtype=float)
    if q.ndim == 0 or q.shape[-1] != JOINTS:
        raise ShapeError("q", q.shape, "(…, 7)")
    return q


def _check_columns(columns: int) -> None:
    if columns not in COLUMNS:
        raise ConfigError("columns", columns, "10, 12 or 14")


def _blocks(q: Array, gravity: ArrayLike, columns: int) -> Iterator[tuple[slice, Array]]:
    """Yield (slice of the flattened poses, their regressor as (7, columns, n)).

    The array yielded is scratch, written again for the next block.
    """
    up = np.asarray(gravity, dtype=float) / -GRAVITY
    if up.shape != (3,):
        raise ShapeError("gravity", up.shape, "(3,)")
    if not np.isfinite(up).all():
        raise ConfigError("gravity", gravity, "three finite numbers in m/s^2")
    poses = q.reshape(-1, JOINTS)
    # Entries that are zero for every pose are never written, so they are cleared only here.
    y = np.zeros((JOINTS, columns, min(len(poses), _BLOCK)))
    for start in range(0, len(poses), _BLOCK):
        block = slice(start, min(start + _BLOCK, len(poses)))
        y = y[..., : block.stop - start]
        _fill(y, poses[block], up)
        yield block, y


def _fill(y: Array, q: Array, up: Array) -> None:
    """Write the entries of the regressor that are not zero for every pose.

    Args:
        y: Regressor to fill, shape (7, columns, n), zero where it stays zero.
        q: Joint positions, shape (n, 7).
        up: n = -gravity / 9.81 in the base frame, shape (3,).
    """
    tilted = bool(up[0] or up[1])
    last = min(y.shape[1], 12)
    cosine, sine = _cos_sin(q, 7 if tilted else 6 if last == 12 else 5)
    (c2, c23, c4, c5, c6), (s2, s23, s4, s5, s6) = cosine[:5], sine[:5]

    # w[i, k] is the projection on w_k of one of n x axis_1, n x axis_2, n x axis_4 and n; the
    # first vanishes for vertical gravity. Their y3 components belong to no column of their own.
    w = np.empty((4, last, len(q)))[0 if tilted else 1 :]
    y3 = np.zeros((len(w), len(q)))
    y[1, 0], y[1, 1] = up[2] * s2, up[2] * c2
    n_x3, n_z3 = up[2] * s23, up[2] * c23
    if tilted:
        # n in frame 1 is (n_x1, up[2], n_z1): its y axis is that of joint 1, its z axis joint 2's.
        c1, s1 = cosine[6], sine[6]
        n_x1, n_z1 = up[0] * s1 - up[1] * c1, -up[0] * c1 - up[1] * s1
        y[0, 0], y[0, 1] = -n_z1 * s2, -n_z1 * c2
        y[1, 0] += n_x1 * c2
        y[1, 1] -= n_x1 * s2
        if y.shape[1] == 14:
            y[0, 12], y[0, 13] = -n_z1, n_x1
        n_x3 += n_x1 * c23
        n_z3 -= n_x1 * s23
        w[0, 2], w[0, 3], y3[0] = -n_z1 * c23, n_z1 * s23, -n_x1
        w[-2, 2], y3[-1] = -n_z1, -n_z1
    else:
        w[-2, 2] = 0.0
    w[-3, 2], w[-3, 3] = n_z3, -n_x3
    w[-2, 3], y3[-2] = 0.0, -n_x3
    w[-1, 2], w[-1, 3] = n_x3, n_z3

    # Each wrist joint turns one pair of axes into the next; the sines and cosines that are
    # swapped or negated hold the DH table's offsets and twists.
    _rotate(c4, s4, w[:, 2], y3, w[:, 4], w[:, 5])
    _rotate(c5, s5, w[:, 4], w[:, 3], w[:, 7], w[:, 6])
    _rotate(-c6, -s6, w[:, 7], w[:, 5], w[:, 8], w[:, 9])
    n = w[-1]
    if last == 12:
        c7, s7 = cosine[5], sine[5]
        _rotate(-s7, c7, w[:, 9], w[:, 6], w[:, 10], w[:, 11])

    if tilted:
        y[0, 2:last] = w[0, 2:]
    y[1, 2:last] = y[2, 2:last] = w[-3, 2:]
    y[3, 4:last] = w[-2, 4:]
    y[4, 6], y[4, 7] = -n[7], n[6]
    y[4, 8], y[4, 9] = -c6 * n[6], s6 * n[6]
    y[5, 8], y[5, 9] = n[9], -n[8]
    if last == 12:
        _rotate(-s7, c7, y[4, 9], -n[7], y[4, 10], y[4, 11])
        y[5, 10], y[5, 11] = s7 * n[8], c7 * n[8]
        y[6, 10], y[6, 11] = n[11], -n[10]


def _cos_sin(q: Array, count: int) -> tuple[Array, Array]:
    """Return cosines and sines (count, n) of q2, q2 + q3, q4, q5, q6, q7, q1 in this order.

    By the tangent of half the angle: NumPy's vectorised tangent costs a fifth of a sine. The
    absolute error stays at rounding level for any angle.
    """
    half = np.empty((count, len(q)))
    half[:5] = q.T[1:6]
    half[1] += half[0]
    for k, joint in enumerate((6, 0)[: count - 5], start=5):
        half[k] = q[:, joint]
    half *= 0.5
    tangent = np.tan(half, out=half)
    cosine = np.square(tangent)
    cosine += 1.0
    np.divide(2.0, cosine, out=cosine)
    tangent *= cosine
    cosine -= 1.0
    return cosine, tangent


def _rotate(c: Array, s: Array, a: Array, b: Array, to_a: Array, to_b: Array) -> None:
    """Write c a + s b to ``to_a`` and c b - s a to ``to_b``."""
    np.multiply(c, a, out=to_a)
    to_a += s * b
    np.multiply(c, b, out=to_b)
    to_b -= s * a


def beta_from_links(
    links: Mapping[str, LinkMass], lengths: Lengths = LENGTHS, columns: int = 10
) -> Array:
    """Return beta from the links' masses and centres of mass.

    Source: the document's beta, with beta10 = cm6x m6 g in place of the repeated cm6z m6 g,
    and with link 7, which the document leaves out: its mass acts at the wrist's centre and
    joins beta1, 3 and 4, its moment along joint 7's axis joins beta9.

    Args:
        links: Mass and centre of mass by name, any of :data:`LINKS`; those absent weigh nothing.
        lengths: The arm's lengths, m.
        columns: 10, 12 or 14 entries, as in :func:`regressor`. Ten leave out what link 7 weighs
            off its axis; twelve are exact for vertical gravity, fourteen for any.

    Returns:
        Base parameters in N·m, shape (columns,).

    Raises:
        ConfigError: a name is no link, a number is not finite, or columns is none of 10, 12, 14.
    """
    _check_columns(columns)
    mass = dict.fromkeys(LINKS, 0.0)
    moment = {name: np.zeros(3) for name in LINKS}
    for name, link in links.items():
        if name not in LINKS:
            raise ConfigError(name, link, "one of " + ", ".join(LINKS))
        if np.shape(link.com) != (3,) or not np.isfinite([link.mass, *link.com]).all():
            raise ConfigError(name, link, "a finite mass and three finite coordinates")
        mass[name] = link.mass
        moment[name] = link.mass * np.asarray(link.com)
    m1, m2, m3, m4, m5, m6, m7, bar, crank = moment.values()
    wrist = sum(mass[f"link{i}"] for i in (4, 5, 6, 7))
    parallelogram = mass["bar"] + mass["crank"]
    forearm = mass["link3"] + wrist
    beta = [
        lengths.arm * (mass["link2"] + forearm) + m2[0] - bar[0],
        m2[1] - bar[1],
        m3[0] - crank[1] + lengths.forearm * forearm + lengths.crank * parallelogram,
        m3[2] + m4[1] + crank[0] + lengths.h * wrist,
        m4[0],
        m5[1] - m4[2],
        m5[2] + m6[1],
        m5[0],
        m6[2] + m7[2],
        m6[0],
        m7[0],
        m7[1],
        m1[0],
        m1[2] + m2[2] - m3[1] + bar[2] + crank[2],
    ]
    return GRAVITY * np.array(beta[:columns])


def beta_from_pinocchio(model: pin.Model, lengths: Lengths = LENGTHS, columns: int = 10) -> Array:
    """Return beta from the inertias of a Pinocchio model of the arm.

    The model has the arm's seven joints in order, with the same zeros and base frame. Two more
    joints, if any, are named ``bar`` and ``crank``, and their links lie at zero where the
    parallelogram is at q = 0. It does not matter where on its axis a joint's frame sits.

    Args:
        model: Pinocchio model; its inertias are read, its gravity is not.
        lengths: The arm's lengths, m.
        columns: 10, 12 or 14 entries, as in :func:`regressor`.

    Returns:
        Base parameters in N·m, shape (columns,).

    Raises:
        ConfigError: the joints are not those, or one of the seven does not turn about its axis.
    """
    serial = [name for name in model.names[1:] if name not in ("bar", "crank")]
    if len(serial) != JOINTS or len(set(model.names)) != model.njoints:
        raise ConfigError("model", list(model.names[1:]), "seven joints, and bar and crank if any")
    links = {}
    placed = [np.eye(4)]
    axis = np.eye(4)  # frame whose z is the next joint's axis, in the base
    for i in range(1, model.njoints):
        here = placed[model.parents[i]] @ model.jointPlacements[i].homogeneous
        placed.append(here)
        name = model.names[i]
        if name in serial:
            off = np.cross(here[:3, 3] - axis[:3, 3], axis[:3, 2])
            if not np.allclose([here[:3, 2] - axis[:3, 2], off], 0.0, atol=1e-6):
                raise ConfigError(name, here[:3].tolist(), "a z axis where the DH table has it")
            name = LINKS[serial.index(name)]
        frame = _frame_at_zero(name, lengths)
        axis = frame if name.startswith("link") else axis
        com = np.linalg.solve(frame, here @ [*model.inertias[i].lever, 1.0])[:3]
        links[name] = LinkMass(float(model.inertias[i].mass), tuple(com))
    return beta_from_links(links, lengths, columns)


def _frame_at_zero(name: str, lengths: Lengths) -> Array:
    """Return the document's frame of a link in the base at q = 0, shape (4, 4)."""
    origin = {
        "link1": (0.0, 0.0),
        "link2": (0.0, -lengths.arm),
        "link3": (lengths.forearm, -lengths.arm),
        "bar": (lengths.crank, 0.0),
        "crank": (lengths.crank, 0.0),
    }.get(name, (lengths.forearm, lengths.h - lengths.arm))
    frame1 = np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    signed = _FRAMES_AT_ZERO[name]
    frame = np.eye(4)
    for k in range(3):
        frame[:3, k] = frame1[:, "xyz".index(signed[2 * k + 1])] * float(signed[2 * k] + "1")
    frame[:3, 3] = frame1[:, :2] @ origin
    return frame
