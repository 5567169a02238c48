"""Coulomb friction, at the joints and at the motors, possibly different by direction."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dvrk_gravity.arm import N_JOINTS, Arm
from dvrk_gravity.effects.plant_part import PlantPart
from dvrk_gravity.effects.term import (
    Array,
    LinearTerm,
    State,
    as_array,
    as_value,
    diagonal_columns,
    joint_array,
    motor_columns,
)
from dvrk_gravity.parameter import Value

# A slope that makes the ramp a sign function, while 0 stays 0.
_SIGN = np.full(N_JOINTS, 1e9)
_LEVELS = ("joint_positive", "joint_negative", "motor_positive", "motor_negative")


@dataclass(frozen=True, eq=False)
class CoulombFriction(LinearTerm):
    """Constant torque along the motion of a joint or of a motor.

    Friction at a motor acts on every joint that the motor moves: the elbow's
    lives at q2 + q3. Below the transition velocity it rises linearly, so that a
    command does not jump when the motion reverses.

    Attributes:
        arm: The arm, for its transmission.
        joint_positive: (7,) N·m while the joint moves up.
        joint_negative: (7,) N·m while the joint moves down (also counted positive).
        motor_positive: (7,) N·m at the motor while it turns up.
        motor_negative: (7,) N·m at the motor while it turns down.
        transition_velocity: (7,) rad/s; 0 makes it a sign function.
    """

    NAME = "coulomb_friction"
    PARAMETERS = (
        joint_array("coulomb_friction.joint_positive", "N·m", "at the joint, moving up", 0.0),
        joint_array("coulomb_friction.joint_negative", "N·m", "at the joint, moving down", 0.0),
        joint_array("coulomb_friction.motor_positive", "N·m", "at the motor, turning up", 0.0),
        joint_array("coulomb_friction.motor_negative", "N·m", "at the motor, turning down", 0.0),
        joint_array(
            "coulomb_friction.transition_velocity", "rad/s", "friction full from there", 0.0
        ),
    )
    FRICTION = True

    arm: Arm
    joint_positive: Array
    joint_negative: Array
    motor_positive: Array
    motor_negative: Array
    transition_velocity: Array

    @classmethod
    def from_parameters(cls, arm: Arm, values: Mapping[str, Value]) -> CoulombFriction | None:
        """See :meth:`Term.from_parameters`; a direction that is not given equals the other."""
        levels = {}
        for place in ("joint", "motor"):
            up = values.get(f"{cls.NAME}.{place}_positive") or ()
            down = values.get(f"{cls.NAME}.{place}_negative") or ()
            levels[f"{place}_positive"] = as_array(up or down, 0.0)
            levels[f"{place}_negative"] = as_array(down or up, 0.0)
        if not any(level.any() for level in levels.values()):
            return None
        transition = as_array(values.get(f"{cls.NAME}.transition_velocity"), 0.02)
        return cls(arm, **levels, transition_velocity=transition)

    def parameters(self) -> dict[str, Value]:
        """See :meth:`Term.parameters`."""
        values: dict[str, Value] = {}
        for place in ("joint", "motor"):
            # Both or none: one alone would stand for both.
            levels = {name: getattr(self, name) for name in _LEVELS if name.startswith(place)}
            if any(level.any() for level in levels.values()):
                values |= {f"{self.NAME}.{name}": as_value(v) for name, v in levels.items()}
        return values | {f"{self.NAME}.transition_velocity": as_value(self.transition_velocity)}

    def torque(self, state: State) -> Array:
        """Return (…, 7) friction torques, N·m; zero where no motion is known."""
        if state.direction is not None:  # no speed: friction is full
            motion, slope = state.direction, _SIGN
        elif state.qd is not None:
            motion, slope = state.qd, self._slope
        else:
            return np.zeros(state.q.shape)
        torque = _level(motion, slope, self.joint_positive, self.joint_negative)
        if self._at_motors:
            motor = self.arm.actuator_position(motion)
            torque += self.arm.joint_effort(
                _level(motor, slope, self.motor_positive, self.motor_negative)
            )
        return torque

    def scaled(self, part: Array) -> CoulombFriction:
        """See :meth:`Term.scaled`."""
        return replace(self, **{name: part * getattr(self, name) for name in _LEVELS})

    def plant(self) -> PlantPart:
        """See :meth:`Term.plant`: its levels; the transition is a compensator's caution."""
        up = np.concatenate([self.joint_positive, self.motor_positive])
        down = np.concatenate([self.joint_negative, self.motor_negative])
        return PlantPart(dry=np.array([up, down]))

    @property
    def theta(self) -> Array:
        """See :meth:`LinearTerm.theta`: joint up, joint down, motor up, motor down."""
        return np.concatenate([getattr(self, name) for name in _LEVELS])

    def with_theta(self, theta: Array) -> CoulombFriction:
        """See :meth:`LinearTerm.with_theta`."""
        up, down, motor_up, motor_down = np.reshape(theta, (4, N_JOINTS))
        return CoulombFriction(self.arm, up, down, motor_up, motor_down, self.transition_velocity)

    def regressor(self, state: State) -> Array:
        """See :meth:`LinearTerm.regressor`."""
        if state.direction is not None:
            motion, slope = state.direction, _SIGN
        elif state.qd is not None:
            motion, slope = state.qd, self._slope
        else:
            return np.zeros((*state.q.shape, 4 * N_JOINTS))
        joint = np.clip(motion * slope, -1.0, 1.0)
        motor = np.clip(self.arm.actuator_position(motion) * slope, -1.0, 1.0)
        columns = [
            diagonal_columns(np.maximum(joint, 0.0)),
            diagonal_columns(np.minimum(joint, 0.0)),
            motor_columns(self.arm, np.maximum(motor, 0.0)),
            motor_columns(self.arm, np.minimum(motor, 0.0)),
        ]
        return np.concatenate(columns, axis=-1)

    @cached_property
    def _at_motors(self) -> bool:
        return bool(self.motor_positive.any() or self.motor_negative.any())

    @cached_property
    def _slope(self) -> Array:
        return 1.0 / np.maximum(self.transition_velocity, 1.0 / _SIGN)


def _level(motion: Array, slope: Array, positive: Array, negative: Array) -> Array:
    blend = np.clip(motion * slope, -1.0, 1.0)
    return np.where(blend > 0, positive, negative) * blend
