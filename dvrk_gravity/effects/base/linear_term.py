"""Terms that are linear in their coefficients, and what a fit solves for in them."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self, cast

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.column import Column, ColumnTable, SearchMove, site_columns
from dvrk_gravity.effects.base.motion import State
from dvrk_gravity.effects.base.polynomials import Range
from dvrk_gravity.effects.base.site import THE_ARM, Kind, Site
from dvrk_gravity.effects.base.term import Term
from dvrk_gravity.errors import EffectError


class LinearTerm(Term):
    """A term that is linear in k coefficients: ``torque = regressor @ theta``.

    Identification solves for theta; everything else (ranges, transition velocities, gravity's
    direction) is fixed. A minimal one, a dataclass, adds ``COEFFICIENTS`` and :meth:`regressor` to
    a term, and :meth:`plausible` if trajectories are fitted with it.

    Class attributes:
        COEFFICIENTS: Its attributes that are theta, arrays of one shape, one after another.
        SITES: Where coefficients belong, for :meth:`unknowns`: joints, motors, or both.
        BY_MOTION: Its regressor is the same wherever the joints make their motion, so that one
            computed before serves a fit with other encoder offsets.
        DIVIDED_WITH: Effects with which a fit divides one torque, at one place, by a choice: no
            part alone is a property of the arm, their sum is.
    """

    COEFFICIENTS: ClassVar[tuple[str, ...]] = ()
    SITES: ClassVar[tuple[Kind, ...]] = (Kind.JOINT,)
    BY_MOTION: ClassVar[bool] = False
    DIVIDED_WITH: ClassVar[tuple[type[Term], ...]] = ()

    @property
    def theta(self) -> Array:
        """(k,) coefficients, in the order of the regressor's columns."""
        return np.concatenate([getattr(self, name).ravel() for name in self.COEFFICIENTS])

    def with_theta(self, theta: Array) -> Self:
        """Return the same term with other (k,) coefficients."""
        names = self.COEFFICIENTS
        shape = np.shape(getattr(self, names[0]))
        arrays = np.reshape(np.asarray(theta, dtype=float), (len(names), -1, *shape[1:]))
        return replace(cast(Any, self), **dict(zip(names, arrays, strict=True)))

    @abstractmethod
    def regressor(self, state: State) -> Array:
        """Return (N, n, k) for (N, n) states: joint torques per unit of each coefficient."""

    def memory(self, state: State, before: Array | None = None) -> Array:
        """Return (N, m) internal states along a motion; by default m is 0.

        Args:
            state: (N, n) arrays, a motion or its continuation.
            before: (m,) at the first sample, where the motion is continued.
        """
        return np.zeros((len(state.q), 0))

    def columns(self, state: State, memory: Array) -> Array:
        """Return the regressor at some samples of a motion, given the (N, m) :meth:`memory`."""
        return self.regressor(state)

    def reduced(self) -> LinearTerm:
        """Return the term without coefficients that are zero, if it can omit them."""
        return self

    # Identified.
    @classmethod
    def plausible(cls, arm: Arm, valid: Range) -> LinearTerm | None:
        """Return a term whose coefficients are the prior standard deviations of a fit.

        ``None``: trajectories are not fitted with it.

        Args:
            arm: The arm.
            valid: Range of positions in the data.
        """
        return None

    @classmethod
    def unknowns(cls, arm: Arm, valid: Range) -> Unknowns | None:
        """Return what a fit solves for; ``None``: trajectories are not fitted with it.

        By default :meth:`plausible`'s coefficients, one column each; of a friction they must not
        be negative. They are ordered by ``SITES`` and joint, or just numbered.
        """
        prior = cls.plausible(arm, valid)
        if prior is None:
            return None
        scale, unit = np.abs(prior.theta), cls.schema(arm)[0].unit
        group = len(cls.SITES) * arm.n
        if len(scale) % group:
            columns = tuple(
                Column(cls.NAME, THE_ARM, index, size, cls.FRICTION, unit)
                for index, size in enumerate(scale.tolist())
            )
        else:
            rows = scale.reshape(-1, len(cls.SITES), arm.n)
            columns = tuple(
                column
                for index, row in enumerate(rows)
                for kind, sizes in zip(cls.SITES, row, strict=True)
                for column in site_columns(cls.NAME, kind, sizes, index, cls.FRICTION, unit)
            )
        return Unknowns(prior.with_theta(np.zeros(len(scale))), columns)

    @classmethod
    def in_file(cls, form: str, column: Column) -> bool:
        """Return whether files of a format have a place for a column; see ``IN_FILES``."""
        return form in cls.IN_FILES

    @classmethod
    def moves(cls, table: ColumnTable, inside: set[int]) -> Iterator[SearchMove]:
        """Yield the steps of a search from a model with the columns ``inside``.

        By default each column is added or removed.
        """
        for index in table.select(cls.NAME):
            column = table.columns[index]
            if column.joint < 0:
                text = cls.coefficient_name(table.arm, column)
            else:
                text = f"{cls.NAME} {column.site.words(table.arm)}"
                text += f", {column.index}" * (column.index > 0)
            if index in inside:
                yield SearchMove((), (index,), f"without {text}")
            else:
                yield SearchMove((index,), (), text)

    @classmethod
    def coefficient_name(cls, arm: Arm, column: Column) -> str:
        """Return the name of a column's coefficient in a report."""
        if column.joint < 0:
            return f"{cls.NAME}[{column.index}]"
        return f"{cls.NAME}.{column.site.kind.value}[{arm.joint_names[column.joint]}]"

    @classmethod
    def minimal_columns(cls, table: ColumnTable) -> list[int]:
        """Return the columns of the simplest reasonable model, where a search begins."""
        return []

    @classmethod
    def joint_start(cls, table: ColumnTable) -> list[int]:
        """Return the columns that help only together, with which a second search begins."""
        return []


