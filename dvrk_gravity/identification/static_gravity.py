"""Gravity's columns at static poses, and how their coefficients become a model's parameters.

An MTM has the ten of beta; any other arm the combinations of its links' masses and first moments
that act, each in units of what the links may weigh.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dvrk_gravity import gravity
from dvrk_gravity.arms import Arm, is_mtm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import LinkWeight, as_value, weight_directions
from dvrk_gravity.effects.base import rigid_body
from dvrk_gravity.identification.base_combinations import base_weights
from dvrk_gravity.parameters import Value

N_BETA = 10


@dataclass(frozen=True)
class PoseGravitySettings:
    """How large gravity is before any data.

    Attributes:
        links: Size of links' parameters, in what the links of the arm's file weigh or are supposed
            to. Chosen: 1 N·m is two to five times the RMS of MTMR-28002's beta. With one, what
            poses tell poorly is held back too much: loads on a UR5 identified from 60 poses came
            out 8 % too heavy (benchmark/poses.py).
    """

    links: float = 3.0


@dataclass(frozen=True, eq=False)
class GravityColumns(ABC):
    """What gravity contributes to the torques of static poses, linear in k coefficients.

    Attributes:
        arm: The arm, its base as it is mounted.
    """

    arm: Arm

    @property
    @abstractmethod
    def count(self) -> int:
        """Number k of coefficients, each of the order of one before any data."""

    @property
    @abstractmethod
    def strong(self) -> Array:
        """(n,) torques that are more than any joint's friction or cable, N·m or N."""

    @property
    @abstractmethod
    def sprung(self) -> tuple[str, ...]:
        """Joints whose spring or counterweight pulls as a weight does, and is none of theirs."""

    @property
    @abstractmethod
    def bounded(self) -> bool:
        """Whether no prediction is to pass what poses showed of a joint, wherever the arm is."""

    @abstractmethod
    def at(self, q: Array) -> Array:
        """Return (N, n, k) joint torques of the coefficients at (N, n) positions."""

    @abstractmethod
    def quantities(self) -> tuple[tuple[str, str, Array], ...]:
        """Return name, unit and (k,) combination of the coefficients of what a report tells."""

    @abstractmethod
    def parameters(self, theta: Array) -> Mapping[str, Value]:
        """Return the parameters of a model that has (k,) coefficients."""


class BetaColumns(GravityColumns):
    """Of an MTM: beta in N·m."""

    @property
    def count(self) -> int:
        """See :meth:`GravityColumns.count`."""
        return N_BETA

    @property
    def strong(self) -> Array:
        """See :meth:`GravityColumns.strong`."""
        return np.ones(self.arm.n)

    @property
    def sprung(self) -> tuple[str, ...]:
        """See :meth:`GravityColumns.sprung`."""
        return ("wrist_pitch",)

    @property
    def bounded(self) -> bool:
        """See :meth:`GravityColumns.bounded`: beta makes up for cables, and is no link's weight."""
        return True

    def at(self, q: Array) -> Array:
        """See :meth:`GravityColumns.at`."""
        return gravity.regressor(q, self.arm.gravity, N_BETA)

    def quantities(self) -> tuple[tuple[str, str, Array], ...]:
        """See :meth:`GravityColumns.quantities`."""
        unit = self.arm.own_unit("N·m")
        return tuple(
            (f"beta{k + 1} ({gravity.BETA_NAMES[k]})", unit, row)
            for k, row in enumerate(np.eye(N_BETA))
        )

    def parameters(self, theta: Array) -> Mapping[str, Value]:
        """See :meth:`GravityColumns.parameters`."""
        return {"beta": as_value(theta), "gravity_vector": as_value(self.arm.gravity)}


class LinkColumns(GravityColumns):
    """Of any other arm: combinations of its links' weights, of unit prior size."""

    @cached_property
    def _directions(self) -> Array:
        """(4 bodies, k) from the coefficients to the links' masses and first moments."""
        return PoseGravitySettings().links * weight_directions(self.arm)

    @property
    def count(self) -> int:
        """See :meth:`GravityColumns.count`."""
        return self._directions.shape[1]

    @property
    def strong(self) -> Array:
        """See :meth:`GravityColumns.strong`: what its motors can do at most."""
        return self.arm.effort_limit

    @property
    def sprung(self) -> tuple[str, ...]:
        """See :meth:`GravityColumns.sprung`: none that is known."""
        return ()

    @property
    def bounded(self) -> bool:
        """See :meth:`GravityColumns.bounded`: links weigh elsewhere what they plausibly weigh."""
        return False

    def at(self, q: Array) -> Array:
        """See :meth:`GravityColumns.at`."""
        return rigid_body.weight_regressor(self.arm, q, self.arm.gravity) @ self._directions

    def quantities(self) -> tuple[tuple[str, str, Array], ...]:
        """See :meth:`GravityColumns.quantities`."""
        return tuple(
            (name, self.arm.own_unit(unit), combination @ self._directions)
            for name, unit, combination in base_weights(self.arm)
        )

    def parameters(self, theta: Array) -> Mapping[str, Value]:
        """See :meth:`GravityColumns.parameters`."""
        links = (self._directions @ theta).reshape(-1, rigid_body.OF_WEIGHT)
        return LinkWeight(self.arm, links, self.arm.gravity).parameters()


def gravity_of(arm: Arm) -> GravityColumns:
    """Return gravity's columns of an arm."""
    return (BetaColumns if is_mtm(arm) else LinkColumns)(arm)
