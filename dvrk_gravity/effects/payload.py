"""A mass carried by a link: a tool, a clip, a gripper."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin

from dvrk_gravity.arm import Arm
from dvrk_gravity.effects import rigid_body
from dvrk_gravity.effects.plant_part import PlantPart
from dvrk_gravity.effects.term import Array, State, Term, as_value
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.parameter import Parameter, Value
from dvrk_gravity.tree import TREE_LINKS, Tree, build_tree, link_frames

_LINKS = tuple(f"link{i}" for i in range(1, 8))
_WEIGHTLESS = np.zeros(3)


@dataclass(frozen=True, eq=False)
class Payload(Term):
    """Weight and inertia of a point mass on a link.

    The compensator carries its weight; its inertia is predicted and simulated. Gravity's
    direction and flag are those of the gravity term, from the same parameters.

    Attributes:
        arm: The arm.
        link: ``link1`` to ``link7``.
        mass: kg.
        first_moment: (3,) mass times its place in the link's distal DH frame, kg·m.
        vector: (3,) gravity in the base frame, m/s^2.
        weighs: The gravity flag.
    """

    NAME = "payload"
    PARAMETERS = (
        Parameter("payload.mass", 0.0, "kg", "mass carried by a link", lower=0.0, upper=10.0),
        Parameter(
            "payload.first_moment", (), "kg·m", "mass times its place in the link's DH frame",
            lower=-10.0, upper=10.0, lengths=(3,),
        ),
        Parameter("payload.link", "link7", "", "link that carries it", choices=_LINKS),
    )  # fmt: skip

    arm: Arm
    link: str
    mass: float
    first_moment: Array
    vector: Array
    weighs: bool = True

    @classmethod
    def from_parameters(cls, arm: Arm, values: Mapping[str, Value]) -> Payload | None:
        """See :meth:`Term.from_parameters`."""
        mass = values.get("payload.mass", 0.0)
        moment = np.array(values.get("payload.first_moment") or (0.0, 0.0, 0.0))
        assert isinstance(mass, float)
        if mass == 0.0:
            if moment.any():
                raise ConfigError("payload.mass", mass, "more than 0 kg beside a first moment")
            return None
        vector = values.get("gravity_vector")
        return cls(
            arm,
            str(values.get("payload.link", "link7")),
            mass,
            moment,
            arm.gravity if vector is None else np.array(vector),
            bool(values.get("gravity_enabled", True)),
        )

    def parameters(self) -> dict[str, Value]:
        """See :meth:`Term.parameters`."""
        return {
            "payload.mass": self.mass,
            "payload.first_moment": as_value(self.first_moment),
            "payload.link": self.link,
            "gravity_vector": as_value(self.vector),
            "gravity_enabled": self.weighs,
        }

    @property
    def inertia(self) -> pin.Inertia:
        """Of the point mass, in the link's distal DH frame."""
        return pin.Inertia(self.mass, self.first_moment / self.mass, np.zeros((3, 3)))

    @property
    def weight(self) -> Tree:
        """Tree whose gravity torques are the payload's."""
        gravity = self.vector if self.weighs else _WEIGHTLESS
        return build_tree(self.arm, {self.link: self.inertia}, gravity)

    def plant(self) -> PlantPart:
        """See :meth:`Term.plant`: weight, and inertia on its link."""
        weight = self.weight if self.weighs else None
        return PlantPart(weight=weight, links={self.link: self.inertia})

    def torque(self, state: State) -> Array:
        """Return (…, 7) torques of weight and inertia, N·m; at rest where no motion is known."""
        q, qd, qdd = (
            None if array is None else array.reshape(-1, array.shape[-1])
            for array in (state.q, state.qd, state.qdd)
        )
        assert q is not None
        gravity = self.vector if self.weighs else _WEIGHTLESS
        torque = rigid_body.torque(self.arm, self._links, q, qd, qdd, gravity)
        return torque.reshape(state.q.shape)

    @cached_property
    def _links(self) -> Array:
        """(90,) inertial parameters of the tree's bodies."""
        rows = np.zeros((len(TREE_LINKS), rigid_body.PER_LINK))
        body = link_frames(self.arm)[self.link].act(self.inertia)
        rows[TREE_LINKS.index(self.link)] = body.toDynamicParameters()
        return rows.ravel()
