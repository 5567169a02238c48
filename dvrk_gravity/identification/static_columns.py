"""Columns that explain one joint's torque at static poses, in groups that come and go together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from dvrk_gravity.arrays import Array
from dvrk_gravity.console import N_POLYNOMIALS
from dvrk_gravity.effects import MAX_DEGREE, Range, pose_functions
from dvrk_gravity.identification.static_gravity import GravityColumns
from dvrk_gravity.identification.static_poses import Poses

ORDER = 4

Group = tuple[int, ...]  # joints on which the functions depend, all of them


@dataclass(frozen=True)
class PoseColumnSettings:
    """How large functions of the pose are before any data.

    What cables and stiction do is smooth, and five positions of a joint do not tell what lies
    between them.

    Attributes:
        own_mean: Sizes of orders 0 to 4 of the joint's own position, relative to order one. About
            those of seven published calibration files of real arms (root mean squares, joints 3 to
            6). Functions of others' positions have n^-2.
        own_difference: The same of the difference between the directions of approach.
        constant_sd: Size of a constant, in torques that are more than a joint's friction or cable
            (``GravityColumns.strong``: 1 N·m on an MTM), so that it is hardly held back. Chosen.
        spring: Size of the wrist's spring or counterweight, N·m. It acts like gravity, with the
            sine of the angle, and no polynomial of order four is a sine over 250 deg. Chosen.
    """

    own_mean: tuple[float, ...] = (1.0, 1.0, 0.3, 0.2, 0.05)
    own_difference: tuple[float, ...] = (1.0, 0.2, 0.2, 0.1, 0.1)
    constant_sd: float = 1.0
    spring: float = 0.1


@dataclass(frozen=True, eq=False)
class JointColumns:
    """Columns of one joint besides gravity's.

    Attributes:
        joint: The joint.
        groups: Groups of columns; the joint's own position first.
        group: (p,) index of each column's group.
        orders: (p, n) order of each joint's Chebyshev polynomial.
        own: (p0, 13) Chebyshev series of the first p0 columns, functions of the joint's own
            position, in place of their orders.
        along: (p,) whether the column follows the direction of approach.
        size: (p,) prior standard deviation relative to that of order one.
        absolute: (p,) prior standard deviation where it is known beforehand, N·m or N, else NaN.
    """

    joint: int
    groups: tuple[Group, ...]
    group: NDArray[np.int64]
    orders: NDArray[np.int64]
    own: Array
    along: NDArray[np.bool_]
    size: Array
    absolute: Array

    def matrix(self, poses: Poses, valid: Range) -> Array:
        """Return the (N, p) columns at some poses."""
        count = len(self.own)
        single = np.zeros((1 + MAX_DEGREE, poses.q.shape[1]), dtype=np.int64)
        single[:, self.joint] = np.arange(1 + MAX_DEGREE)
        values = np.concatenate(
            [
                pose_functions(poses.q, single, valid) @ self.own.T,
                pose_functions(poses.q, self.orders[count:], valid),
            ],
            axis=1,
        )
        return np.where(self.along, poses.direction[:, self.joint, None] * values, values)

    def of(self, chosen: Sequence[Group]) -> NDArray[np.int64]:
        """Return the columns of some groups."""
        wanted = [k for k, group in enumerate(self.groups) if group in chosen]
        return np.flatnonzero(np.isin(self.group, wanted))

    def prior(self, own: float, others: float) -> Array:
        """Return (p,) standard deviations, N·m or N, for sizes of order one that are given."""
        scale = np.where(self.group == 0, own, others) * self.size
        return np.where(np.isnan(self.absolute), scale, self.absolute)


def joint_columns(
    joint: int, poses: Poses, beside: GravityColumns, for_console: bool = False
) -> JointColumns:
    """Return the columns that may explain one joint's torque at some poses.

    The joint's own position to order four, with sine and cosine where there is a spring; every
    other joint's; every pair's products.

    Args:
        joint: The joint.
        poses: The poses.
        beside: Gravity's columns.
        for_console: Only what the dVRK console has as well: polynomials of degree four of the own
            position (of sine and cosine what these can follow), nothing for joint 7.
    """
    moving, directed, n = poses.moving, poses.directed[joint], poses.q.shape[1]
    groups: list[Group] = [(joint,)]
    if for_console and joint >= N_POLYNOMIALS:
        none, nothing = np.zeros(0, dtype=np.int64), np.zeros(0)
        return JointColumns(
            joint, tuple(groups), none, none.reshape(0, n),
            nothing.reshape(0, 1 + MAX_DEGREE), none.astype(bool), nothing, nothing,
        )  # fmt: skip
    degree = ORDER if for_console else MAX_DEGREE
    series, rows = _own_columns(joint, poses, degree, beside)
    if joint in moving and not for_console:
        groups += [(other,) for other in moving if other != joint]
        groups += list(combinations(moving, 2))
    for number, group in enumerate(groups[1:], start=1):
        for orders in product(range(1, ORDER + 1), repeat=len(group)):
            if sum(orders) <= ORDER:
                row = np.zeros(n, dtype=np.int64)
                row[list(group)] = orders
                size = float(sum(orders)) ** -2
                rows += [
                    (number, row, along, size, np.nan) for along in (False, True)[: 1 + directed]
                ]
    number_, orders_, along_, size_, absolute_ = (
        np.array(column) for column in zip(*rows, strict=True)
    )
    return JointColumns(
        joint, tuple(groups), number_, orders_, series, along_, size_, absolute_
    )  # fmt: skip


def _own_columns(
    joint: int, poses: Poses, degree: int, beside: GravityColumns
) -> tuple[Array, list[tuple[int, NDArray[np.int64], bool, float, float]]]:
    """Return the Chebyshev series and the rows of functions of the joint's own position.

    Sine and cosine, where it is sprung, are followed to a degree.
    """
    name = beside.arm.joint_names[joint]
    directed, settings = poses.directed[joint], PoseColumnSettings()
    none = np.zeros(poses.q.shape[1], dtype=np.int64)
    unit = np.eye(1 + MAX_DEGREE)
    series = [unit[0]] * (1 + directed)
    constant = settings.constant_sd * float(beside.strong[joint])
    rows = [(0, none, along, 1.0, constant) for along in (False, True)[: 1 + directed]]
    if joint not in poses.moving:
        return np.array(series), rows
    for order in range(1, ORDER + 1):
        for along in (False, True)[: 1 + directed]:
            series.append(unit[order])
            size = (settings.own_difference if along else settings.own_mean)[order]
            rows.append((0, none, along, size, np.nan))
    if name in beside.sprung:
        centre = 0.5 * (poses.lower[joint] + poses.upper[joint])
        half = 0.5 * (poses.upper[joint] - poses.lower[joint])
        nodes = chebyshev.chebpts1(1 + MAX_DEGREE)
        for wave in (np.sin, np.cos):
            found = chebyshev.chebfit(nodes, wave(centre + half * nodes), degree)
            series.append(np.pad(found, (0, MAX_DEGREE - degree)))
            rows.append((0, none, False, 1.0, settings.spring))
    return np.array(series), rows


def describe(group: Group, names: Sequence[str]) -> str:
    """Return the names of a group's joints."""
    return " x ".join(names[joint] for joint in group)
