"""Serial chains by Denavit and Hartenberg's four numbers, revolute or prismatic.

T = Rz(offset) Tz(d) Tx(a) Rx(alpha) (standard, distal), or Rx(alpha) Tx(a) Rz(offset) Tz(d)
(modified, proximal); the joint's position is added to the angle about z, or to the way along it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pinocchio as pin

from dvrk_gravity.arms.description import Body, JointKind
from dvrk_gravity.arrays import Array

Convention = Literal["standard", "modified"]
CONVENTIONS: tuple[Convention, ...] = ("standard", "modified")


@dataclass(frozen=True)
class DHRow:
    """One row of the table.

    Attributes:
        alpha: Twist about x, rad.
        a: Length along x, m.
        d: Way along z at zero position, m.
        offset: Angle about z at zero position, rad.
    """

    alpha: float
    a: float
    d: float
    offset: float

    @property
    def about_x(self) -> pin.SE3:
        """Tx(a) Rx(alpha), in either order the same."""
        return pin.SE3(pin.utils.rotate("x", self.alpha), np.array([self.a, 0.0, 0.0]))

    @property
    def along_z(self) -> pin.SE3:
        """Rz(offset) Tz(d), in either order the same."""
        return pin.SE3(pin.utils.rotate("z", self.offset), np.array([0.0, 0.0, self.d]))


@dataclass(frozen=True, eq=False)
class Follower:
    """A link that moves with others: its coordinate is a constant combination of joints.

    Attributes:
        name: Its name.
        parent: Name of the link that it moves on.
        placement: Its joint's frame at zero seen from the parent's *joint* frame; the axis is z.
        kind: Whether it turns about z or slides along it.
        row: (n,) coefficients of the joints.
        frame: The link's own frame seen from its joint's frame.
    """

    name: str
    parent: str
    placement: pin.SE3
    kind: JointKind
    row: Array
    frame: pin.SE3


def link_frames(table: Sequence[DHRow], convention: Convention) -> list[pin.SE3]:
    """Return each link's frame seen from its joint's frame."""
    if convention == "standard":
        return [row.along_z * row.about_x for row in table]
    return [row.along_z for row in table]


def chain(
    table: Sequence[DHRow],
    kinds: Sequence[JointKind],
    followers: Sequence[Follower] = (),
    convention: Convention = "standard",
    rows: Array | None = None,
) -> tuple[Body, ...]:
    """Return the bodies ``link1`` … ``linkn`` of a chain and those that follow, depth first.

    Args:
        table: A row a joint.
        kinds: Kind of each joint.
        followers: Links that follow, each after the one that it moves on; on one link they come
            before the chain goes on.
        convention: Of the table.
        rows: (n, n) coefficients of the joints in each link's coordinate; ``None``: each link
            moves by its own joint alone.
    """
    frames = link_frames(table, convention)
    moved_by = np.eye(len(table)) if rows is None else rows
    bodies: list[Body] = []

    def hang(link: str, parent: int) -> None:
        for follower in followers:
            if follower.parent == link:
                bodies.append(
                    Body(
                        follower.name, parent, follower.placement, follower.kind, follower.row,
                        follower.frame,
                    )
                )  # fmt: skip
                hang(follower.name, len(bodies) - 1)

    hang("base", -1)
    parent, before = -1, pin.SE3.Identity()
    for i, (row, kind, frame) in enumerate(zip(table, kinds, frames, strict=True)):
        placement = before if convention == "standard" else before * row.about_x
        bodies.append(Body(f"link{i + 1}", parent, placement, kind, moved_by[i].copy(), frame))
        parent, before = len(bodies) - 1, frame
        hang(f"link{i + 1}", parent)
    return tuple(bodies)
