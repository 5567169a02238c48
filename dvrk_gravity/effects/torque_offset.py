"""Constant bias of the measured efforts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.arm import N_JOINTS, Arm
from dvrk_gravity.effects.plant_part import PlantPart
from dvrk_gravity.effects.term import (
    Array,
    LinearTerm,
    State,
    as_array,
    as_value,
    diagonal_columns,
    joint_array,
)
from dvrk_gravity.parameter import Value


@dataclass(frozen=True, eq=False)
class TorqueOffset(LinearTerm):
    """measured effort = applied effort + offset: a current sensor's zero, seen from the joints.

    It is a fault of the reading and pushes nothing: predictions of measured efforts have it, the
    simulator's sensors add it, the compensator leaves it out. A constant torque that the arm does
    feel is the constant of ``elastic_cable``; efforts alone cannot tell one from the other.

    Attributes:
        offset: (7,) N·m.
    """

    NAME = "torque_offset"
    PARAMETERS = (joint_array("torque_offset", "N·m", "measured minus applied effort"),)
    COMPENSATED = False

    offset: Array

    @classmethod
    def from_parameters(cls, arm: Arm, values: Mapping[str, Value]) -> TorqueOffset | None:
        """See :meth:`Term.from_parameters`."""
        offset = as_array(values.get(cls.NAME), 0.0)
        return cls(offset) if offset.any() else None

    def parameters(self) -> dict[str, Value]:
        """See :meth:`Term.parameters`."""
        return {self.NAME: as_value(self.offset)}

    def torque(self, state: State) -> Array:
        """Return (…, 7) the offset, N·m."""
        return np.broadcast_to(self.offset, state.q.shape).copy()

    def plant(self) -> PlantPart:
        """See :meth:`Term.plant`: read, and not felt."""
        return PlantPart(reading=lambda q, qd: self.offset)

    @property
    def theta(self) -> Array:
        """See :meth:`LinearTerm.theta`."""
        return self.offset

    def with_theta(self, theta: Array) -> TorqueOffset:
        """See :meth:`LinearTerm.with_theta`."""
        return replace(self, offset=np.asarray(theta, dtype=float))

    def regressor(self, state: State) -> Array:
        """See :meth:`LinearTerm.regressor`."""
        return diagonal_columns(np.ones((*state.q.shape[:-1], N_JOINTS)))
