"""Gravity of the links, from beta: gY(q) beta."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dvrk_gravity import gravity
from dvrk_gravity.arm import GRAVITY, Arm
from dvrk_gravity.effects.plant_part import PlantPart
from dvrk_gravity.effects.term import Array, LinearTerm, State, as_value
from dvrk_gravity.parameter import Parameter, Value
from dvrk_gravity.tree import Tree, beta_tree


@dataclass(frozen=True, eq=False)
class Gravity(LinearTerm):
    """tau = gY(q) beta (seed document, equation 1), for any direction of gravity.

    Attributes:
        arm: The arm.
        beta: (10,), (12,) or (14,) base parameters, N·m at 9.81 m/s^2.
        vector: (3,) gravity in the base frame, m/s^2.
        enabled: The gravity flag; off means that this term is zero.
    """

    NAME = "gravity"
    PARAMETERS = (
        Parameter(
            "beta", (), "N·m", "gravity base parameters (g inside), 10, 12 or 14 of them",
            lower=-100.0, upper=100.0, lengths=(10, 12, 14),
        ),
        Parameter("gravity_enabled", True, "", "gravity flag: false leaves the gravity term out"),
        Parameter(
            "gravity_vector", (0.0, 0.0, -GRAVITY), "m/s^2", "gravity in the arm's base frame",
            lower=-30.0, upper=30.0, lengths=(3,),
        ),
    )  # fmt: skip

    arm: Arm
    beta: Array
    vector: Array
    enabled: bool = True

    @classmethod
    def from_parameters(cls, arm: Arm, values: Mapping[str, Value]) -> Gravity | None:
        """See :meth:`Term.from_parameters`."""
        if not values.get("beta"):
            return None
        vector = values.get("gravity_vector")
        return cls(
            arm,
            np.array(values["beta"]),
            arm.gravity if vector is None else np.array(vector),
            bool(values.get("gravity_enabled", True)),
        )

    def parameters(self) -> dict[str, Value]:
        """See :meth:`Term.parameters`."""
        return {
            "beta": as_value(self.beta),
            "gravity_enabled": self.enabled,
            "gravity_vector": as_value(self.vector),
        }

    def with_enabled(self, enabled: bool) -> Gravity:
        """Return the same term with the gravity flag set."""
        return replace(self, enabled=enabled)

    def torque(self, state: State) -> Array:
        """Return (…, 7) gravity torques: one pose by Pinocchio, many in closed form."""
        if not self.enabled:
            return np.zeros(state.q.shape)
        if state.q.ndim == 1:
            return self._tree.gravity(state.q)
        return gravity.torque(state.q, self.beta, self.vector)

    @property
    def theta(self) -> Array:
        """See :meth:`LinearTerm.theta`: beta."""
        return self.beta

    def with_theta(self, theta: Array) -> Gravity:
        """See :meth:`LinearTerm.with_theta`."""
        return replace(self, beta=np.asarray(theta, dtype=float))

    def regressor(self, state: State) -> Array:
        """See :meth:`LinearTerm.regressor`."""
        return gravity.regressor(state.q, self.vector, len(self.beta))

    def plant(self) -> PlantPart:
        """See :meth:`Term.plant`: the weight."""
        if not self.enabled:
            return PlantPart()
        return PlantPart(weight=beta_tree(self.arm, self.beta, self.vector))

    @cached_property
    def _tree(self) -> Tree:
        return beta_tree(self.arm, self.beta, self.vector)
