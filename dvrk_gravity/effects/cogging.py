"""Ripple of a motor's torque, periodic in its angle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dvrk_gravity.arm import Arm
from dvrk_gravity.effects.term import Array, State, Term, as_value
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.parameter import Parameter, Value

_FIELDS = (
    ("amplitude", "N·m", "amplitude of each ripple"),
    ("cycles_per_revolution", "1/rev", "ripples in a turn of the motor's shaft after the gear"),
    ("phase", "rad", "phase of each ripple at zero"),
)
MOST_RIPPLES = 8  # of one motor


@dataclass(frozen=True, eq=False)
class Cogging(Term):
    """tau = amplitude cos(cycles_per_revolution x + phase), at the motors, x the motor's angle.

    Attributes:
        arm: The arm, for its transmission.
        motor: (K,) index of the motor of each ripple.
        amplitude: (K,) N·m.
        cycles: (K,) in a revolution.
        phase: (K,) rad.
    """

    NAME = "cogging"

    arm: Arm
    motor: Array
    amplitude: Array
    cycles: Array
    phase: Array

    @classmethod
    def schema(cls, arm: Arm) -> tuple[Parameter, ...]:
        """See :meth:`Term.schema`."""
        return tuple(
            Parameter(
                f"cogging.{field}.{joint}", (), unit, f"{meaning}, {joint}",
                lengths=tuple(range(1, MOST_RIPPLES + 1)),
            )
            for field, unit, meaning in _FIELDS
            for joint in arm.joint_names
        )  # fmt: skip

    @classmethod
    def from_parameters(cls, arm: Arm, values: Mapping[str, Value]) -> Cogging | None:
        """See :meth:`Term.from_parameters`; every ripple needs all three numbers."""
        motors: list[int] = []
        numbers: dict[str, list[float]] = {field: [] for field, _, _ in _FIELDS}
        for motor, joint in enumerate(arm.joint_names):
            names = [f"{cls.NAME}.{field}.{joint}" for field in numbers]
            given = [values.get(name) or () for name in names]
            count = max(len(one) for one in given if isinstance(one, tuple))
            for total, name, one in zip(numbers.values(), names, given, strict=True):
                assert isinstance(one, tuple)
                if len(one) != count:
                    expected = f"{count}: amplitude, cycles_per_revolution, phase of each ripple"
                    raise ConfigError(name, f"{len(one)} numbers", expected)
                total.extend(one)
            motors += [motor] * count
        if not motors:
            return None
        return cls(arm, np.array(motors), *(np.array(one) for one in numbers.values()))

    def parameters(self) -> dict[str, Value]:
        """See :meth:`Term.parameters`."""
        numbers = (self.amplitude, self.cycles, self.phase)
        return {
            f"{self.NAME}.{field}.{joint}": as_value(array[self.motor == motor])
            for (field, _, _), array in zip(_FIELDS, numbers, strict=True)
            for motor, joint in enumerate(self.arm.joint_names)
            if (self.motor == motor).any()
        }

    def torque(self, state: State) -> Array:
        """Return (…, n) torques, N·m."""
        ripple = self.amplitude * np.cos(state.q @ self._turns.T + self.phase)
        return ripple @ self.arm.joint_to_actuator[self.motor]

    @cached_property
    def _turns(self) -> Array:
        """(K, n) rad of each ripple's phase per rad of the joints."""
        return self.cycles[:, None] * self.arm.joint_to_actuator[self.motor]
