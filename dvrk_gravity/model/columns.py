"""The linear form of a torque model: the columns of its regressor, their priors, the way back.

They are those of the rigid body, of every effect that declares what a fit solves for in it
(:meth:`~dvrk_gravity.effects.LinearTerm.unknowns`), and of encoder offsets and the base's tilt.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property, partial
from typing import ClassVar

import numpy as np

from dvrk_gravity import effects
from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.effects import (
    Column,
    LinearTerm,
    Range,
    RigidColumns,
    SearchMove,
    Site,
    State,
    Term,
    Unknowns,
    link_columns,
)
from dvrk_gravity.model.kinematics import KinematicCalibration, kinematic_columns


def fitted_effects(arm: Arm) -> tuple[str, ...]:
    """Return the names of the effects that trajectories of an arm are fitted with."""
    found = (unknowns.term.NAME for unknowns in _unknowns(arm, Range(*arm.range)))
    displaced = (column.effect for column in kinematic_columns(arm))
    return tuple(sorted({*RigidColumns.EFFECTS, *displaced, *found}))


class Columns:
    """All columns of one arm over one range of positions.

    Class attributes:
        ABSENT: Numbers of link parameters that are taken to be zero.

    Attributes:
        arm: The arm.
        kinematics: Where its joints and base are.
        mounted: The arm with its base as the calibration has it.
        valid: Range of positions in the data.
        rigid: The rigid body's columns, which come first.
        unknowns: What is fitted of each effect; their columns come next.
        carried: Terms of a model whose torque some effects depend on; none before it is fitted.
        columns: All columns, in order.
    """

    ABSENT: ClassVar[tuple[int, ...]] = ()

    def __init__(
        self, arm: Arm, lower: Array, upper: Array, kinematics: KinematicCalibration | None = None
    ) -> None:
        """Lay the columns out for data between (n,) ``lower`` and ``upper`` measured positions."""
        self.arm = arm
        self.kinematics = KinematicCalibration() if kinematics is None else kinematics
        self.mounted = self.kinematics.mount(arm)
        self.valid = Range(lower - self.kinematics.offset, upper - self.kinematics.offset)
        self.rigid = RigidColumns(self.mounted, self.ABSENT)
        self.unknowns = tuple(_unknowns(arm, self.valid))
        self.carried: tuple[Term, ...] = ()
        self._selected: dict[tuple[str, Site | None, int | None], list[int]] = {}
        own = (column for unknowns in self.unknowns for column in unknowns.columns)
        self.columns = (*self.rigid.columns, *own, *self.kinematics.columns(arm))

    @property
    def base(self) -> Array:
        """(10 bodies, b) from base combinations of unit prior size to the links' parameters."""
        return self.rigid.base

    @property
    def candidate_terms(self) -> tuple[LinearTerm, ...]:
        """The effects' terms that are fitted, their coefficients zero."""
        return tuple(unknowns.term for unknowns in self.unknowns)

    @cached_property
    def scale(self) -> Array:
        """(p,) prior standard deviations."""
        return np.array([column.scale for column in self.columns])

    @cached_property
    def positive(self) -> Mask:
        """(p,) columns whose coefficients must not be negative."""
        return np.array([column.positive for column in self.columns])

    def offers(self, column: Column) -> bool:
        """Whether a fit may use a column; the noise is estimated with all of them."""
        return bool(self.carried) or column.effect not in self._of_others

    @cached_property
    def _of_others(self) -> set[str]:
        return {term.NAME for term in self.candidate_terms if term.OF_OTHERS}

    @property
    def load_dependent(self) -> list[int]:
        """Numbers of the columns that depend on the torque of a model's other terms."""
        return [i for i, column in enumerate(self.columns) if column.effect in self._of_others]

    def with_terms(self, terms: Sequence[Term]) -> Columns:
        """Return the columns of the same data beside a model's terms."""
        result = copy(self)
        result.carried = tuple(terms)
        result.unknowns = tuple(
            replace(each, term=term) if isinstance(term, LinearTerm) else each
            for each in self.unknowns
            for term in [each.term.with_terms(terms)]
        )
        return result

    def select(self, effect: str, site: Site | None = None, index: int | None = None) -> list[int]:
        """Return the indices of an effect's columns, at one site or of one number if given."""
        key = effect, site, index
        if key not in self._selected:  # searches ask the same thousands of times
            self._selected[key] = [
                number
                for number, column in enumerate(self.columns)
                if column.effect == effect
                and site in (None, column.site)
                and index in (None, column.index)
            ]
        return list(self._selected[key])

    def same(self, chosen: Sequence[int], others: Columns) -> list[int]:
        """Return the chosen columns' indices among other columns; all of the rigid body's."""
        keys = {self.columns[i].key for i in chosen}
        known = [i for i, column in enumerate(others.columns) if column.key in keys]
        return sorted({*link_columns(others), *known})

    def effect(self, index: int) -> type[LinearTerm]:
        """Return the effect of a column that is one of a term's coefficients."""
        name = self.columns[index].effect
        return next(type(term) for term in self.candidate_terms if name == term.NAME)

    def basis(self, effect: str) -> Array:
        """Return (k, p) from the coefficients of an effect's columns to its term's theta."""
        (unknowns,) = (unknowns for unknowns in self.unknowns if effect == unknowns.term.NAME)
        return np.eye(len(unknowns.columns)) if unknowns.basis is None else unknowns.basis

    def history(
        self, state: State, before: Array | None = None, chosen: Sequence[int] | None = None
    ) -> Array:
        """Return (N, m) the effects' memory along a motion.

        Args:
            state: (N, n) arrays, a whole motion or its continuation.
            before: (m,) at its first sample, if it continues one.
            chosen: Numbers of the columns that are asked for: the memory of other effects is left
                at zero; ``None``: all.
        """
        parts, start = [], len(self.rigid.columns)
        known = [None] * len(self.unknowns) if before is None else self._split(before)
        for unknowns, part, size in zip(self.unknowns, known, self._memories, strict=True):
            own = range(start, start + len(unknowns.columns))
            start = own.stop
            if chosen is None or any(index in own for index in chosen):
                parts.append(unknowns.memory(state, part))
            else:
                parts.append(np.zeros((len(state.q), size)))
        return np.concatenate(parts, axis=-1)

    def regressor(
        self, state: State, history: Array, stride: int = 1, chosen: Sequence[int] | None = None
    ) -> Array:
        """Return (N, n, k) torques *at the motors* of columns.

        Args:
            state: (N, n) arrays, part of a motion.
            history: (N, m), the same part of :meth:`history`.
            stride: Samples over which the motion is smooth: the calibration's slopes, expensive
                and as smooth, are evaluated so far apart, with cubic splines between.
            chosen: (k,) numbers of the columns, ascending; ``None``: all.
        """
        true = self.kinematics.true(state)
        sources: list[tuple[int, Callable[[], Array]]] = [
            (len(self.rigid.columns), lambda: self.rigid.regressor(true)),
            *(
                (len(unknowns.columns), partial(unknowns.regressor, true, memory))
                for unknowns, memory in zip(self.unknowns, self._split(history), strict=True)
            ),
            (
                len(self.kinematics.columns(self.arm)),
                lambda: self.kinematics.smooth_slopes(self.arm, state, stride),
            ),
        ]
        ends = np.cumsum([count for count, _ in sources])
        wanted = np.arange(ends[-1]) if chosen is None else np.asarray(chosen)
        parts = []
        for (count, source), end in zip(sources, ends.tolist(), strict=True):
            own = wanted[(wanted >= end - count) & (wanted < end)] - (end - count)
            if len(own):
                parts.append(source() if len(own) == count else source()[..., own])
        torque = np.concatenate(parts, axis=-1)
        shares = self.arm.actuator_to_joint.T
        # Most motors turn one joint alone: a product for each sample takes six times as long.
        mixed = np.flatnonzero((shares != np.eye(len(shares))).any(axis=1)).tolist()
        at_motors = [
            sum(shares[motor, joint] * torque[:, joint] for joint in np.flatnonzero(shares[motor]))
            for motor in mixed
        ]
        for motor, values in zip(mixed, at_motors, strict=True):
            torque[:, motor] = values
        return torque

    def at_rest(self, q: Array) -> Array:
        """Return (N, n, p) torques at the motors at (N, n) positions, without memory."""
        rest = np.zeros((len(q), sum(self._memories)))
        return self.regressor(State(q, np.zeros_like(q), np.zeros_like(q)), rest)

    @property
    def _memories(self) -> tuple[int, ...]:
        """Size of each effect's memory: :meth:`beside` changes it."""
        still = State(np.zeros((1, self.arm.n)))
        return tuple(unknowns.memory(still).shape[1] for unknowns in self.unknowns)

    def _split(self, memory: Array) -> list[Array]:
        """Return each effect's part of (…, m) memory."""
        return np.split(memory, np.cumsum(self._memories)[:-1], axis=-1)

    @cached_property
    def kinematic(self) -> list[int]:
        """Numbers of the columns of encoder offsets and the base's tilt, which come last."""
        count = len(self.columns)
        return list(range(count - len(self.kinematics.columns(self.arm)), count))

    @property
    def by_motion(self) -> list[int]:
        """Numbers of the columns that other kinematics do not change."""
        same = {term.NAME for term in self.candidate_terms if term.BY_MOTION}
        return [i for i, column in enumerate(self.columns) if column.effect in same]

    def at(self, kinematics: KinematicCalibration) -> Columns:
        """Return the columns of the same data at other kinematics."""
        shift = self.kinematics.offset
        lower, upper = self.valid.lower + shift, self.valid.upper + shift
        return type(self)(self.arm, lower, upper, kinematics).with_terms(self.carried)

    def corrected_kinematics(self, theta: Array) -> KinematicCalibration:
        """Return the kinematics that (p,) coefficients correct to, with links for its slopes."""
        links, springs = self.rigid.bodies(theta[: len(self.rigid.columns)])
        change = theta[self.kinematic]
        return self.kinematics.updated(self.arm, change, links, springs)

    def terms(self, theta: Array, links: Array | None = None) -> tuple[Term, ...]:
        """Return the model's terms for (p,) coefficients; those that are zero are left out.

        Args:
            theta: The coefficients.
            links: (10 bodies,) link parameters to use instead of the base combinations'.
        """
        start = len(self.rigid.columns)
        built = self.rigid.terms(self.arm, theta[:start], links)
        for unknowns in self.unknowns:
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


