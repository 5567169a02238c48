"""Least squares of static poses: one gravity for all joints, each joint's own columns, priors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.console import N_POLYNOMIALS
from dvrk_gravity.effects import MAX_DEGREE, Range, pose_functions
from dvrk_gravity.estimation import (
    NormalEquations,
    RobustSettings,
    RobustState,
    Solution,
    Uncertainty,
    fit,
    masks,
    reweighted,
    sandwich,
    sequential,
)
from dvrk_gravity.identification.poses.reading import GravityColumns, Poses, gravity_of

ORDER = 4

# Prior sizes of orders 0 to 4 of the joint's own position, relative to order one: about those of
# seven published calibration files of real arms (root mean squares, joints 3 to 6), as five
# positions of a joint do not determine what lies between them. Functions of others' positions have
# n^-2.
OWN_MEAN = (1.0, 1.0, 0.3, 0.2, 0.05)
# The same of the difference between the directions of approach.
OWN_DIFFERENCE = (1.0, 0.2, 0.2, 0.1, 0.1)
# Prior size of a constant, in torques that are larger than a joint's friction or cable
# (``GravityColumns.strong``: 1 N·m on an MTM), so that it is hardly shrunk. Chosen.
CONSTANT_SD = 1.0
# Prior size of the wrist's spring or counterweight, N·m. It acts like gravity, with the sine of the
# angle, and no polynomial of order four is a sine over 250 deg. Chosen.
SPRING = 0.1
# The residual is what stiction left there, which one row of poses shares: so many count as one. Of
# the published grid, a row of one joint is five poses and a plane of two 25.
DESIGN_EFFECT = 25.0
# Prior size of gravity's coefficients. Of an MTM's, N·m: none of its first moments is larger, times
# g; others' are in units of what their links may weigh.
GRAVITY_SD = 1.0
# Loss of the residuals. Poses stick, so that their tails are heavier than a motion's. Chosen.
ROBUST = RobustSettings(2.0, 8.0, 3)
LEAST_SCALE = 3e-4  # N·m or N, less than any motor resolves
# Blocks of poses with correlated residuals, at most. Chosen: a sandwich of few of them is too
# narrow, and few may mean less than 20 to 50 (Cameron and Miller 2015).
CLUSTERS = 50
ROUNDING = 1e-3  # part of the spread of a joint's torque that is rounding and not noise

Group = tuple[int, ...]  # joints on which the functions depend, all of them


@dataclass(frozen=True, eq=False)
class JointColumns:
    """Columns of one joint besides gravity's, in groups that come and go together.

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
        """Return (p,) standard deviations, N·m or N, for given sizes of order one."""
        scale = np.where(self.group == 0, own, others) * self.size
        return np.where(np.isnan(self.absolute), scale, self.absolute)


