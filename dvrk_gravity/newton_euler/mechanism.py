"""A serial chain in the document's terms: links, joints, loads from outside.

Source: "Recursive inverse dynamics", section 2.1 (settings). Where the text leaves
a choice, the printed reactions decided; docs/newton_euler.md shows how.

Frames. Frame 0 is the absolute one: j (y) upward, k (z) out of the plane. Frame i
belongs to link i, has its origin at the joint point P_i and its z axis along
joint i. Link i's end is Q_i = P_i + length_i x_i. Between frame i-1 and frame i:

    R = Rz(c) Ry(b) Rx(a) · Rz(q_i)      origin at Q_{i-1}                revolute, rigid
    R = Rz(c) Ry(b) Rx(a)                origin at Q_{i-1} + z_i q_i      prismatic

with (a, b, c) the joint's three angles. Q_0 is the absolute origin.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from dvrk_gravity.arms import GRAVITY, Body, JointKind
from dvrk_gravity.arrays import Array
from dvrk_gravity.errors import ConfigError

# Relative to the largest entry: what rounding leaves of symmetry after a rotation.
INERTIA_TOLERANCE = 1e-9


class JointType(IntEnum):
    """The document's joint types."""

    REVOLUTE = 0
    PRISMATIC = 1
    RIGID = 2


@dataclass(frozen=True)
class Link:
    """One rigid body of the chain.

    Attributes:
        length: Distance from P_i to Q_i along the link's x axis, m.
        mass: kg.
        com: Centre of mass seen from P_i in the link's frame, (3,), m.
        inertia: About the centre of mass in the link's axes, (3, 3), kg·m².
        accept_impossible_inertia: Compute with an inertia that breaks the triangle
            inequality (the document's exercise 4.1 prints such ones).
    """

    length: float
    mass: float
    com: Array
    inertia: Array
    accept_impossible_inertia: bool = False


@dataclass(frozen=True)
class LinkJoint:
    """The joint in front of a link.

    Attributes:
        type: Revolute or prismatic along the link's z axis, or rigid.
        rotation: Axes of frame i in frame i-1 when q_i = 0, (3, 3).
    """

    type: JointType
    rotation: Array


def rotation_matrix(angles: ArrayLike) -> Array:
    """Return Rz(c) Ry(b) Rx(a), (3, 3), of the angles (a, b, c) about x, y and z, rad.

    Exercise 4.1 settles the order: only with z last does its printed reaction of
    joint 2 keep its x component under gravity.
    """
    a, b, c = np.asarray(angles, dtype=float)
    about_x = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    about_y = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
    about_z = np.array([[np.cos(c), -np.sin(c), 0], [np.sin(c), np.cos(c), 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


def _no_rows(columns: int) -> Array:
    return np.zeros((0, columns))


@dataclass(frozen=True)
class Mechanism:
    """A serial chain and what acts on it from outside.

    Attributes:
        links: n links, from the ground to the tip.
        joints: n joints; joint i carries link i.
        gravity: Acceleration of gravity in the absolute frame, (3,), m/s².
        forces: Rows (Fx, Fy, Fz, link, px, py, pz): force in the absolute frame, N;
            number of the link, from 1; point in that link's frame, m. (K, 7).
        moments: Rows (Mx, My, Mz, link), N·m, in the absolute frame. (L, 4).
        title: What the file calls it.

    Raises:
        ConfigError: Naming the link and the field, for values that no mechanism has.
    """

    links: tuple[Link, ...]
    joints: tuple[LinkJoint, ...]
    gravity: Array = field(default_factory=lambda: np.array([0.0, -GRAVITY, 0.0]))
    forces: Array = field(default_factory=lambda: _no_rows(7))
    moments: Array = field(default_factory=lambda: _no_rows(4))
    title: str = ""

    def __post_init__(self) -> None:
        """Refuse what cannot be a mechanism."""
        if not self.links:
            raise ConfigError("links", [], "at least one link")
        if len(self.joints) != len(self.links):
            raise ConfigError(
                "joints", f"{len(self.joints)} joints", f"{len(self.links)}, one in front of a link"
            )
        for number, link in enumerate(self.links, start=1):
            _check_link(f"link {number}", link)
        for name, rows in (("forces", self.forces), ("moments", self.moments)):
            for row, values in enumerate(rows, start=1):
                if values[3] not in range(1, len(self.links) + 1):
                    raise ConfigError(
                        f"{name} row {row}: link",
                        float(values[3]),
                        f"the number of a link, 1 to {len(self.links)}",
                    )

    @property
    def n(self) -> int:
        """Number of joints, rigid ones included."""
        return len(self.joints)

    @property
    def bodies(self) -> tuple[Body, ...]:
        """The chain as the bodies of an arm; a rigid joint is a revolute one that stays at zero."""
        bodies: list[Body] = []
        end = np.zeros(3)
        for i, (link, joint) in enumerate(zip(self.links, self.joints, strict=True)):
            kind: JointKind = "prismatic" if joint.type is JointType.PRISMATIC else "revolute"
            placement = pin.SE3(joint.rotation, end)
            row, frame = np.eye(self.n)[i], pin.SE3.Identity()
            bodies.append(Body(f"link_{i + 1}", i - 1, placement, kind, row, frame))
            end = np.array([link.length, 0.0, 0.0])
        return tuple(bodies)


def _check_link(name: str, link: Link) -> None:
    """Raise ``ConfigError`` for a link that no body can be."""
    for key in ("length", "mass", "com", "inertia"):
        value = np.asarray(getattr(link, key), dtype=float)
        if not np.all(np.isfinite(value)):
            raise ConfigError(f"{name}: {key}", value.tolist(), "finite numbers")
    if link.length < 0:
        raise ConfigError(f"{name}: length", link.length, "0 m or more")
    if link.mass < 0:
        raise ConfigError(f"{name}: mass", link.mass, "0 kg or more")
    _check_inertia(f"{name}: inertia", link)


def _check_inertia(name: str, link: Link) -> None:
    inertia = np.asarray(link.inertia, dtype=float)
    tolerance = INERTIA_TOLERANCE * np.max(np.abs(inertia))
    if np.max(np.abs(inertia - inertia.T)) > tolerance:
        raise ConfigError(name, inertia.tolist(), "a symmetric matrix")
    if link.mass == 0 and np.any(inertia):
        raise ConfigError(name, inertia.tolist(), "zeros, as the link has no mass")
    smallest, middle, largest = np.linalg.eigvalsh(inertia)
    if smallest < -tolerance:
        raise ConfigError(
            name, inertia.tolist(), f"no negative principal moment (it has {smallest:.4g} kg·m²)"
        )
    if largest > smallest + middle + tolerance and not link.accept_impossible_inertia:
        raise ConfigError(
            name,
            inertia.tolist(),
            f"principal moments that a body can have: the largest ({largest:.4g} kg·m²) at most "
            f"the sum of the other two ({smallest + middle:.4g}), or accept_impossible_inertia: "
            "true to compute with it",
        )
