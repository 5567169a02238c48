"""Gravity of the links, from beta: gY(q) beta."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dvrk_gravity import gravity
from dvrk_gravity.arms import Arm, Tree, beta_tree, is_mtm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.arrays import Values, as_value
from dvrk_gravity.effects.base.linear_term import LinearTerm
from dvrk_gravity.effects.base.links import gravity_of, gravity_parameters, weight_evaluator
from dvrk_gravity.effects.base.motion import State
from dvrk_gravity.effects.base.term import Evaluator, PlantPart
from dvrk_gravity.parameters import Parameter, Value

_SIZES = (10, 12, 14)  # of beta


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
    COEFFICIENTS = ("beta",)
    WEIGHT_OF_ARM = True
    AT_POSES = True

    arm: Arm
    beta: Array
    vector: Array
    enabled: bool = True

    @classmethod
    def schema(cls, arm: Arm) -> tuple[Parameter, ...]:
        if not is_mtm(arm):
            return ()
        return (
            Parameter(
                "beta", (), "N·m", "gravity base parameters (g inside), 10, 12 or 14 of them",
                lower=-100.0, upper=100.0, lengths=_SIZES,
            ),
            *gravity_parameters(),
        )  # fmt: skip

    @classmethod
    def from_parameters(cls, arm: Arm, values: Mapping[str, Value]) -> Gravity | None:
        if not values.get("beta"):
            return None
        return cls(arm, np.array(values["beta"]), *gravity_of(arm, values))

    def parameters(self) -> dict[str, Value]:
        return {
            "beta": as_value(self.beta),
            "gravity_enabled": self.enabled,
            "gravity_vector": as_value(self.vector),
        }

    def with_gravity(self, vector: Array) -> Gravity:
        return replace(self, vector=vector)

    @property
    def gravity_vector(self) -> Array:
        return self.vector

    @property
    def gravity_beta(self) -> Array:
        return self.beta

    def torque(self, state: State) -> Array:
        """Return (…, n) gravity torques: one pose by Pinocchio, many in closed form."""
        if not self.enabled:
            return np.zeros(state.q.shape)
        if state.q.ndim == 1:
            return self._tree.gravity(state.q)
        return gravity.torque(state.q, self.beta, self.vector)

    @property
    def carries_arm(self) -> bool:
        return self.enabled and bool(self.beta.any())

    def prepare(self) -> Evaluator:
        if not self.enabled:
            return super().prepare()
        # A tree of its own: Pinocchio's workspace is for one thread.
        return weight_evaluator(beta_tree(self.arm, self.beta, self.vector))

    def regressor(self, state: State) -> Array:
        return gravity.regressor(state.q, self.vector, len(self.beta))

    def plant(self) -> PlantPart:
        if not self.enabled:
            return PlantPart()
        return PlantPart(weight=beta_tree(self.arm, self.beta, self.vector))

    @cached_property
    def _tree(self) -> Tree:
        return beta_tree(self.arm, self.beta, self.vector)


def with_beta(values: Values, change: Array) -> Values | None:
    """Return a model's parameters with (14,) N·m added to beta; ``None`` if it has no beta."""
    beta = np.array(values.get("beta") or ())
    if not beta.size:
        return None
    needed = next(size for size in _SIZES if not np.any(np.abs(change[size:]) > 1e-9))
    total = np.zeros(max(len(beta), needed))
    total[: len(beta)] += beta
    total += change[: len(total)]
    return {**values, "beta": as_value(total)}


def link_beta(link: str, mass: float, moment: Array) -> Array:
    """Return (14,) change of beta, N·m, by a link's mass, kg, and (3,) first moment, kg·m."""
    weight = gravity.beta_from_links({link: gravity.LinkMass(1.0)}, columns=_SIZES[-1])
    per_moment = [
        gravity.beta_from_links(
            {link: gravity.LinkMass(1.0, tuple(axis.tolist()))}, columns=_SIZES[-1]
        )
        - weight
        for axis in np.eye(3)
    ]
    return mass * weight + np.array(per_moment).T @ moment
