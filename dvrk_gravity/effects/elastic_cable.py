"""Elastic torque of a joint's own position: cable bundle, spring, counterbalance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.arm import N_JOINTS, Arm
from dvrk_gravity.effects import polynomial
from dvrk_gravity.effects.plant_part import PlantPart
from dvrk_gravity.effects.term import Array, LinearTerm, State, diagonal_columns
from dvrk_gravity.parameter import Value


@dataclass(frozen=True, eq=False)
class ElasticCable(LinearTerm):
    """tau_j = k0 + k1 q_j + k2 q_j^2 + …, q_j held at the edges of the fitted range.

    Attributes:
        coefficients: (degree + 1, 7), lowest power first, N·m/rad^k.
        valid: Range of positions on which they were fitted.
    """

    NAME = "elastic_cable"
    PARAMETERS = (
        *polynomial.declare_coefficients("elastic_cable", "elastic torque k0, k1, …"),
        *polynomial.declare_range("elastic_cable"),
    )

    coefficients: Array
    valid: polynomial.Range

    @classmethod
    def from_parameters(cls, arm: Arm, values: Mapping[str, Value]) -> ElasticCable | None:
        """See :meth:`Term.from_parameters`."""
        coefficients = polynomial.read_coefficients(cls.NAME, values)
        if coefficients is None:
            return None
        return cls(coefficients, polynomial.Range.from_parameters(cls.NAME, values))

    def parameters(self) -> dict[str, Value]:
        """See :meth:`Term.parameters`."""
        coefficients = polynomial.write_coefficients(self.NAME, self.coefficients)
        return coefficients | self.valid.parameters(self.NAME)

    def torque(self, state: State) -> Array:
        """Return (…, 7) elastic torques, N·m."""
        return polynomial.evaluate(self.coefficients, self.valid.hold(state.q))

    def plant(self) -> PlantPart:
        """See :meth:`Term.plant`."""
        values = polynomial.prepare(self.valid, self.coefficients)
        return PlantPart(at=lambda q, qd: (values(q), None))

    @property
    def theta(self) -> Array:
        """See :meth:`LinearTerm.theta`: all joints' k0, then all their k1, …."""
        return self.coefficients.ravel()

    def with_theta(self, theta: Array) -> ElasticCable:
        """See :meth:`LinearTerm.with_theta`."""
        return replace(self, coefficients=np.reshape(theta, (-1, N_JOINTS)))

    def regressor(self, state: State) -> Array:
        """See :meth:`LinearTerm.regressor`."""
        held = self.valid.hold(state.q)
        powers = [held**k for k in range(len(self.coefficients))]
        return np.concatenate([diagonal_columns(power) for power in powers], axis=-1)
