"""The columns that a fit may use: what each is, its prior size, and its way into a model.

They are those of the rigid body, of every effect that says what a fit solves for in it
(:meth:`~dvrk_gravity.effects.LinearTerm.unknowns`), and of zeros of joints and tilt of the base.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity import effects
from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import Column, LinearTerm, Range, State, Term, Unknowns
from dvrk_gravity.identification.kinematic_calibration import KINEMATIC, KinematicCalibration
from dvrk_gravity.identification.rigid_columns import RIGID, RigidColumns


def identified(arm: Arm) -> tuple[str, ...]:
    """Return the names of the effects that trajectories of an arm are fitted with."""
    found = (unknowns.term.NAME for unknowns in _unknowns(arm, Range(*arm.range)))
    return tuple(sorted({*RIGID, *KINEMATIC, *found}))


class Columns:
    """All columns of one arm over one range of positions.

    Class attributes:
        ABSENT: Numbers of link parameters that are taken to be zero.

    Attributes:
        arm: The arm.
        kinematics: Where its joints and base are.
        mounted: The arm with its base as the calibration has it.
        valid: Range of positions in the data.
        columns: What they are, in order.
    """

    ABSENT: ClassVar[tuple[int, ...]] = ()

    def __init__(
        self, arm: Arm, lower: Array, upper: Array, kinematics: KinematicCalibration | None = None
    ) -> None:
        """Lay the columns out for data between (n,) ``lower`` and ``upper`` measured positions."""
        self.arm = arm
        self.kinematics = KinematicCalibration() if kinematics is None else kinematics
        self.mounted = self.kinematics.mounted(arm)
        self.valid = Range(lower - self.kinematics.offset, upper - self.kinematics.offset)
        self._rigid = RigidColumns(self.mounted, self.ABSENT)
        self._unknowns = tuple(_unknowns(arm, self.valid))
        columns = [*self._rigid.columns]
        for unknowns in self._unknowns:
            columns += unknowns.columns
        self.columns = (*columns, *self.kinematics.columns(arm))

    @property
    def base(self) -> Array:
        """(10 bodies, b) from base combinations of unit prior size to the links' parameters."""
        return self._rigid.base

    @property
    def terms_looked_for(self) -> tuple[LinearTerm, ...]:
        """The effects' terms that are fitted, their coefficients zero."""
        return tuple(unknowns.term for unknowns in self._unknowns)

    @cached_property
    def scale(self) -> Array:
        """(p,) prior standard deviations."""
        return np.array([column.scale for column in self.columns])

    @cached_property
    def positive(self) -> NDArray[np.bool_]:
        """(p,) mask of the columns that must not be negative."""
        return np.array([column.positive for column in self.columns])

    def offers(self, column: Column) -> bool:
        """Tell whether a fit may use a column; the noise is judged by all of them."""
        return True

    def select(self, **wanted: object) -> list[int]:
        """Return the indices of the columns whose fields have the wanted values."""
        key = tuple(wanted.items())
        if key not in self._selected:
            self._selected[key] = [
                index
                for index, column in enumerate(self.columns)
                if all(getattr(column, name) == value for name, value in key)
            ]
        return list(self._selected[key])

    @cached_property
    def _selected(self) -> dict[tuple[tuple[str, object], ...], list[int]]:
        """What was selected before: searches ask the same thousands of times."""
        return {}

    def same(self, chosen: Sequence[int], others: Columns) -> list[int]:
        """Return which of other columns are the chosen ones; of the rigid body it is all."""
        keys = {self.columns[i].key for i in chosen}
        return [
            index
            for index, column in enumerate(others.columns)
            if column.effect == RIGID[0] or column.key in keys
        ]

    def effect(self, index: int) -> type[LinearTerm]:
        """Return the effect of a column that is one of a term's coefficients."""
        name = self.columns[index].effect
        return next(type(term) for term in self.terms_looked_for if name == term.NAME)

    def basis(self, effect: str) -> Array:
        """Return (k, p) from the coefficients of an effect's columns to its term's theta."""
        (unknowns,) = (unknowns for unknowns in self._unknowns if effect == unknowns.term.NAME)
        return np.eye(len(unknowns.columns)) if unknowns.basis is None else unknowns.basis

    def history(self, state: State, before: Array | None = None) -> Array:
        """Return (N, m) what effects remember along a motion.

        Args:
            state: (N, n) arrays, a whole motion or its continuation.
            before: (m,) at its first sample, if it continues one.
        """
        known = [None] * len(self._unknowns) if before is None else self._split(before)
        parts = [
            unknowns.term.memory(state, part)
            for unknowns, part in zip(self._unknowns, known, strict=True)
        ]
        return np.concatenate(parts, axis=-1)

    def regressor(self, state: State, history: Array, stride: int = 1) -> Array:
        """Return (N, n, p) torques *at the motors* of all columns.

        Args:
            state: (N, n) arrays, part of a motion.
            history: (N, m), the same part of :meth:`history`.
            stride: Samples over which the motion is smooth: the calibration's slopes, as
                smooth and dear to evaluate, are taken so far apart, with cubic splines between.
        """
        true = self.kinematics.true(state)
        parts = [self._rigid.regressor(true)]
        parts += [
            unknowns.regressor(true, memory)
            for unknowns, memory in zip(self._unknowns, self._split(history), strict=True)
        ]
        if self.kinematics.links is not None:
            parts.append(self.kinematics.smooth_slopes(self.arm, state, stride))
        return np.matmul(self.arm.actuator_to_joint.T, np.concatenate(parts, axis=-1))

    def at_rest(self, q: Array) -> Array:
        """Return (N, n, p) torques at the motors at (N, n) positions, nothing remembered."""
        rest = np.zeros((len(q), sum(self._memories)))
        return self.regressor(State(q, np.zeros_like(q), np.zeros_like(q)), rest)

    @cached_property
    def _memories(self) -> tuple[int, ...]:
        """How many numbers each effect remembers."""
        still = State(np.zeros((1, self.arm.n)))
        return tuple(unknowns.term.memory(still).shape[1] for unknowns in self._unknowns)

    def _split(self, memory: Array) -> list[Array]:
        """Return each effect's part of (…, m) memory."""
        return np.split(memory, np.cumsum(self._memories)[:-1], axis=-1)

    def corrected(self, theta: Array) -> KinematicCalibration:
        """Return the kinematics that (p,) coefficients ask for, with their links for its slopes."""
        links, springs = self._rigid.bodies(theta[: len(self._rigid.columns)])
        change = theta[len(theta) - len(self.kinematics.columns(self.arm)) :]
        return self.kinematics.moved(self.arm, change, links, springs)

    def terms(self, theta: Array, links: Array | None = None) -> tuple[Term, ...]:
        """Return the model's terms for (p,) coefficients; those that are zero are left out.

        Args:
            theta: The coefficients.
            links: (10 bodies,) link parameters to use for those of the base combinations.
        """
        start = len(self._rigid.columns)
        built = self._rigid.terms(self.arm, theta[:start], links)
        for unknowns in self._unknowns:
            found = unknowns.found(theta[start : start + len(unknowns.columns)])
            start += len(unknowns.columns)
            if found is not None:
                built.append(found)
        return tuple(built)


def _unknowns(arm: Arm, valid: Range) -> Iterator[Unknowns]:
    for effect in effects.terms():
        found = effect.unknowns(arm, valid) if issubclass(effect, LinearTerm) else None
        if found is not None:
            yield found