def joint_columns(
    joint: int, poses: Poses, gravity: GravityColumns, for_console: bool = False
) -> JointColumns:
    """Return the columns that may explain one joint's torque at some poses.

    The joint's own position to order four, with sine and cosine where there is a spring; every
    other joint's; every pair's products.

    Args:
        joint: The joint.
        poses: The poses.
        gravity: Gravity's columns.
        for_console: Only what the dVRK console has as well: polynomials of degree four of the own
            position (sine and cosine as far as these can follow), nothing for joint 7.
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
    series, rows = _own_columns(joint, poses, degree, gravity)
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
    number_, orders_, along_, size_, absolute_ = map(np.array, zip(*rows, strict=True))
    return JointColumns(
        joint, tuple(groups), number_, orders_, series, along_, size_, absolute_
    )  # fmt: skip


def _own_columns(
    joint: int, poses: Poses, degree: int, gravity: GravityColumns
) -> tuple[Array, list[tuple[int, NDArray[np.int64], bool, float, float]]]:
    """Return the Chebyshev series and the rows of functions of the joint's own position.

    Sine and cosine, where it is sprung, are followed to a degree.
    """
    directed = poses.directed[joint]
    none = np.zeros(poses.q.shape[1], dtype=np.int64)
    unit = np.eye(1 + MAX_DEGREE)
    series = [unit[0]] * (1 + directed)
    constant = CONSTANT_SD * float(gravity.strong[joint])
    rows = [(0, none, along, 1.0, constant) for along in (False, True)[: 1 + directed]]
    if joint not in poses.moving:
        return np.array(series), rows
    for order in range(1, ORDER + 1):
        for along in (False, True)[: 1 + directed]:
            series.append(unit[order])
            size = (OWN_DIFFERENCE if along else OWN_MEAN)[order]
            rows.append((0, none, along, size, np.nan))
    if gravity.arm.joint_names[joint] in gravity.sprung:
        centre = 0.5 * (poses.lower[joint] + poses.upper[joint])
        half = 0.5 * (poses.upper[joint] - poses.lower[joint])
        nodes = chebyshev.chebpts1(1 + MAX_DEGREE)
        for wave in (np.sin, np.cos):
            found = chebyshev.chebfit(nodes, wave(centre + half * nodes), degree)
            series.append(np.pad(found, (0, MAX_DEGREE - degree)))
            rows.append((0, none, False, 1.0, SPRING))
    return np.array(series), rows


@dataclass(frozen=True)
class Composition:
    """Groups of columns of one joint's torque.

    Attributes:
        groups: The groups.
        own: Prior size of functions of the joint's own position, N·m or N.
        others: Prior size of the other groups, N·m or N.
    """

    groups: tuple[Group, ...]
    own: float = 1.0
    others: float = 1.0


@dataclass(frozen=True, eq=False)
class Table:
    """The linear problem of some poses.

    Attributes:
        arm: The arm.
        poses: The poses.
        valid: Range that they cover.
        gravity_columns: Gravity's columns.
        gravity: (N, n, k) their values.
        joints: Columns of each joint.
        matrices: Their (N, p) values.
    """

    arm: Arm
    poses: Poses
    valid: Range
    gravity_columns: GravityColumns
    gravity: Array
    joints: tuple[JointColumns, ...]
    matrices: tuple[Array, ...]

    @classmethod
    def of(cls, poses: Poses, arm: Arm, for_console: bool = False) -> Table:
        """Evaluate all columns at the poses, or those that the dVRK console has as well."""
        valid, gravity = Range(poses.lower, poses.upper), gravity_of(arm)
        joints = tuple(joint_columns(joint, poses, gravity, for_console) for joint in range(arm.n))
        matrices = tuple(columns.matrix(poses, valid) for columns in joints)
        return cls(arm, poses, valid, gravity, gravity.at(poses.q), joints, matrices)

    def at(self, poses: Poses) -> Table:
        """Return the same columns at other poses."""
        matrices = tuple(columns.matrix(poses, self.valid) for columns in self.joints)
        return replace(
            self, poses=poses, gravity=self.gravity_columns.at(poses.q), matrices=matrices
        )


@dataclass(frozen=True, eq=False)
class PoseSolution(Solution):
    """Coefficients: gravity's, then each joint's chosen columns.

    Attributes:
        count: Number k of gravity's.
        columns: For each joint the chosen columns of its :class:`JointColumns`.
    """

    count: int
    columns: tuple[NDArray[np.int64], ...]

    @property
    def gravity(self) -> Array:
        """(k,) those of gravity."""
        return self.theta[: self.count]

    def indices(self, joint: int) -> NDArray[np.int64]:
        """Return the indices of a joint's columns in theta."""
        start = self.count + sum(len(columns) for columns in self.columns[:joint])
        return np.arange(start, start + len(self.columns[joint]), dtype=np.int64)

    def without_stiction(self, table: Table) -> NDArray[np.int64]:
        """Return the indices of gravity's columns and those of each joint's own position."""
        own = (
            self.indices(joint)[columns.group[chosen] == 0]
            for joint, (columns, chosen) in enumerate(zip(table.joints, self.columns, strict=True))
        )
        return np.concatenate([np.arange(self.count), *own])

    def predict(self, table: Table) -> Array:
        """Return (N, n) torques at the poses of a table, N·m or N."""
        torque = table.gravity @ self.gravity
        for joint, matrix in enumerate(table.matrices):
            torque[:, joint] += matrix[:, self.columns[joint]] @ self.theta[self.indices(joint)]
        return torque

    def at_rest(self, table: Table, q: Array) -> Array:
        """Return (K, n, p) torques of all coefficients at (K, n) positions, without stiction."""
        nowhere, part = np.zeros(q.shape), np.zeros(len(q), dtype=np.int64)
        there = table.at(Poses(q, nowhere, nowhere, part, table.arm.scale))
        rows = np.zeros((*q.shape, len(self.theta)))
        rows[:, :, : self.count] = there.gravity
        for joint, matrix in enumerate(there.matrices):
            columns = self.columns[joint]
            own = table.joints[joint].group[columns] == 0  # of others' positions: stiction
            rows[:, joint, self.indices(joint)[own]] = matrix[:, columns[own]]
        return rows


