"""Friction that builds up with displacement after the motion reverses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.arm import JOINT_NAMES, N_JOINTS, Arm
from dvrk_gravity.effects.plant_part import PlantPart
from dvrk_gravity.effects.term import (
    Array,
    LinearTerm,
    State,
    as_value,
    diagonal_columns,
    motor_columns,
)
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.parameter import Parameter, Value

_MOST = 8
_FAR = 1e6  # rad
_MOMENT = 0.2  # s
_BLOCK = 10_000  # samples whose steps are held at a time
_PLACES = ("joint", "motor")


def _declare(place: str) -> tuple[Parameter, ...]:
    return tuple(
        Parameter(
            f"presliding_hysteresis.{place}.{joint}",
            (),
            "N·m",
            f"friction of each element at the {place}, {joint}",
            lower=0.0,
            lengths=tuple(range(1, _MOST + 1)),
        )
        for joint in JOINT_NAMES
    )


@dataclass(frozen=True, eq=False)
class PreslidingHysteresis(LinearTerm):
    """Elements in parallel, each an elastic contact that yields (Dahl 1968; Maxwell slip).

    Element k pushes with levels[k] z_k against the motion of a joint or motor, where
    dz_k = (sign(dx) - z_k) |dx| / displacement[k]: after a reversal it takes that
    displacement, not a time, to build up. Samples of an (N, 7) state follow each other in time;
    before the first one the arm is taken to have slid as it does there. A single sample has no
    past, and a velocity then gives the level that it would end at.

    Attributes:
        arm: The arm, for its transmission.
        displacement: (K,) rad.
        joint: (K, 7) levels at the joints, N·m.
        motor: (K, 7) levels at the motors, N·m.
    """

    NAME = "presliding_hysteresis"
    PARAMETERS = (
        Parameter(
            "presliding_hysteresis.displacement", (), "rad",
            "displacement over which each element builds up",
            lower=1e-4, upper=10.0, lengths=tuple(range(1, _MOST + 1)),
        ),
        *_declare("joint"),
        *_declare("motor"),
    )  # fmt: skip
    FRICTION = True
    COMPENSATED = False

    arm: Arm
    displacement: Array
    joint: Array
    motor: Array

    @classmethod
    def from_parameters(cls, arm: Arm, values: Mapping[str, Value]) -> PreslidingHysteresis | None:
        """See :meth:`Term.from_parameters`."""
        displacement = values.get(f"{cls.NAME}.displacement") or ()
        assert isinstance(displacement, tuple)
        levels = {place: np.zeros((len(displacement), N_JOINTS)) for place in _PLACES}
        for place in _PLACES:
            for column, joint in enumerate(JOINT_NAMES):
                given = values.get(f"{cls.NAME}.{place}.{joint}") or ()
                assert isinstance(given, tuple)
                if given and len(given) != len(displacement):
                    raise ConfigError(
                        f"{cls.NAME}.{place}.{joint}",
                        f"{len(given)} numbers",
                        f"{len(displacement)}, as many as {cls.NAME}.displacement",
                    )
                if given:
                    levels[place][:, column] = given
        return cls(arm, np.array(displacement), **levels) if displacement else None

    def parameters(self) -> dict[str, Value]:
        """See :meth:`Term.parameters`."""
        values: dict[str, Value] = {f"{self.NAME}.displacement": as_value(self.displacement)}
        for place in _PLACES:
            levels = getattr(self, place)
            values |= {
                f"{self.NAME}.{place}.{joint}": as_value(levels[:, column])
                for column, joint in enumerate(JOINT_NAMES)
                if levels[:, column].any()
            }
        return values

    def torque(self, state: State) -> Array:
        """Return (…, 7) friction torques, N·m; zero where no motion is known."""
        elements = self.elements(state)
        joint = (self.joint * elements[..., 0, :]).sum(axis=-2)
        motor = (self.motor * elements[..., 1, :]).sum(axis=-2)
        return joint + self.arm.joint_effort(motor)

    def scaled(self, part: Array) -> PreslidingHysteresis:
        """See :meth:`Term.scaled`."""
        return replace(self, joint=part * self.joint, motor=part * self.motor)

    @property
    def theta(self) -> Array:
        """See :meth:`LinearTerm.theta`: for each element its joints, then its motors."""
        return np.concatenate([self.joint, self.motor], axis=1).ravel()

    def with_theta(self, theta: Array) -> PreslidingHysteresis:
        """See :meth:`LinearTerm.with_theta`."""
        levels = np.reshape(theta, (len(self.displacement), 2 * N_JOINTS))
        return replace(self, joint=levels[:, :N_JOINTS], motor=levels[:, N_JOINTS:])

    def regressor(self, state: State) -> Array:
        """See :meth:`LinearTerm.regressor`."""
        return self.columns(self.elements(state))

    def plant(self) -> PlantPart:
        """See :meth:`Term.plant`: elements with a state, relaxed at first."""
        return PlantPart(memory=Elements(self))

    def columns(self, elements: Array) -> Array:
        """Return (N, 7, 14 K) regressor from (N, K, 2, 7) states of the elements."""
        columns = []
        for k in range(len(self.displacement)):
            columns.append(diagonal_columns(elements[..., k, 0, :]))
            columns.append(motor_columns(self.arm, elements[..., k, 1, :]))
        return np.concatenate(columns, axis=-1)

    def elements(self, state: State, before: Array | None = None) -> Array:
        """Return (…, K, 2, 7) states z of the elements, -1 to 1: at the joints, at the motors.

        Args:
            state: As :meth:`torque` takes it.
            before: (K, 2, 7) states at the first of (N, 7) samples, where they are known.
        """
        motion = state.qd if state.direction is None else state.direction
        if motion is None:
            return np.zeros((*state.q.shape[:-1], len(self.displacement), 2, N_JOINTS))
        motion = np.stack([motion, self.arm.actuator_position(motion)], axis=-2)
        if state.direction is not None or state.q.ndim != 2 or len(state.q) < 2:
            # Approached from far, or as far as the velocity goes in a moment.
            travel = _FAR if state.direction is not None else _MOMENT
            reach = travel / self.displacement
            return np.clip(motion[..., None, :, :] * reach[:, None, None], -1.0, 1.0)
        position = np.stack([state.q, self.arm.actuator_position(state.q)], axis=-2)
        if before is None:
            before = np.broadcast_to(np.sign(motion[0]), (len(self.displacement), 2, N_JOINTS))
        return _build_up(position, before, self.displacement)


class Elements:
    """The elements of a term on their way, dz = (sign(dx) - z) |dx| / displacement (Dahl 1968).

    Over one step an element pushes with what it has at the step's beginning plus its present
    stiffness times the way to come; the stiffness goes into the mass matrix, h^2 K, as an
    implicit spring's does, so that short displacements need no short steps. Along the way that was
    gone the states are exact.
    """

    def __init__(self, term: PreslidingHysteresis) -> None:
        """Start relaxed."""
        # Elements at the joints, then at the motors; those without a level are left out.
        levels = np.hstack([term.joint, term.motor])
        element, row = np.nonzero(levels)
        self._level = levels[element, row]
        self._displacement = term.displacement[element]
        to_motor = term.arm.joint_to_actuator
        self._rows = np.vstack([np.eye(len(to_motor)), to_motor])[row]
        self._state = np.zeros(len(self._level))

    def reset(self) -> None:
        """Relax all elements."""
        self._state[:] = 0.0

    def torque(self, qd: Array) -> tuple[Array, Array]:
        """Return the friction at (n,) velocities: (n,) N·m, and stiffness (n, n) N·m/rad."""
        slope = self._level / self._displacement
        slope = slope * (1.0 - self._state * np.sign(self._rows.dot(qd)))
        return (self._level * self._state).dot(self._rows), (self._rows.T * slope).dot(self._rows)

    def go(self, way: Array) -> None:
        """Follow the joints along (n,) rad."""
        step = self._rows.dot(way)
        goal = np.sign(step)
        self._state = goal + (self._state - goal) * np.exp(-np.abs(step) / self._displacement)


def _build_up(position: Array, first: Array, displacement: Array) -> Array:
    """Return (N, K, 2, 7) states along (N, 2, 7) positions from (K, 2, 7) ``first`` ones on."""
    out = np.empty((len(position), len(displacement), *position.shape[1:]))
    out[0] = first
    for start in range(1, len(out), _BLOCK):
        rows = slice(start, min(start + _BLOCK, len(out)))
        step = np.diff(position[rows.start - 1 : rows.stop], axis=0)[:, None]
        stay = np.exp(-np.abs(step) / displacement[:, None, None])
        # Between two samples the motion goes one way: z -> s + (z - s) exp(-|dx| / displacement).
        gain = np.sign(step) * (1.0 - stay)
        for row in range(rows.start, rows.stop):
            np.multiply(out[row - 1], stay[row - start], out=out[row])
            out[row] += gain[row - start]
    return out
