"""What static poses ever showed on each joint: no prediction goes beyond it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base import registry
from dvrk_gravity.effects.base.arrays import as_array, as_value, joint_arrays
from dvrk_gravity.effects.base.motion import State
from dvrk_gravity.effects.base.term import Term
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.parameters import Parameter, Value


@dataclass(frozen=True, eq=False)
class ShownTorque(Term):
    """tau_j = clip(sum, lower_j, upper_j) - sum, over the terms that static poses determine.

    It takes back what these terms claim beyond the torques that were measured. Cables are held at
    the edges of their ranges by themselves; gravity is not, and a few degrees of the shoulder do
    not say what it is with the forearm upright. Within the calibrated range the term is zero.
    It bounds predictions: the compensator has effort limits of its own.

    Attributes:
        terms: The terms whose sum is bounded.
        lower: (n,) N·m.
        upper: (n,) N·m.
    """

    NAME = "shown_torque"
    COMPENSATED = False

    terms: tuple[Term, ...]
    lower: Array
    upper: Array

    @classmethod
    def schema(cls, arm: Arm) -> tuple[Parameter, ...]:
        declared = (
            ("lower", "N·m", "least torque measured at poses, less its noise"),
            ("upper", "N·m", "greatest torque measured at poses, plus its noise"),
        )
        return joint_arrays(arm, cls.NAME, declared)

    @classmethod
    def from_parameters(cls, arm: Arm, values: Mapping[str, Value]) -> ShownTorque | None:
        if not values.get(f"{cls.NAME}.lower") and not values.get(f"{cls.NAME}.upper"):
            return None
        lower = as_array(values.get(f"{cls.NAME}.lower"), arm.n, -np.inf)
        upper = as_array(values.get(f"{cls.NAME}.upper"), arm.n, np.inf)
        for joint, low, high in zip(arm.joint_names, lower.tolist(), upper.tolist(), strict=True):
            if low > high:
                raise ConfigError(f"{cls.NAME}.lower of {joint}", low, f"at most upper ({high:g})")
        of_poses = (term for term in registry.terms() if term.AT_POSES)
        built = (term.from_parameters(arm, values) for term in of_poses)
        return cls(tuple(term for term in built if term is not None), lower, upper)

    def parameters(self) -> dict[str, Value]:
        edges = {"lower": self.lower, "upper": self.upper}
        return {
            f"{self.NAME}.{name}": as_value(edge)
            for name, edge in edges.items()
            if np.isfinite(edge).all()
        }

    def torque(self, state: State) -> Array:
        """Return (…, n) torques that bring the sum within the bounds, N·m."""
        total = sum((term.torque(state) for term in self.terms), start=np.zeros(state.q.shape))
        return np.clip(total, self.lower, self.upper) - total
