"""Encoder offsets and tilt of the base: what torque is not linear in.

Linearised about assumed kinematics, the torque is linear in their errors. The slopes are columns of
a fit like all others; its coefficients correct the kinematics, and the slopes are computed again
(Gauss-Newton, with everything that is linear solved for at every step).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
import pinocchio as pin

from dvrk_gravity import gravity
from dvrk_gravity.arms import Arm, rigid_body
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import (
    Column,
    ColumnTable,
    Kind,
    SearchMove,
    Site,
    State,
    effects,
)

_STEP = 1e-6  # rad, of one-sided differences: half the digits of a double


@dataclass(frozen=True, eq=False)
class KinematicCalibration:
    """Assumed encoder offsets and base tilt, and the links that their slopes are computed with.

    Attributes:
        offset: (n,) measured minus true position, rad; (1,) for the same of all joints.
        tilt: (2,) roll and pitch of the base beyond those in the arm's file, rad.
        links: (10 bodies,) link parameters; ``None``: no slopes.
        springs: (n,) what springs add to the first entries of beta, N·m.
    """

    offset: Array = field(default_factory=lambda: np.zeros(1))
    tilt: Array = field(default_factory=lambda: np.zeros(2))
    links: Array | None = None
    springs: Array = field(default_factory=lambda: np.zeros(0))

    def mount(self, arm: Arm) -> Arm:
        """Return an arm with its base tilted."""
        if not self.tilt.any():
            return arm
        turn = pin.rpy.rpyToMatrix(*arm.base_rpy) @ pin.rpy.rpyToMatrix(*self.tilt, 0.0)
        return replace(arm, base_rpy=tuple(pin.rpy.matrixToRpy(turn).tolist()))

    def true(self, state: State) -> State:
        """Return a measured state with the offsets removed."""
        return replace(state, q=state.q - self.offset) if self.offset.any() else state

    def columns(self, arm: Arm) -> tuple[Column, ...]:
        """Return the columns of :meth:`slopes`, none without links to take them with."""
        return () if self.links is None else kinematic_columns(arm)

    def updated(
        self, arm: Arm, change: Array, links: Array, springs: Array
    ) -> KinematicCalibration:
        """Return the kinematics that (k,) coefficients of :meth:`columns` ask for.

        Args:
            arm: The arm.
            change: The coefficients, rad.
            links: (10 bodies,) link parameters for its slopes.
            springs: (s,) what springs add, N·m.
        """
        offset, tilt = self.offset + np.zeros(arm.n), self.tilt.copy()
        for column, value in zip(self.columns(arm), change.tolist(), strict=True):
            if column.site.kind is Kind.BASE:
                tilt[column.index] += value
            else:
                offset[column.joint] += value
        return KinematicCalibration(offset, tilt, links, springs)

    def smooth_slopes(self, arm: Arm, state: State, stride: int) -> Array:
        """Return :meth:`slopes` from every few samples of a smooth motion, by cubic splines."""
        from scipy.interpolate import CubicSpline

        last = len(state.q) - 1
        if stride == 1 or last < stride:
            return self.slopes(arm, state)
        knots = np.unique(np.append(np.arange(0, last, stride), last))
        at_knots = self.slopes(arm, state.rows(knots))
        return np.asarray(CubicSpline(knots, at_knots)(np.arange(last + 1)))

    def slopes(self, arm: Arm, state: State) -> Array:
        """Return (N, n, k) joint torques per rad of :meth:`columns`: offsets, roll and pitch.

        Args:
            arm: The arm, its base not tilted yet.
            state: The measured motion, (N, n) arrays.
        """
        vector = self.mount(arm).gravity
        here = self._torque(arm, self.true(state), vector)
        at_rest = State(self.true(state).q)
        columns = []
        for column in kinematic_columns(arm):
            if column.site.kind is Kind.BASE:
                step = _STEP * (np.arange(2) == column.index)
                # Weight is linear in gravity, and nothing else of the torque knows of it.
                turned = replace(self, tilt=self.tilt + step).mount(arm).gravity
                columns.append(self._torque(arm, at_rest, (turned - vector) / _STEP))
            else:
                step = _STEP * (np.arange(arm.n) == column.joint)
                there = replace(self, offset=self.offset + step).true(state)
                columns.append((self._torque(arm, there, vector) - here) / _STEP)
        return np.stack(columns, axis=-1)

    def _torque(self, arm: Arm, true: State, vector: Array) -> Array:
        assert self.links is not None
        torque = rigid_body.torque(arm, self.links, true.q, true.qd, true.qdd, vector)
        if not len(self.springs):
            return torque
        columns = gravity.regressor(true.q, vector)[..., : len(self.springs)]
        return torque + columns @ self.springs


def kinematic_columns(arm: Arm) -> tuple[Column, ...]:
    """Return the columns of all encoder offsets that torque shows, and of the base's tilt."""
    return tuple(column for effect in effects() for column in effect.kinematic_columns(arm))


def offset_joints(arm: Arm) -> tuple[int, ...]:
    """Return the joints whose encoder offsets are identifiable from torque."""
    return tuple(column.joint for column in kinematic_columns(arm) if column.joint >= 0)


def kinematic_moves(columns: ColumnTable, inside: set[int]) -> Iterator[SearchMove]:
    """Yield the tilt of the base and the zeros of joints that are not yet in."""
    known = {column.key for column in kinematic_columns(columns.arm)}
    free: dict[Site, list[int]] = {}  # roll and pitch come together
    for i, column in enumerate(columns.columns):
        if column.key in known and i not in inside:
            free.setdefault(column.site, []).append(i)
    for site, indices in sorted(free.items(), key=lambda each: each[0].kind is not Kind.BASE):
        name = columns.columns[indices[0]].effect
        words = "" if site.kind is Kind.BASE else f" {site.words(columns.arm)}"
        yield SearchMove(tuple(indices), (), f"{name}{words}")
