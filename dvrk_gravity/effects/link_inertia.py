"""Torque that follows acceleration and velocity products: the links' inertia."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.arm import Arm
from dvrk_gravity.effects import rigid_body
from dvrk_gravity.effects.plant_part import PlantPart
from dvrk_gravity.effects.term import Array, LinearTerm, State, as_value
from dvrk_gravity.errors import ShapeError
from dvrk_gravity.parameter import Parameter, Value
from dvrk_gravity.tree import TREE_LINKS

_WEIGHTLESS = np.zeros(3)


@dataclass(frozen=True, eq=False)
class LinkInertia(LinearTerm):
    """tau = M(q) qdd + C(q, qd) qd of the links; their weight is the gravity term's.

    Only combinations of the parameters act (42 of the 90); identified ones need not be
    those of a physical body unless that was asked for.

    Attributes:
        arm: The arm.
        links: (9, 10), one row a body of ``TREE_LINKS``, in its joint's frame, in Pinocchio's
            order: m kg, m c (3) kg·m, Ixx, Ixy, Iyy, Ixz, Iyz, Izz kg·m^2 about the origin.
    """

    NAME = "link_inertia"
    PARAMETERS = tuple(
        Parameter(
            f"link_inertia.{body}",
            (),
            "kg, kg·m, kg·m^2",
            f"{body} in its joint's frame: m, m c (3), Ixx, Ixy, Iyy, Ixz, Iyz, Izz",
            lengths=(rigid_body.PER_LINK,),
        )
        for body in TREE_LINKS
    )
    COMPENSATED = False  # a compensator holds; it knows no acceleration

    arm: Arm
    links: Array

    @classmethod
    def from_parameters(cls, arm: Arm, values: Mapping[str, Value]) -> LinkInertia | None:
        """See :meth:`Term.from_parameters`; a body that is not given has no inertia."""
        given = [values.get(f"{cls.NAME}.{body}") for body in TREE_LINKS]
        if not any(given):
            return None
        nothing = np.zeros(rigid_body.PER_LINK)
        return cls(arm, np.array([np.array(row) if row else nothing for row in given]))

    def parameters(self) -> dict[str, Value]:
        """See :meth:`Term.parameters`."""
        return {
            f"{self.NAME}.{body}": as_value(row)
            for body, row in zip(TREE_LINKS, self.links, strict=True)
        }

    def torque(self, state: State) -> Array:
        """Return (…, 7) torques, N·m; zero where no motion is known."""
        if state.qd is None and state.qdd is None:
            return np.zeros(state.q.shape)
        q, qd, qdd = (
            None if array is None else array.reshape(-1, array.shape[-1])
            for array in (state.q, state.qd, state.qdd)
        )
        assert q is not None
        torque = rigid_body.torque(self.arm, self.theta, q, qd, qdd, _WEIGHTLESS)
        return torque.reshape(state.q.shape)

    def plant(self) -> PlantPart:
        """See :meth:`Term.plant`: nothing; it predicts what the plant's own bodies do."""
        return PlantPart()

    @property
    def theta(self) -> Array:
        """See :meth:`LinearTerm.theta`."""
        return self.links.ravel()

    def with_theta(self, theta: Array) -> LinkInertia:
        """See :meth:`LinearTerm.with_theta`."""
        return replace(self, links=np.reshape(theta, (len(TREE_LINKS), rigid_body.PER_LINK)))

    def regressor(self, state: State) -> Array:
        """See :meth:`LinearTerm.regressor`."""
        if state.q.ndim != 2:
            raise ShapeError("q", state.q.shape, "(N, 7)")
        return rigid_body.regressor(self.arm, state.q, state.qd, state.qdd, _WEIGHTLESS)
