"""What every physical term is: parameters with units, and a torque at a state."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dvrk_gravity.arguments import floats
from dvrk_gravity.arm import N_JOINTS, Arm
from dvrk_gravity.effects.plant_part import PlantPart, secant_damping
from dvrk_gravity.errors import ShapeError
from dvrk_gravity.parameter import Parameter, Value

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class State:
    """Where the arm is and how it moves, in joint space.

    Attributes:
        q: (…, 7) positions, rad.
        qd: (…, 7) velocities, rad/s; ``None`` if unknown: friction is then left out.
        qdd: (…, 7) accelerations, rad/s^2; ``None`` counts as zero.
        direction: (…, 7) +1/-1, the way in which a static pose was approached;
            where given, it replaces the sign of the velocity in dry friction.

    Samples of an (N, 7) state that has velocities follow each other in time; it matters only
    to friction that remembers where the motion last reversed.
    """

    q: Array
    qd: Array | None = None
    qdd: Array | None = None
    direction: Array | None = None

    @classmethod
    def of(
        cls,
        q: ArrayLike,
        qd: ArrayLike | None = None,
        qdd: ArrayLike | None = None,
        direction: ArrayLike | None = None,
    ) -> State:
        """Check the shapes and build a state.

        Raises:
            ShapeError: ``q`` is not (…, 7), or another array's shape differs from it.
            ArgumentError: What holds no numbers.
        """
        position = floats("q", q)
        if position.ndim == 0 or position.shape[-1] != N_JOINTS:
            raise ShapeError("q", position.shape, f"(…, {N_JOINTS})")
        rest: dict[str, Array | None] = {}
        for name, given in (("qd", qd), ("qdd", qdd), ("direction", direction)):
            array = None if given is None else floats(name, given)
            if array is not None and array.shape != position.shape:
                raise ShapeError(name, array.shape, f"{position.shape}, as q")
            rest[name] = array
        return cls(position, **rest)

    def rows(self, which: slice | NDArray[np.int64]) -> State:
        """Return some of the samples of an (N, 7) state."""
        rest = (self.qd, self.qdd, self.direction)
        return State(self.q[which], *(None if one is None else one[which] for one in rest))


class Term(ABC):
    """One named physical cause of torque.

    Torques are those that the *actuators apply*, expressed in joint space: a
    static arm reads ``g(q)``, and friction counts positive along the motion.

    Class attributes:
        NAME: The effect's name in the fixed vocabulary.
        PARAMETERS: Declarations of every parameter in model files.
        FRICTION: Dissipative: the compensator scales it by its friction ratio, with
            :meth:`scaled`.
        COMPENSATED: The compensator applies it; off for what needs the past of the motion or
            lives in a sensor.
    """

    NAME: ClassVar[str]
    PARAMETERS: ClassVar[tuple[Parameter, ...]]
    FRICTION: ClassVar[bool] = False
    COMPENSATED: ClassVar[bool] = True

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
        """Return (…, 7) joint torques, N·m."""

    def scaled(self, part: Array) -> Term:
        """Return the friction of which (7,) parts are left at each joint and its motor."""
        raise NotImplementedError(f"{self.NAME} is no friction")

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
    """

    @property
    @abstractmethod
    def theta(self) -> Array:
        """(k,) coefficients, in the order of the regressor's columns."""

    @abstractmethod
    def with_theta(self, theta: Array) -> LinearTerm:
        """Return the same term with other (k,) coefficients."""

    @abstractmethod
    def regressor(self, state: State) -> Array:
        """Return (N, 7, k) for (N, 7) states: joint torques of each coefficient at one."""


@dataclass(frozen=True, eq=False)
class Friction(LinearTerm):
    """Friction with a coefficient at each joint and one at each motor.

    Attributes:
        arm: The arm, for its transmission.
        joint: (7,) coefficients at the joints.
        motor: (7,) coefficients at the motors.
    """

    FRICTION = True

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
        joint, motor = np.reshape(theta, (2, N_JOINTS))
        return replace(self, joint=joint, motor=motor)


def diagonal_columns(values: Array) -> Array:
    """Return (N, 7, 7) columns that act on one joint each, from (N, 7) values."""
    columns = np.zeros((*values.shape, values.shape[-1]))
    index = np.arange(values.shape[-1])
    columns[..., index, index] = values
    return columns


def motor_columns(arm: Arm, values: Array) -> Array:
    """Return (N, 7, 7) joint torques of (N, 7) motor torques, a column a motor."""
    return values[..., None, :] * arm.joint_to_actuator.T


def joint_array(name: str, unit: str, meaning: str, lower: float = -np.inf) -> Parameter:
    """Declare an optional array with a number a joint."""
    return Parameter(name, (), unit, meaning, lower=lower, lengths=(N_JOINTS,))


def as_array(value: Value | None, default: float) -> Array:
    """Return a parameter's (7,) array, filled with ``default`` where it is not given."""
    return np.array(value, dtype=float) if value else np.full(N_JOINTS, default)


def as_value(array: Array) -> tuple[float, ...]:
    """Return an array as a parameter's value."""
    return tuple(array.tolist())
