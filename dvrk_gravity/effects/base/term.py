"""What every physical term is: parameters with units, and a torque at a state."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.effect import Effect
from dvrk_gravity.effects.base.plant_part import PlantPart, secant_damping
from dvrk_gravity.effects.base.polynomial import Range
from dvrk_gravity.effects.base.site import THE_ARM, Kind
from dvrk_gravity.effects.base.state import State
from dvrk_gravity.effects.base.unknowns import Column, ColumnTable, ModelChange, site_columns
from dvrk_gravity.errors import EffectError
from dvrk_gravity.parameters import Parameter, Value

Evaluator = Callable[[Array, "Array | None"], Array]
"""Torque (n,) of one sample from positions (n,) and velocities (n,), ``None`` where unknown."""


class Term(Effect):
    """One named physical cause of torque.

    Torques are those that the *actuators apply*, expressed in joint space: a
    static arm reads ``g(q)``, and friction counts positive along the motion.

    Class attributes:
        NAME: The effect's name in the fixed vocabulary.
        FRICTION: Dissipative: the compensator scales it by its friction ratio, with
            :meth:`scaled`.
        EVERYWHERE: Every arm has it at each joint, though a file that describes one may say nothing
            of it.
        COMPENSATED: The compensator applies it; off for what needs the past of the motion or
            lives in a sensor.
        AT_POSES: Static poses determine it.
        WEIGHT_OF_ARM: It is what the arm itself weighs, without which nothing is compensated.
        NOT_FITTED: Why trajectories are not fitted with it, for who asks for that.
    """

    FRICTION: ClassVar[bool] = False
    EVERYWHERE: ClassVar[bool] = False
    COMPENSATED: ClassVar[bool] = True
    AT_POSES: ClassVar[bool] = False
    WEIGHT_OF_ARM: ClassVar[bool] = False
    NOT_FITTED: ClassVar[str] = ""

    @classmethod
    @abstractmethod
    def schema(cls, arm: Arm) -> tuple[Parameter, ...]:
        """Return the declarations of every parameter that the effect has in an arm's files."""

    @classmethod
    @abstractmethod
    def from_parameters(cls, arm: Arm, values: Mapping[str, Value]) -> Term | None:
        """Build the term from checked values, ``None`` if they do not mention it.

        Raises:
            ConfigError: Values that do not fit each other.
        """

    @abstractmethod
    def parameters(self) -> dict[str, Value]:
        """Return the values that :meth:`from_parameters` would take."""

    @abstractmethod
    def torque(self, state: State) -> Array:
        """Return (…, n) joint torques, N·m."""

    @classmethod
    def nominal(cls, arm: Arm) -> Term | None:
        """Return what an arm of which only its own file is known is simulated with, if anything."""
        del arm
        return None

    @classmethod
    def stated(cls, arm: Arm) -> Term | None:
        """Return what the arm's own file says of the effect, if anything."""
        del arm
        return None

    def scaled(self, part: Array) -> Term:
        """Return the friction of which (n,) parts are left at each joint and its motor.

        Raises:
            NotImplementedError: The effect is no friction and has none.
        """
        raise NotImplementedError(f"{self.NAME} is no friction")

    def whole(self) -> Term:
        """Return the term as physics, not as the part of it that is compensated."""
        return self

    def split(self, part: Array) -> tuple[Term | None, Term | None]:
        """Return what a compensator applies of the term: without friction, and friction.

        The first is applied as at rest: a compensator leaves inertia to the hand.

        Args:
            part: (n,) part of friction that is compensated at each joint and its motor.
        """
        return (None, self.scaled(part)) if self.FRICTION else (self, None)

    def friction_part(self, part: Array) -> Array:
        """Return (n,) the part of its friction that :meth:`split` leaves; zeros if it has none."""
        return part if self.FRICTION else np.zeros_like(part)

    @property
    def carries_arm(self) -> bool:
        """Whether it is what holds the arm itself up against gravity."""
        return False

    @property
    def gravity_vector(self) -> Array | None:
        """(3,) gravity in the base frame that it is computed with, m/s^2; ``None``: no weight."""
        return None

    @property
    def full_speed(self) -> Array | None:
        """(n,) speeds from which on a friction is whole, for smoothness' sake; ``None``: any."""
        return None

    def with_gravity(self, vector: Array) -> Term:
        """Return the term with another gravity in the base frame; what has no weight stays."""
        del vector
        return self

    def prepare(self) -> Evaluator:
        """Return an evaluator of one sample, equal to :meth:`torque` but faster.

        Of what is no friction it may be the torque at rest, which is what a compensator asks for.
        """
        return lambda q, qd: self.torque(State(q, qd))

    def prepare_parts(self, part: Array) -> Evaluator | None:
        """Return an evaluator of both parts of :meth:`split`, (2, n), if the term has both."""
        return None

    def plant(self) -> PlantPart:
        """Return how a simulator integrates the effect.

        Unless the effect says better: what dissipates, by :func:`secant_damping`, which is stable
        at any step; everything else, by its torque at the step's beginning.
        """
        if self.FRICTION:
            return PlantPart(drag=secant_damping(lambda q, qd: self.torque(State(q, qd))))
        return PlantPart(at=lambda q, qd: (self.torque(State(q, qd)), None))