@dataclass(frozen=True, eq=False)
class Unknowns:
    """A term whose coefficients are fitted, as p columns of the fit.

    Attributes:
        term: The term, its coefficients zero.
        columns: One for each of the p coefficients of the fit.
        basis: (k, p) from the fit's coefficients to the term's theta; ``None``: they are theta.
    """

    term: LinearTerm
    columns: tuple[Column, ...]
    basis: Array | None = None

    def at(self, sites: Collection[Site]) -> Unknowns:
        """Return the unknowns at some sites; coefficients elsewhere stay zero."""
        kept = [i for i, column in enumerate(self.columns) if column.site in sites]
        basis = np.eye(len(self.columns)) if self.basis is None else self.basis
        return Unknowns(self.term, tuple(self.columns[i] for i in kept), basis[:, kept])

    def memory(self, state: State, before: Array | None = None) -> Array:
        """Return (N, m) internal states along a motion; see :meth:`LinearTerm.memory`."""
        return self.term.memory(state, before)

    def regressor(self, state: State, memory: Array) -> Array:
        """Return (N, n, p) torques of all columns at (N, n) states with (N, m) memory.

        Raises:
            EffectError: The term's columns are not one per coefficient, or not finite.
        """
        columns = self.term.columns(state, memory)
        count = len(self.columns) if self.basis is None else len(self.basis)
        if np.shape(columns) != (*state.q.shape, count):
            raise EffectError(
                self.term.NAME,
                f"`regressor` returns shape {np.shape(columns)}, expected "
                f"{(*state.q.shape, count)}: `plausible` has {count} coefficients",
            )
        if not np.isfinite(np.sum(columns)):
            raise EffectError(self.term.NAME, "`regressor` returns what is not finite")
        return columns if self.basis is None else columns @ self.basis

    def found(self, coefficients: Array) -> LinearTerm | None:
        """Return the term with (p,) coefficients of the fit, ``None`` if all are zero."""
        if not coefficients.any():
            return None
        theta = coefficients if self.basis is None else self.basis @ coefficients
        return self.term.with_theta(theta).reduced()
