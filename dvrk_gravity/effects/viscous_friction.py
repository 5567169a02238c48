"""Viscous friction, at the joints and at the motors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dvrk_gravity.arm import N_JOINTS, Arm
from dvrk_gravity.effects.plant_part import PlantPart
from dvrk_gravity.effects.term import (
    Array,
    Friction,
    State,
    as_array,
    as_value,
    diagonal_columns,
    joint_array,
    motor_columns,
)
from dvrk_gravity.parameter import Value


@dataclass(frozen=True, eq=False)
class ViscousFriction(Friction):
    """Torque proportional to the velocity of a joint or of a motor.

    Attributes:
        arm: The arm, for its transmission.
        joint: (7,) N·m·s/rad at the joints.
        motor: (7,) N·m·s/rad at the motors.
    """

    NAME = "viscous_friction"
    PARAMETERS = (
        joint_array("viscous_friction.joint", "N·m·s/rad", "viscous friction at the joint", 0.0),
        joint_array("viscous_friction.motor", "N·m·s/rad", "viscous friction at the motor", 0.0),
    )

    @classmethod
    def from_parameters(cls, arm: Arm, values: Mapping[str, Value]) -> ViscousFriction | None:
        """See :meth:`Term.from_parameters`."""
        joint = as_array(values.get(f"{cls.NAME}.joint"), 0.0)
        motor = as_array(values.get(f"{cls.NAME}.motor"), 0.0)
        return cls(arm, joint, motor) if joint.any() or motor.any() else None

    def parameters(self) -> dict[str, Value]:
        """See :meth:`Term.parameters`."""
        levels = {"joint": self.joint, "motor": self.motor}
        return {f"{self.NAME}.{name}": as_value(v) for name, v in levels.items() if v.any()}

    def torque(self, state: State) -> Array:
        """Return (…, 7) friction torques, N·m; zero where the velocity is unknown."""
        if state.qd is None:
            return np.zeros(state.q.shape)
        return state.qd @ self._damping

    def regressor(self, state: State) -> Array:
        """See :meth:`LinearTerm.regressor`."""
        if state.qd is None:
            return np.zeros((*state.q.shape, 2 * N_JOINTS))
        motor = motor_columns(self.arm, self.arm.actuator_position(state.qd))
        return np.concatenate([diagonal_columns(state.qd), motor], axis=-1)

    def plant(self) -> PlantPart:
        """See :meth:`Term.plant`."""
        return PlantPart(damping=self._damping)

    @cached_property
    def _damping(self) -> Array:
        """(7, 7) symmetric damping matrix in joint space."""
        to_motor = self.arm.joint_to_actuator
        return np.diag(self.joint) + to_motor.T @ np.diag(self.motor) @ to_motor
