"""Columns that explain one joint's torque at static poses, in groups that come and go together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity import gravity
from dvrk_gravity.arm import JOINT_NAMES, N_JOINTS, Arm
from dvrk_gravity.identify.static_poses import Poses
from dvrk_gravity.recording.data import Array
from dvrk_gravity.terms.held_load import pose_functions
from dvrk_gravity.terms.polynomial import Range

N_BETA = 10
ORDER = 4
# A function of order n is taken to be n^2 times smaller than one of order 1: what cables and
# stiction do is smooth, and five positions of a joint do not tell what lies between them.
SMOOTHNESS = 2
CONSTANT_SD = 1.0  # N·m, a constant is hardly held back

Group = tuple[int, ...]  # joints on which the functions depend, all of them


@dataclass(frozen=True, eq=False)
class JointColumns:
    """Columns of one joint besides gravity's.

    Attributes:
        joint: The joint.
        groups: Groups of columns; the joint's own position first.
        group: (p,) index of each column's group.
        orders: (p, 7) order of each joint's Chebyshev polynomial.
        along: (p,) whether the column follows the direction of approach.
        size: (p,) prior standard deviation relative to that of order one; of constants, N·m.
    """

    joint: int
    groups: tuple[Group, ...]
    group: NDArray[np.int64]
    orders: NDArray[np.int64]
    along: NDArray[np.bool_]
    size: Array

    @property
    def constant(self) -> NDArray[np.bool_]:
        """(p,) whether the column is the same at all poses."""
        return np.asarray(self.orders.sum(axis=1) == 0)

    def matrix(self, poses: Poses, valid: Range) -> Array:
        """Return the (N, p) columns at some poses."""
        values = pose_functions(poses.q, self.orders, valid)
        return np.where(self.along, poses.direction[:, self.joint, None] * values, values)

    def of(self, chosen: Sequence[Group]) -> NDArray[np.int64]:
        """Return the columns of some groups."""
        wanted = [k for k, group in enumerate(self.groups) if group in chosen]
        return np.flatnonzero(np.isin(self.group, wanted))

    def prior(self, own: float, others: float) -> Array:
        """Return (p,) standard deviations, N·m, for the sizes of order one that are given."""
        scale = np.where(self.group == 0, own, others) * self.size
        return np.where(self.constant, CONSTANT_SD, scale)


def joint_columns(joint: int, moving: Sequence[int], directed: bool) -> JointColumns:
    """Return the columns of one joint, given which joints moved.

    The joint's own position to order four; every other joint's; every pair's products.
    """
    own = (joint,)
    groups: list[Group] = [own]
    if joint in moving:
        groups += [(other,) for other in moving if other != joint]
        groups += list(combinations(moving, 2))
    rows: list[tuple[int, Array, bool, float]] = []
    for number, group in enumerate(groups):
        lowest = 0 if group == own else 1
        highest = ORDER if group != own or joint in moving else 0
        for orders in product(range(lowest, highest + 1), repeat=len(group)):
            total = sum(orders)
            if total > ORDER:
                continue
            row = np.zeros(N_JOINTS, dtype=np.int64)
            row[list(group)] = orders
            size = float(max(total, 1)) ** -SMOOTHNESS
            rows += [
                (number, row, along, size) for along in ((False, True) if directed else (False,))
            ]
    index, orders_, along_, size_ = zip(*rows, strict=True)
    return JointColumns(
        joint, tuple(groups), np.array(index), np.array(orders_), np.array(along_), np.array(size_)
    )


def gravity_rows(poses: Poses, arm: Arm) -> Array:
    """Return gravity's (N, 7, 10) columns."""
    return gravity.regressor(poses.q, arm.gravity, N_BETA)


def describe(group: Group) -> str:
    """Return the names of a group's joints."""
    return " x ".join(JOINT_NAMES[joint] for joint in group)
