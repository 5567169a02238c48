"""Least squares of static poses: one beta for all joints, each joint's own columns, priors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arm import N_JOINTS, Arm
from dvrk_gravity.effects.polynomial import Range
from dvrk_gravity.identification.static_columns import (
    N_BETA,
    Group,
    JointColumns,
    gravity_rows,
    joint_columns,
)
from dvrk_gravity.identification.static_poses import Poses
from dvrk_gravity.recording.data import Array

# The residual is what stiction left there, which one row of poses shares: so many count as one.
TOGETHER = 25.0
BETA_SD = 1.0  # N·m: no MTM's first moments are larger, times g
HUBER = 2.0  # residuals, in standard deviations, from which on they count less
OUTLIER = 8.0  # and from which on they do not count at all
ROUNDS = 3
LEAST_SCALE = 3e-4  # N·m, less than any motor resolves


@dataclass(frozen=True)
class Choice:
    """What one joint's torque is made of.

    Attributes:
        groups: Groups of columns.
        own: Prior size of functions of the joint's own position, N·m.
        others: Prior size of the other groups, N·m.
    """

    groups: tuple[Group, ...]
    own: float = 1.0
    others: float = 1.0


@dataclass(frozen=True, eq=False)
class Table:
    """Everything linear about some poses.

    Attributes:
        poses: The poses.
        valid: Range that they cover.
        gravity: (N, 7, 10) columns.
        joints: Columns of each joint.
        matrices: Their (N, p) values.
    """

    poses: Poses
    valid: Range
    gravity: Array
    joints: tuple[JointColumns, ...]
    matrices: tuple[Array, ...]

    @classmethod
    def of(cls, poses: Poses, arm: Arm, for_console: bool = False) -> Table:
        """Evaluate all columns at the poses, or those that the dVRK console has as well."""
        valid = Range(poses.lower, poses.upper)
        joints = tuple(joint_columns(joint, poses, for_console) for joint in range(N_JOINTS))
        matrices = tuple(columns.matrix(poses, valid) for columns in joints)
        return cls(poses, valid, gravity_rows(poses, arm), joints, matrices)

    def at(self, poses: Poses, arm: Arm) -> Table:
        """Return the same columns at other poses."""
        matrices = tuple(columns.matrix(poses, self.valid) for columns in self.joints)
        return replace(self, poses=poses, gravity=gravity_rows(poses, arm), matrices=matrices)


@dataclass(frozen=True, eq=False)
class Solution:
    """Coefficients: beta, then each joint's chosen columns.

    Attributes:
        theta: (p,) all of them.
        columns: For each joint the chosen columns of its :class:`JointColumns`.
        data: (p, p) information of the data.
        precision: (p, p) with the priors.
    """

    theta: Array
    columns: tuple[NDArray[np.int64], ...]
    data: Array
    precision: Array

    @property
    def beta(self) -> Array:
        """(10,) N·m."""
        return self.theta[:N_BETA]

    def places(self, joint: int) -> NDArray[np.int64]:
        """Return the places of a joint's columns in theta."""
        start = N_BETA + sum(len(columns) for columns in self.columns[:joint])
        return np.arange(start, start + len(self.columns[joint]), dtype=np.int64)

    def predict(self, table: Table) -> Array:
        """Return (N, 7) torques at the poses of a table, N·m."""
        torque = table.gravity @ self.beta
        for joint, matrix in enumerate(table.matrices):
            torque[:, joint] += matrix[:, self.columns[joint]] @ self.theta[self.places(joint)]
        return torque

    def at_rest(self, table: Table, q: Array, arm: Arm) -> Array:
        """Return (K, 7, p) torques of all coefficients at (K, 7) positions, if nothing sticks."""
        nowhere = np.zeros(q.shape)
        there = table.at(Poses(q, nowhere, nowhere, np.zeros(len(q), dtype=np.int64)), arm)
        rows = np.zeros((*q.shape, len(self.theta)))
        rows[:, :, :N_BETA] = there.gravity
        for joint, matrix in enumerate(there.matrices):
            columns = self.columns[joint]
            own = table.joints[joint].group[columns] == 0  # of others' positions: stiction
            rows[:, joint, self.places(joint)[own]] = matrix[:, columns[own]]
        return rows


def solve(table: Table, choices: Sequence[Choice], weight: Array) -> Solution:
    """Solve for all coefficients at once.

    Args:
        table: The columns.
        choices: Of each joint.
        weight: (N, 7) of each residual, 1 / (N·m)^2.
    """
    columns = tuple(table.joints[j].of(choices[j].groups) for j in range(N_JOINTS))
    size = N_BETA + sum(map(len, columns))
    data, right, prior = np.zeros((size, size)), np.zeros(size), np.full(size, BETA_SD**-2.0)
    solution = Solution(right, columns, data, data)
    for joint in range(N_JOINTS):
        x = np.concatenate(
            [table.gravity[:, joint], table.matrices[joint][:, columns[joint]]], axis=1
        )
        places = np.concatenate([np.arange(N_BETA), solution.places(joint)])
        weighted = x * weight[:, joint, None]
        data[np.ix_(places, places)] += weighted.T @ x
        right[places] += weighted.T @ table.poses.effort[:, joint]
        deviation = table.joints[joint].prior(choices[joint].own, choices[joint].others)
        prior[places[N_BETA:]] = deviation[columns[joint]] ** -2.0
    precision = data + np.diag(prior)
    theta = np.asarray(np.linalg.solve(precision, right), dtype=float)
    return Solution(theta, columns, data, precision)


def scale_of(residual: Array) -> Array:
    """Return (7,) robust standard deviations of (N, 7) residuals, N·m."""
    return np.maximum(1.4826 * np.median(np.abs(residual), axis=0), LEAST_SCALE)


def weights(residual: Array, scale: Array) -> Array:
    """Return (N, 7) weights: Huber's, and none for what no model of poses can mean."""
    size = np.abs(residual) / scale
    robust = np.where(size > OUTLIER, 0.0, np.minimum(1.0, HUBER / np.maximum(size, HUBER)))
    return robust / (TOGETHER * scale**2)


def solve_robust(
    table: Table, choices: Sequence[Choice], weight: Array | None = None
) -> tuple[Solution, Array, Array]:
    """Return a solution, its (7,) robust residual scale and (N, 7) weights."""
    spread = np.maximum(table.poses.effort.std(axis=0), LEAST_SCALE)
    if weight is None:
        weight = np.broadcast_to(spread**-2.0 / TOGETHER, table.poses.effort.shape)
    for _ in range(ROUNDS):
        solution = solve(table, choices, weight)
        residual = table.poses.effort - solution.predict(table)
        # Less than a thousandth of what a joint shows is rounding, not noise.
        scale = np.maximum(scale_of(residual), 1e-3 * spread)
        weight = weights(residual, scale)
    return solution, scale, weight
