"""Weight of an arm's links, from their masses and first moments: any arm but the MTM."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pinocchio as pin

from dvrk_gravity.arms import OF_WEIGHT, Arm, Tree, build_tree, is_mtm, rigid_body, weight_regressor
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.arrays import Values, as_value
from dvrk_gravity.effects.base.linear_term import LinearTerm
from dvrk_gravity.effects.base.links import (
    assumed_inertias,
    beta_map,
    gravity_of,
    gravity_parameters,
    weight_evaluator,
)
from dvrk_gravity.effects.base.motion import State
from dvrk_gravity.effects.base.term import Evaluator, PlantPart
from dvrk_gravity.effects.gravity import Gravity
from dvrk_gravity.errors import ShapeError
from dvrk_gravity.parameters import Parameter, Value


@dataclass(frozen=True, eq=False)
class LinkWeight(LinearTerm):
    """tau = g(q) of the links; their inertia is another term's.

    An MTM has ``gravity`` in its place, whose beta are the combinations that act. Here each body
    has its own parameters, of which only combinations act, too: identified ones need not be those
    of a body that can exist.

    Attributes:
        arm: The arm.
        links: (bodies, 4), one row a body of the arm, in its joint's frame: m kg, m c (3) kg·m.
        vector: (3,) gravity in the base frame, m/s^2.
        enabled: The gravity flag; off means that this term is zero.
    """

    NAME = "link_weight"
    COEFFICIENTS = ("links",)
    WEIGHT_OF_ARM = True
    OF_LINKS = OF_WEIGHT

    arm: Arm
    links: Array
    vector: Array
    enabled: bool = True

    @classmethod
    def schema(cls, arm: Arm) -> tuple[Parameter, ...]:
        if is_mtm(arm):
            return ()
        weights = (
            Parameter(
                f"{cls.NAME}.{body}", (), "kg, kg·m",
                f"weight of {body}, in its joint's frame: m, m c (3)", lengths=(OF_WEIGHT,),
            )
            for body in arm.body_names
        )  # fmt: skip
        return (*weights, *gravity_parameters())

    @classmethod
    def from_parameters(cls, arm: Arm, values: Mapping[str, Value]) -> LinkWeight | None:
        given = [values.get(f"{cls.NAME}.{body}") for body in arm.body_names]
        if not any(given):
            return None
        nothing = np.zeros(OF_WEIGHT)
        links = np.array([np.array(row) if row else nothing for row in given])
        return cls(arm, links, *gravity_of(arm, values))

    @classmethod
    def nominal(cls, arm: Arm) -> LinkWeight | None:
        if is_mtm(arm):
            return None
        assumed, nothing = assumed_inertias(arm), pin.Inertia.Zero()
        rows = [
            body.frame.act(assumed.get(body.name, nothing)).toDynamicParameters()[:OF_WEIGHT]
            for body in arm.bodies
        ]
        return cls(arm, np.array(rows), arm.gravity)

    @classmethod
    def from_arm(cls, arm: Arm) -> LinkWeight | None:
        if arm.inertial_parameters is None:
            return None
        return cls(arm, arm.inertial_parameters[:, :OF_WEIGHT], arm.gravity)

    def parameters(self) -> dict[str, Value]:
        rows = zip(self.arm.body_names, self.links, strict=True)
        return {
            **{f"{self.NAME}.{body}": as_value(row) for body, row in rows},
            "gravity_enabled": self.enabled,
            "gravity_vector": as_value(self.vector),
        }

    def with_gravity(self, vector: Array) -> LinkWeight:
        return replace(self, vector=vector)

    @property
    def gravity_vector(self) -> Array:
        return self.vector

    @property
    def carries_arm(self) -> bool:
        return self.enabled and bool(self.links.any())

    def torque(self, state: State) -> Array:
        """Return (…, n) torques that hold the links up, N·m or N."""
        if not self.enabled:
            return np.zeros(state.q.shape)
        if state.q.ndim == 1:
            return self.prepare()(state.q, None)
        links = np.pad(self.links, ((0, 0), (0, rigid_body.PER_LINK - OF_WEIGHT)))
        return rigid_body.torque(self.arm, links.ravel(), state.q, None, None, self.vector)

    def prepare(self) -> Evaluator:
        if not self.enabled:
            return super().prepare()
        whole, ballast = (weight_evaluator(tree) for tree in self._trees)
        return lambda q, qd: whole(q, qd) - ballast(q, qd)

    def plant(self) -> PlantPart:
        weight = self.prepare()
        return PlantPart(at=lambda q, qd: (weight(q, qd), None))

    @cached_property
    def _trees(self) -> tuple[Tree, Tree]:
        """The links with ballast at their joints, and the ballast alone.

        Pinocchio has a body's centre of mass and not its first moment, and identified masses may
        be zero or less; torque is linear in both.
        """
        ballast = 1.0 + float(np.abs(self.links[:, 0]).max())
        trees = []
        for links in (self.links, np.zeros(self.links.shape)):
            inertias = {}
            for body, (mass, *moment) in zip(self.arm.bodies, links.tolist(), strict=True):
                whole = mass + ballast
                point = pin.Inertia(whole, np.array(moment) / whole, np.zeros((3, 3)))
                inertias[body.name] = body.frame.actInv(point)
            trees.append(build_tree(self.arm, inertias, self.vector))
        return trees[0], trees[1]

    def regressor(self, state: State) -> Array:
        if state.q.ndim != 2:
            raise ShapeError("q", state.q.shape, "(N, n)")
        return weight_regressor(self.arm, state.q, self.vector)


def weight_of(arm: Arm, links: Array, mounted: Arm | None = None) -> Gravity | LinkWeight:
    """Return the weight of links as the arm's models have it: an MTM's as beta.

    Args:
        arm: The arm.
        links: (bodies, 4 or more) inertial parameters, in Pinocchio's order; of an MTM all 10.
        mounted: The arm with its base as it is mounted; ``None``: as its file says.
    """
    at = arm if mounted is None else mounted
    if is_mtm(arm):
        return Gravity(arm, beta_map(at) @ links.ravel(), at.gravity)
    return LinkWeight(arm, links[:, :OF_WEIGHT].copy(), at.gravity)


def with_weight(arm: Arm, values: Values, change: Array) -> Values | None:
    """Return a model's parameters with (bodies, 4) added to the links' weights.

    ``None`` if the model has no weights.
    """
    names = [f"{LinkWeight.NAME}.{body}" for body in arm.body_names]
    if not any(values.get(name) for name in names):
        return None
    rows = [np.array(values.get(name) or np.zeros(OF_WEIGHT)) for name in names]
    total = np.array(rows) + change
    return {**values, **{name: as_value(row) for name, row in zip(names, total, strict=True)}}