class LinearTerm(Term):
    """A term that is linear in its coefficients theta: ``torque = regressor @ theta``.

    What identification solves for; everything else about the term (ranges, transition
    velocities, gravity's direction) stays as it is.

    Class attributes:
        SITES: What coefficients belong to, for :meth:`unknowns`: joints, motors, or both.
        POWERS: Its theta at a joint are coefficients of powers of that joint's position.
        DIVIDED_WITH: Effects with which a fit's columns divide one torque, at one place, by a
            choice: no part alone is a property of the arm, their sum is.
    """

    SITES: ClassVar[tuple[Kind, ...]] = (Kind.JOINT,)
    POWERS: ClassVar[bool] = False
    DIVIDED_WITH: ClassVar[tuple[type[Term], ...]] = ()

    @classmethod
    def plausible(cls, arm: Arm, valid: Range) -> LinearTerm | None:
        """Return a term of plausible size, ``None`` if trajectories are not fitted with it.

        Its coefficients are the prior standard deviations of those that are looked for; all else
        about it stays as it is.

        Args:
            arm: The arm.
            valid: Range of positions in the data.
        """
        del arm, valid
        return None

    @classmethod
    def unknowns(cls, arm: Arm, valid: Range) -> Unknowns | None:
        """Return what a fit solves for, ``None`` if trajectories are not fitted with it.

        By default it is :meth:`plausible`'s coefficients, one column each; of a friction they must
        not be negative. They come joint by joint, ``SITES`` by ``SITES``, or are just numbered.
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
    def moves(cls, table: ColumnTable, inside: set[int]) -> Iterator[ModelChange]:
        """Yield the changes of a model that a search tries; by default each column comes and goes.

        Args:
            table: All columns.
            inside: Indices of those that the model has.
        """
        for index in table.select(effect=cls.NAME):
            column = table.columns[index]
            if column.joint < 0:
                text = cls.coefficient_name(table.arm, column)
            else:
                text = f"{cls.NAME} {column.site.words(table.arm)}"
                text += f", {column.index}" * (column.index > 0)
            if index in inside:
                yield ModelChange((), (index,), f"without {text}")
            else:
                yield ModelChange((index,), (), text)

    @classmethod
    def coefficient_name(cls, arm: Arm, column: Column) -> str:
        """Return the name of a column's coefficient in a report."""
        if column.joint < 0:
            return f"{cls.NAME}[{column.index}]"
        return f"{cls.NAME}.{column.site_kind}[{arm.joint_names[column.joint]}]"

    @classmethod
    def plainest(cls, table: ColumnTable) -> list[int]:
        """Return the columns that the plainest model which can hold has: by default none."""
        del table
        return []

    @classmethod
    def together(cls, table: ColumnTable) -> list[int]:
        """Return the columns that help together only, in which a second search begins."""
        del table
        return []

    @property
    @abstractmethod
    def theta(self) -> Array:
        """(k,) coefficients, in the order of the regressor's columns."""

    @abstractmethod
    def with_theta(self, theta: Array) -> LinearTerm:
        """Return the same term with other (k,) coefficients."""

    @abstractmethod
    def regressor(self, state: State) -> Array:
        """Return (N, n, k) for (N, n) states: joint torques of each coefficient at one."""

    def memory(self, state: State, before: Array | None = None) -> Array:
        """Return (N, m) what the term remembers at each sample of a motion; by default nothing.

        Args:
            state: (N, n) arrays, a motion or its continuation.
            before: (m,) at the first sample, where the motion is continued.
        """
        del before
        return np.zeros((len(state.q), 0))

    def columns(self, state: State, memory: Array) -> Array:
        """Return the regressor at a part of a motion, with the (N, m) :meth:`memory` there."""
        del memory
        return self.regressor(state)

    def reduced(self) -> LinearTerm:
        """Return the term without coefficients that are zero, where it can do without them."""
        return self


@dataclass(frozen=True, eq=False)
class Unknowns:
    """A term whose coefficients are looked for, as columns of a fit.

    Attributes:
        term: The term, its coefficients zero.
        columns: One for each of the p coefficients of the fit.
        basis: (k, p) from the fit's coefficients to the term's theta; ``None``: they are theta.
    """

    term: LinearTerm
    columns: tuple[Column, ...]
    basis: Array | None = None

    def regressor(self, state: State, memory: Array) -> Array:
        """Return (N, n, p) torques of all columns at (N, n) states with (N, m) memory.

        Raises:
            EffectError: The term's columns are not one for each of its coefficients, or no
                numbers.
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
        """Return the term with (p,) coefficients of the fit, ``None`` if all of them are zero."""
        if not coefficients.any():
            return None
        theta = coefficients if self.basis is None else self.basis @ coefficients
        return self.term.with_theta(theta).reduced()


@dataclass(frozen=True, eq=False)
class Friction(LinearTerm):
    """Friction with a coefficient at each joint and one at each motor.

    Attributes:
        arm: The arm, for its transmission.
        joint: (n,) coefficients at the joints.
        motor: (n,) coefficients at the motors.
    """

    FRICTION = True
    SITES = (Kind.JOINT, Kind.MOTOR)

    arm: Arm
    joint: Array
    motor: Array

    def scaled(self, part: Array) -> Self:
        """See :meth:`Term.scaled`."""
        return replace(self, joint=part * self.joint, motor=part * self.motor)

    @property
    def theta(self) -> Array:
        """See :meth:`LinearTerm.theta`: at the joints, then at the motors."""
        return np.concatenate([self.joint, self.motor])

    def with_theta(self, theta: Array) -> Self:
        """See :meth:`LinearTerm.with_theta`."""
        joint, motor = np.reshape(theta, (2, -1))
        return replace(self, joint=joint, motor=motor)
