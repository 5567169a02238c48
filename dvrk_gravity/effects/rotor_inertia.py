"""Inertia of the motors' rotors as the motors feel it through their gears."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.arm import N_JOINTS, Arm
from dvrk_gravity.effects.plant_part import PlantPart
from dvrk_gravity.effects.term import (
    Array,
    LinearTerm,
    State,
    as_array,
    as_value,
    joint_array,
    motor_columns,
)
from dvrk_gravity.parameter import Value


@dataclass(frozen=True, eq=False)
class RotorInertia(LinearTerm):
    """Torque proportional to the acceleration of a motor, felt by every joint that it moves.

    Attributes:
        arm: The arm, for its transmission.
        motor: (7,) reflected inertia at the motors, kg·m^2.
    """

    NAME = "rotor_inertia"
    PARAMETERS = (
        joint_array("rotor_inertia.motor", "kg·m^2", "reflected inertia at the motor", 0.0),
    )
    COMPENSATED = False  # a compensator holds; it knows no acceleration

    arm: Arm
    motor: Array

    @classmethod
    def from_parameters(cls, arm: Arm, values: Mapping[str, Value]) -> RotorInertia | None:
        """See :meth:`Term.from_parameters`."""
        motor = as_array(values.get("rotor_inertia.motor"), 0.0)
        return cls(arm, motor) if motor.any() else None

    def parameters(self) -> dict[str, Value]:
        """See :meth:`Term.parameters`."""
        return {"rotor_inertia.motor": as_value(self.motor)}

    def torque(self, state: State) -> Array:
        """Return (…, 7) torques, N·m; zero where the acceleration is unknown."""
        if state.qdd is None:
            return np.zeros(state.q.shape)
        return self.arm.joint_effort(self.motor * self.arm.actuator_position(state.qdd))

    def plant(self) -> PlantPart:
        """See :meth:`Term.plant`: nothing; it predicts what the plant's own bodies do."""
        return PlantPart()

    @property
    def theta(self) -> Array:
        """See :meth:`LinearTerm.theta`."""
        return self.motor

    def with_theta(self, theta: Array) -> RotorInertia:
        """See :meth:`LinearTerm.with_theta`."""
        return replace(self, motor=np.asarray(theta, dtype=float))

    def regressor(self, state: State) -> Array:
        """See :meth:`LinearTerm.regressor`."""
        if state.qdd is None:
            return np.zeros((*state.q.shape, N_JOINTS))
        return motor_columns(self.arm, self.arm.actuator_position(state.qdd))
