"""The rigid body's columns: base parameters of its links, and springs.

Weight and inertia share the links' parameters, so that what is identified is a set of base
parameters. An MTM's weight is beta, a function of them; a spring that balances its arm or forearm
pulls like a mass and has no inertia: it is a column of gravity alone.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from dvrk_gravity import gravity
from dvrk_gravity.arms import OF_WEIGHT, Arm, is_mtm, rigid_body
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import (
    PRIOR_FRACTION,
    THE_ARM,
    Column,
    ColumnTable,
    Gravity,
    LinkInertia,
    LinkWeight,
    State,
    Term,
    base_directions,
    beta_map,
)

SPRINGS = 4  # entries of an MTM's beta, arm and forearm, that a balancing spring can add to
RIGID = (LinkInertia.NAME, Gravity.NAME, LinkWeight.NAME)  # effects that are always fitted


def link_columns(table: ColumnTable) -> list[int]:
    """Return the indices of the links' columns."""
    return table.select(effect=RIGID[0])


class RigidColumns:
    """Columns of the links' base parameters, then of springs.

    Attributes:
        arm: The arm, its base as it is mounted.
        base: (10 bodies, b) from base combinations of unit prior size to the links' parameters.
    """

    def __init__(self, arm: Arm, absent: tuple[int, ...] = ()) -> None:
        """Find the combinations, with the ``absent`` of the links' parameters zero."""
        self.arm = arm
        self.base = base_directions(arm, absent)
        self._springs = SPRINGS if is_mtm(arm) else 0

    @cached_property
    def columns(self) -> tuple[Column, ...]:
        """The columns, in order."""
        inertia, weight, _ = RIGID
        spring = PRIOR_FRACTION * float(self.arm.actuator_effort_limit[1]) if self._springs else 0.0
        return (
            *(Column(inertia, THE_ARM, index, 1.0) for index in range(self.base.shape[1])),
            *(Column(weight, THE_ARM, index, spring) for index in range(self._springs)),
        )

    def regressor(self, state: State) -> Array:
        """Return (N, n, p) joint torques of all columns at (N, n) true states."""
        arm = self.arm
        links = rigid_body.regressor(arm, state.q, state.qd, state.qdd, arm.gravity)
        if not self._springs:
            return links @ self.base
        springs = gravity.regressor(state.q, arm.gravity)[..., : self._springs]
        return np.concatenate([links @ self.base, springs], axis=-1)

    def bodies(self, theta: Array) -> tuple[Array, Array]:
        """Return (10 bodies,) link parameters and springs, N·m, of (p,) coefficients."""
        own, springs = np.split(theta, [self.base.shape[1]])
        return self.base @ own, springs

    def terms(self, arm: Arm, theta: Array, links: Array | None) -> list[Term]:
        """Return the terms of an arm's model; see :meth:`Columns.terms`."""
        own, springs = self.bodies(theta)
        links = own if links is None else links
        if not links.any() and not springs.any():
            return []
        bodies = links.reshape(-1, rigid_body.PER_LINK)
        inertia = LinkInertia(arm, bodies)
        if not self._springs:
            return [LinkWeight(arm, bodies[:, :OF_WEIGHT].copy(), self.arm.gravity), inertia]
        beta = beta_map(self.arm) @ links
        beta[: self._springs] += springs
        return [Gravity(arm, beta, self.arm.gravity), inertia]