def _solve(table: Table, compositions: Sequence[Composition], weight: Array) -> PoseSolution:
    """Solve for all coefficients at once, (N, n) residuals weighted in 1 / (N·m)^2 or 1 / N^2."""
    columns = tuple(
        joint.of(made.groups) for joint, made in zip(table.joints, compositions, strict=True)
    )
    count = table.gravity_columns.count
    edges = np.cumsum([count, *map(len, columns)])
    gram, cross = np.zeros((1, edges[-1], edges[-1])), np.zeros((1, edges[-1]))
    scale = np.full(edges[-1], GRAVITY_SD)
    effort = table.poses.effort
    for joint, (chosen, made) in enumerate(zip(columns, compositions, strict=True)):
        x = np.concatenate([table.gravity[:, joint], table.matrices[joint][:, chosen]], axis=1)
        own = np.arange(edges[joint], edges[joint + 1])
        index = np.concatenate([np.arange(count), own])
        part = NormalEquations.of(x[:, None], effort[:, [joint]], weight[:, [joint]])
        gram[0][np.ix_(index, index)] += part.gram[0]
        cross[0, index] += part.cross[0]
        scale[own] = table.joints[joint].prior(made.own, made.others)[chosen]
    power = np.array([np.sum(weight * effort**2)])
    found = fit(NormalEquations(gram, cross, power), np.ones(1), scale)
    return PoseSolution(found.theta, found.precision, found.data, found.free, count, columns)


def solve_robust(
    table: Table, compositions: Sequence[Composition]
) -> tuple[PoseSolution, Array, Array]:
    """Return a solution, its (n,) robust residual scale and (N, n) weights."""
    effort = table.poses.effort
    spread = np.maximum(effort.std(axis=0), LEAST_SCALE)

    def weights(state: RobustState[PoseSolution]) -> Array:
        return state.weight / (DESIGN_EFFECT * state.scale**2)

    def fitted(state: RobustState[PoseSolution]) -> tuple[PoseSolution, Array]:
        solution = _solve(table, compositions, weights(state))
        return solution, effort - solution.predict(table)

    start: RobustState[PoseSolution] = RobustState(np.ones_like(effort), spread)
    least = np.maximum(LEAST_SCALE, ROUNDING * spread)
    found = reweighted(fitted, start, ROBUST, least=least)
    assert found.fitted is not None
    return found.fitted, found.scale, weights(found)


def pose_uncertainty(table: Table, solution: PoseSolution, weight: Array) -> Uncertainty:
    """Return the covariance of the coefficients.

    Stiction's residuals are correlated over neighbouring poses; the sandwich sums them over
    contiguous blocks of poses (Liang and Zeger 1986) before squaring.
    """
    residual = table.poses.effort - solution.predict(table)
    scores = []
    for mask in masks(sequential(len(residual), min(CLUSTERS, len(residual)))):
        score = np.zeros(len(solution.theta))
        for joint in range(residual.shape[1]):
            pull = weight[mask, joint] * residual[mask, joint]
            score[: solution.count] += table.gravity[mask, joint].T @ pull
            chosen = table.matrices[joint][mask][:, solution.columns[joint]]
            score[solution.indices(joint)] += chosen.T @ pull
        scores.append(score)
    summed = np.array(scores)
    return sandwich(solution, summed.T @ summed)
