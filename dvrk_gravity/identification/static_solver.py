"""Least squares of static poses: one gravity for all joints, each joint's own columns, priors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import Range
from dvrk_gravity.estimation import (
    NormalEquations,
    RobustSettings,
    RobustState,
    Solution,
    fit,
    reweighted,
)
from dvrk_gravity.identification.static_columns import (
    Group,
    JointColumns,
    joint_columns,
)
from dvrk_gravity.identification.static_gravity import GravityColumns, gravity_of
from dvrk_gravity.identification.static_poses import Poses


@dataclass(frozen=True)
class PoseSettings:
    """Of the fit to static poses.

    Attributes:
        design_effect: The residual is what stiction left there, which one row of poses shares: so
            many count as one. Of the published grid, a row of one joint is five poses and a plane
            of two 25.
        gravity_sd: Size of gravity's coefficients. Of an MTM's, N·m: none of its first moments is
            larger, times g; others' are in units of what their links may weigh.
        robust: Loss of the residuals. Poses stick, so that their tails are heavier than a motion's;
            chosen, see `make sensitivity`.
        least_scale: N·m or N, less than any motor resolves.
        rounding: Part of what a joint's torque spreads that is rounding and no noise.
    """

    design_effect: float = 25.0
    gravity_sd: float = 1.0
    robust: RobustSettings = field(default_factory=lambda: RobustSettings(2.0, 8.0, 3))
    least_scale: float = 3e-4
    rounding: float = 1e-3


@dataclass(frozen=True)
class Composition:
    """What one joint's torque is made of.

    Attributes:
        groups: Groups of columns.
        own: Prior size of functions of the joint's own position, N·m or N.
        others: Prior size of the other groups, N·m or N.
    """

    groups: tuple[Group, ...]
    own: float = 1.0
    others: float = 1.0


@dataclass(frozen=True, eq=False)
class Table:
    """Everything linear about some poses.

    Attributes:
        arm: The arm.
        poses: The poses.
        valid: Range that they cover.
        gravity_columns: What gravity's coefficients are.
        gravity: (N, n, k) columns of theirs.
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
        """Return (K, n, p) torques of all coefficients at (K, n) positions, if nothing sticks."""
        nowhere, part = np.zeros(q.shape), np.zeros(len(q), dtype=np.int64)
        there = table.at(Poses(q, nowhere, nowhere, part, table.arm.scale))
        rows = np.zeros((*q.shape, len(self.theta)))
        rows[:, :, : self.count] = there.gravity
        for joint, matrix in enumerate(there.matrices):
            columns = self.columns[joint]
            own = table.joints[joint].group[columns] == 0  # of others' positions: stiction
            rows[:, joint, self.indices(joint)[own]] = matrix[:, columns[own]]
        return rows


def solve(
    table: Table, compositions: Sequence[Composition], weight: Array, settings: PoseSettings
) -> PoseSolution:
    """Solve for all coefficients at once.

    Args:
        table: The columns.
        compositions: Of each joint.
        weight: (N, n) of each residual, 1 / (N·m)^2 or 1 / N^2.
        settings: Of the fit.
    """
    columns = tuple(
        joint.of(made.groups) for joint, made in zip(table.joints, compositions, strict=True)
    )
    count = table.gravity_columns.count
    edges = np.cumsum([count, *map(len, columns)])
    gram, cross = np.zeros((1, edges[-1], edges[-1])), np.zeros((1, edges[-1]))
    scale = np.full(edges[-1], settings.gravity_sd)
    effort = table.poses.effort
    for joint, chosen in enumerate(columns):
        x = np.concatenate([table.gravity[:, joint], table.matrices[joint][:, chosen]], axis=1)
        own = np.arange(edges[joint], edges[joint + 1])
        index = np.concatenate([np.arange(count), own])
        part = NormalEquations.of(x[:, None], effort[:, [joint]], weight[:, [joint]])
        gram[0][np.ix_(index, index)] += part.gram[0]
        cross[0, index] += part.cross[0]
        made = compositions[joint]
        scale[own] = table.joints[joint].prior(made.own, made.others)[chosen]
    power = np.array([np.sum(weight * effort**2)])
    found = fit(NormalEquations(gram, cross, power, np.array([weight.sum()])), np.ones(1), scale)
    return PoseSolution(found.theta, found.precision, found.data, found.free, count, columns)


def solve_robust(
    table: Table, compositions: Sequence[Composition], settings: PoseSettings | None = None
) -> tuple[PoseSolution, Array, Array]:
    """Return a solution, its (n,) robust residual scale and (N, n) weights."""
    settings = settings or PoseSettings()
    effort = table.poses.effort
    spread = np.maximum(effort.std(axis=0), settings.least_scale)

    def weights(state: RobustState[PoseSolution]) -> Array:
        return state.weight / (settings.design_effect * state.scale**2)

    def fitted(state: RobustState[PoseSolution]) -> tuple[PoseSolution, Array]:
        solution = solve(table, compositions, weights(state), settings)
        return solution, effort - solution.predict(table)

    start: RobustState[PoseSolution] = RobustState(np.ones_like(effort), spread)
    least = np.maximum(settings.least_scale, settings.rounding * spread)
    found = reweighted(fitted, start, settings.robust, least=least)
    assert found.fitted is not None
    return found.fitted, found.scale, weights(found)
