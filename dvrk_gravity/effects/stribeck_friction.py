"""Friction at rest and at low speed that falls as the speed grows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dvrk_gravity.arm import JOINT_NAMES, N_JOINTS, Arm
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
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.parameter import Value

_PLACES = ("joint", "motor")
_SLOWEST = 1e-4  # rad/s, of a velocity that a level can have


@dataclass(frozen=True, eq=False)
class StribeckFriction(Friction):
    """tau = level exp(-(v / velocity)^2) sign(v), beside Coulomb friction.

    The Gaussian form of the Stribeck effect (Armstrong-Hélouvry, Dupont and Canudas de Wit 1994,
    Automatica 30:7, equation 6 with an exponent of two). Like Coulomb friction it rises linearly
    up to the transition velocity; a pose that was approached and held has the whole of it.

    Attributes:
        arm: The arm, for its transmission.
        joint: (7,) levels at rest at the joints, N·m.
        motor: (7,) levels at rest at the motors, N·m.
        joint_velocity: (7,) speeds of the joints at which 1/e is left, rad/s.
        motor_velocity: (7,) speeds of the motors at which 1/e is left, rad/s.
        transition_velocity: (7,) rad/s; 0 makes it jump with the sign.
    """

    NAME = "stribeck_friction"
    PARAMETERS = (
        joint_array("stribeck_friction.joint", "N·m", "level at rest, at the joint", 0.0),
        joint_array("stribeck_friction.motor", "N·m", "level at rest, at the motor", 0.0),
        joint_array(
            "stribeck_friction.joint_velocity", "rad/s", "the joint's speed that leaves 1/e", 0.0
        ),
        joint_array(
            "stribeck_friction.motor_velocity", "rad/s", "the motor's speed that leaves 1/e", 0.0
        ),
        joint_array(
            "stribeck_friction.transition_velocity", "rad/s", "sign complete from there", 0.0
        ),
    )
    joint_velocity: Array
    motor_velocity: Array
    transition_velocity: Array

    @classmethod
    def from_parameters(cls, arm: Arm, values: Mapping[str, Value]) -> StribeckFriction | None:
        """See :meth:`Term.from_parameters`; where there is a level, there must be a velocity."""
        levels = {place: as_array(values.get(f"{cls.NAME}.{place}"), 0.0) for place in _PLACES}
        if not any(level.any() for level in levels.values()):
            return None
        speeds = {}
        for place, level in levels.items():
            name = f"{cls.NAME}.{place}_velocity"
            speeds[f"{place}_velocity"] = speed = as_array(values.get(name), 0.0)
            for index in np.flatnonzero((level > 0.0) & (speed < _SLOWEST)).tolist():
                raise ConfigError(
                    f"{name} of {JOINT_NAMES[index]}",
                    float(speed[index]),
                    f"at least {_SLOWEST:g} rad/s beside a level of {level[index]:g} N·m",
                )
        transition = as_array(values.get(f"{cls.NAME}.transition_velocity"), 0.02)
        return cls(arm, **levels, **speeds, transition_velocity=transition)

    def parameters(self) -> dict[str, Value]:
        """See :meth:`Term.parameters`."""
        used = [place for place in _PLACES if getattr(self, place).any()]
        names = [name for place in used for name in (place, f"{place}_velocity")]
        names.append("transition_velocity")
        return {f"{self.NAME}.{name}": as_value(getattr(self, name)) for name in names}

    def torque(self, state: State) -> Array:
        """Return (…, 7) friction torques, N·m; zero where no motion is known."""
        parts = self._parts(state)
        if parts is None:
            return np.zeros(state.q.shape)
        joint, motor = parts
        return self.joint * joint + self.arm.joint_effort(self.motor * motor)

    def regressor(self, state: State) -> Array:
        """See :meth:`LinearTerm.regressor`."""
        parts = self._parts(state)
        if parts is None:
            return np.zeros((*state.q.shape, 2 * N_JOINTS))
        joint, motor = parts
        columns = [diagonal_columns(joint), motor_columns(self.arm, motor)]
        return np.concatenate(columns, axis=-1)

    def plant(self) -> PlantPart:
        """See :meth:`Term.plant`: the levels, and what a velocity leaves of them."""
        level = np.concatenate([self.joint, self.motor])
        motion = np.vstack([np.eye(len(self.joint)), self.arm.joint_to_actuator])
        motion *= np.concatenate(self._inverse)[:, None]

        def left(qd: Array) -> Array:
            ratio = motion.dot(qd)
            return np.exp(-ratio * ratio)

        return PlantPart(dry=np.array([level, level]), fade=left)

    def _parts(self, state: State) -> tuple[Array, Array] | None:
        """Return (…, 7) torques per level at the joints and at the motors."""
        if state.direction is not None:
            return np.sign(state.direction), np.sign(self.arm.actuator_position(state.direction))
        if state.qd is None:
            return None
        motion = (state.qd, self.arm.actuator_position(state.qd))
        joint, motor = (
            np.clip(v * self._slope, -1.0, 1.0) * np.exp(-((v * inverse) ** 2))
            for v, inverse in zip(motion, self._inverse, strict=True)
        )
        return joint, motor

    @cached_property
    def _slope(self) -> Array:
        return 1.0 / np.maximum(self.transition_velocity, 1e-9)

    @cached_property
    def _inverse(self) -> tuple[Array, Array]:
        """1 / velocity at the joints and at the motors; 0 where there is none, nor a level."""
        joint, motor = (
            np.divide(1.0, speed, out=np.zeros(N_JOINTS), where=speed >= _SLOWEST)
            for speed in (self.joint_velocity, self.motor_velocity)
        )
        return joint, motor