def term_moves(columns: Columns, inside: set[int]) -> Iterator[SearchMove]:
    """Yield every change of the model that a search tries, once each."""
    for term in columns.candidate_terms:
        yield from term.moves(columns, inside)


def search_starts(columns: Columns, effects: Sequence[str] | None = None) -> list[list[int]]:
    """Return where searches start: the plainest model, and one with what helps together only.

    Args:
        columns: The columns.
        effects: Effects that may be used besides the rigid body; ``None``: all.
    """
    plain = start_columns(columns)
    rich = sorted(
        {*plain, *(i for term in columns.candidate_terms for i in term.joint_start(columns))}
    )
    wanted = None if effects is None else {*RigidColumns.EFFECTS, *effects}
    permitted = {
        i
        for i, column in enumerate(columns.columns)
        if columns.offers(column) and (wanted is None or column.effect in wanted)
    }
    found = [[i for i in chosen if i in permitted] for chosen in (plain, rich)]
    return found if found[0] != found[1] else found[:1]


def start_columns(columns: Columns) -> list[int]:
    """Return the columns of the plainest model that can hold: the rigid body, and little more."""
    chosen = set(range(len(columns.rigid.columns)))
    chosen |= {i for term in columns.candidate_terms for i in term.minimal_columns(columns)}
    return sorted(chosen)
