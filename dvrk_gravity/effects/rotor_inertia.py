"""Inertia of the motors' rotors as the motors feel it through their gears."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.arrays import (
    Values,
    added,
    as_array,
    as_value,
    joint_array,
    motor_columns,
)
from dvrk_gravity.effects.base.column import ColumnTable, SearchMove, site_columns
from dvrk_gravity.effects.base.effect import Hypothesis, spread
from dvrk_gravity.effects.base.joint_dynamics import JointDynamics
from dvrk_gravity.effects.base.linear_term import LinearTerm, Unknowns
from dvrk_gravity.effects.base.links import separable_rotors
from dvrk_gravity.effects.base.meaning import MORE, meanings, size
from dvrk_gravity.effects.base.motion import Motion, State
from dvrk_gravity.effects.base.polynomials import Range
from dvrk_gravity.effects.base.site import Kind, Site, unit_travel
from dvrk_gravity.effects.base.term import PlantPart
from dvrk_gravity.parameters import Parameter, Value

_PART = 0.05  # of a motor's largest torque that a rad/s^2 may plausibly take


@dataclass(frozen=True, eq=False)
class RotorInertia(LinearTerm):
    """Torque proportional to the acceleration of a motor, felt by every joint that it moves.

    Attributes:
        arm: The arm, for its transmission.
        motor: (n,) reflected inertia at the motors, kg·m^2.
    """

    NAME = "rotor_inertia"
    IN_FILES = ("console", "mjcf")
    BY_MOTION = True
    REMEDY = "check {joint}'s motor and gear ratio"
    MEANINGS = meanings(inertia=size("kg·m^2", MORE))
    EVERYWHERE = True
    COEFFICIENTS = ("motor",)
    COMPENSATED = False  # a compensator holds; it knows no acceleration

    arm: Arm
    motor: Array

    @classmethod
    def schema(cls, arm: Arm) -> tuple[Parameter, ...]:
        return (
            joint_array(
                arm, "rotor_inertia.motor", "kg·m^2", "reflected inertia at the motor", 0.0
            ),
        )

    @classmethod
    def from_parameters(cls, arm: Arm, values: Mapping[str, Value]) -> RotorInertia | None:
        motor = as_array(values.get("rotor_inertia.motor"), arm.n, 0.0)
        return cls(arm, motor) if motor.any() else None

    def parameters(self) -> dict[str, Value]:
        return {"rotor_inertia.motor": as_value(self.motor)}

    def torque(self, state: State) -> Array:
        """Return (…, n) torques, N·m; zero where the acceleration is unknown."""
        if state.qdd is None:
            return np.zeros(state.q.shape)
        return self.arm.joint_effort(self.motor * self.arm.actuator_position(state.qdd))

    def momentum(self, q: Array, qd: Array) -> tuple[Array, Array]:
        turning = self.motor * self.arm.actuator_position(qd)
        return self.arm.joint_effort(turning), np.zeros(q.shape)

    def joint_dynamics(self, arm: Arm, q: Array) -> JointDynamics:
        return JointDynamics(arm, inertia=np.array([np.zeros(arm.n), self.motor]))

    def plant(self) -> PlantPart:
        return PlantPart(rotors=self.motor)

    @classmethod
    def moves(cls, table: ColumnTable, inside: set[int]) -> Iterator[SearchMove]:
        """Add rotors, and remove none: every motor has one."""
        for joint, name in enumerate(table.arm.joint_names):
            (rotor,) = table.select(cls.NAME, Site.motor(joint))
            if rotor not in inside:
                yield SearchMove((rotor,), (), f"{cls.NAME} {name}")

    @classmethod
    def minimal_columns(cls, table: ColumnTable) -> list[int]:
        """The rotors whose torque differs from that of any link."""
        return [
            index
            for motor in separable_rotors(table.arm)
            for index in table.select(cls.NAME, Site.motor(motor))
        ]

    @classmethod
    def hypotheses(cls, motion: Motion) -> Iterator[Hypothesis]:
        if motion.static:
            return
        for motor, row in enumerate(motion.arm.joint_to_actuator):
            if motion.moves[row != 0].any():
                # An arm's own file has no rotor that there could be less of.
                yield RotorHypothesis(
                    arm=motion.arm, site=Site.motor(motor),
                    removable=0.0 if motion.model.of_file else np.inf,
                )  # fmt: skip

    @classmethod
    def unknowns(cls, arm: Arm, valid: Range) -> Unknowns:
        scale = _PART * arm.actuator_effort_limit / unit_travel(arm, Kind.MOTOR)
        columns = site_columns(cls.NAME, Kind.MOTOR, scale, 0, True, "kg·m^2")
        return Unknowns(cls(arm, np.zeros(arm.n)), tuple(columns))

    def regressor(self, state: State) -> Array:
        if state.qdd is None:
            return np.zeros((*state.q.shape, len(self.motor)))
        return motor_columns(self.arm, self.arm.actuator_position(state.qdd))


@dataclass(frozen=True, eq=False, kw_only=True)
class RotorHypothesis(Hypothesis):
    """A motor's rotor inertia is wrong."""

    EFFECT = RotorInertia
    CLAIM = "{where} has {inertia} rotor inertia than {model}"

    variable = "acceleration"

    def regressor(self, motion: Motion) -> Array:
        row = self.site.row(self.arm)
        return spread(row, motion.qdd @ row)

    def parameters(self, theta: Array) -> dict[str, float]:
        return {"inertia": float(theta[0])}

    def merge(self, values: Values, theta: Array, motion: Motion) -> Values:
        """No inertia below zero."""
        name = f"{self.effect}.motor"
        return added(self.arm, values, name, self.site.index, float(theta[0]), lower=0.0)
