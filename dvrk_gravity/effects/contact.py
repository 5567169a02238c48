"""Something outside that a joint runs into: an elastic wall at a position."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arm import Arm
from dvrk_gravity.effects.term import Array, State, Term, as_array, as_value, joint_array
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.parameter import Parameter, Value


@dataclass(frozen=True, eq=False)
class Contact(Term):
    """tau = stiffness (q - position) beyond a position, zero before it.

    A wall pushes back with a positive stiffness; the compensator does not push against it.

    Attributes:
        above: (n,) N·m/rad of the wall that begins above ``above_position``.
        above_position: (n,) rad.
        below: (n,) N·m/rad of the wall that begins below ``below_position``.
        below_position: (n,) rad.
    """

    NAME = "contact"
    COMPENSATED = False

    above: Array
    above_position: Array
    below: Array
    below_position: Array

    @classmethod
    def schema(cls, arm: Arm) -> tuple[Parameter, ...]:
        """See :meth:`Term.schema`."""
        return (
            joint_array(arm, "contact.above", "N·m/rad", "stiffness of a wall above a position"),
            joint_array(arm, "contact.above_position", "rad", "where it begins"),
            joint_array(arm, "contact.below", "N·m/rad", "stiffness of a wall below a position"),
            joint_array(arm, "contact.below_position", "rad", "where it begins"),
        )

    @classmethod
    def from_parameters(cls, arm: Arm, values: Mapping[str, Value]) -> Contact | None:
        """See :meth:`Term.from_parameters`; where there is a stiffness, there must be a place."""
        n = len(arm.joints)
        arrays: list[Array] = []
        for side in ("above", "below"):
            stiffness = as_array(values.get(f"{cls.NAME}.{side}"), n, 0.0)
            place = values.get(f"{cls.NAME}.{side}_position")
            if stiffness.any() and not place:
                joint = arm.joint_names[int(np.argmax(stiffness != 0.0))]
                raise ConfigError(f"{cls.NAME}.{side}_position of {joint}", None, "a position")
            arrays += [stiffness, as_array(place, n, 0.0)]
        term = cls(*arrays)
        return term if term.above.any() or term.below.any() else None

    def parameters(self) -> dict[str, Value]:
        """See :meth:`Term.parameters`."""
        used = [side for side in ("above", "below") if getattr(self, side).any()]
        names = [name for side in used for name in (side, f"{side}_position")]
        return {f"{self.NAME}.{name}": as_value(getattr(self, name)) for name in names}

    def torque(self, state: State) -> Array:
        """Return (…, n) torques, N·m."""
        over = np.maximum(state.q - self.above_position, 0.0)
        under = np.minimum(state.q - self.below_position, 0.0)
        return self.above * over + self.below * under
