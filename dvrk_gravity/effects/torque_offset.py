"""Constant bias of the measured efforts."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.arrays import (
    Values,
    added,
    as_array,
    as_value,
    diagonal_columns,
    joint_array,
)
from dvrk_gravity.effects.base.effect import Hypothesis, spread
from dvrk_gravity.effects.base.linear_term import LinearTerm
from dvrk_gravity.effects.base.meaning import READS, meanings, size
from dvrk_gravity.effects.base.motion import Motion, State
from dvrk_gravity.effects.base.site import Site
from dvrk_gravity.effects.base.term import PlantPart, Term
from dvrk_gravity.effects.elastic_cable import ElasticCable
from dvrk_gravity.parameters import Parameter, Value


@dataclass(frozen=True, eq=False)
class TorqueOffset(LinearTerm):
    """measured effort = applied effort + offset: a current sensor's zero, seen from the joints.

    It is a fault of the reading and pushes nothing: predictions of measured efforts have it, the
    simulator's sensors add it, the compensator leaves it out. A constant torque that the arm does
    feel is the constant of a cable's; efforts alone do not distinguish them.

    Attributes:
        offset: (n,) N·m.
    """

    NAME = "torque_offset"
    COEFFICIENTS = ("offset",)
    REMEDY = "calibrate the zero of {joint}'s current sensor"
    NOT_FITTED = "a constant torque is fitted as the first coefficient of a cable's"
    MEANINGS = meanings(offset=size("N·m", READS, "reads"))
    COMPENSATED = False

    offset: Array

    @classmethod
    def schema(cls, arm: Arm) -> tuple[Parameter, ...]:
        return (joint_array(arm, cls.NAME, "N·m", "measured minus applied effort"),)

    @classmethod
    def from_parameters(cls, arm: Arm, values: Mapping[str, Value]) -> TorqueOffset | None:
        offset = as_array(values.get(cls.NAME), arm.n, 0.0)
        return cls(offset) if offset.any() else None

    def parameters(self) -> dict[str, Value]:
        return {self.NAME: as_value(self.offset)}

    def torque(self, state: State) -> Array:
        """Return (…, n) the offset, N·m."""
        return np.broadcast_to(self.offset, state.q.shape).copy()

    def plant(self) -> PlantPart:
        """Part of the reading alone."""
        return PlantPart(reading=lambda q, qd: self.offset)

    @classmethod
    def hypotheses(cls, motion: Motion) -> Iterator[Hypothesis]:
        for joint in np.flatnonzero(motion.present).tolist():
            yield OffsetHypothesis(arm=motion.arm, site=Site.joint(joint))

    @classmethod
    def history_hypotheses(cls, motion: Motion) -> Iterator[Hypothesis]:
        """Of each joint's efforts."""
        return cls.hypotheses(motion)

    def regressor(self, state: State) -> Array:
        return diagonal_columns(np.ones(state.q.shape))


def constant_as_reading(arm: Arm, terms: Iterable[Term], constant: Array) -> tuple[Term, ...]:
    """Return terms with (n,) constants of the cables taken for a bias of the reading, N·m or N.

    Their sum, which is what is measured, stays the same.
    """
    found = list(terms)
    kinds = (TorqueOffset(np.zeros(arm.n)), ElasticCable.constant(arm, np.zeros(arm.n)))
    for kind, change in zip(kinds, (constant, -constant), strict=True):
        k = next((k for k, term in enumerate(found) if term.NAME == kind.NAME), len(found))
        term = found[k] if k < len(found) else kind
        assert isinstance(term, LinearTerm)
        theta = term.theta.copy()
        theta[: arm.n] += change  # of a polynomial, the lowest powers come first
        found[k : k + 1] = [term.with_theta(theta)]
    return tuple(found)


@dataclass(frozen=True, eq=False, kw_only=True)
class OffsetHypothesis(Hypothesis):
    """A joint's effort has a constant bias."""

    EFFECT = TorqueOffset
    CLAIM = "the effort of {where} has a constant bias: it reads {offset}"

    def regressor(self, motion: Motion) -> Array:
        return spread(self.site.row(self.arm), np.ones(len(motion.q)))

    def parameters(self, theta: Array) -> dict[str, float]:
        return {"offset": float(theta[0])}

    def merge(self, values: Values, theta: Array, motion: Motion) -> Values:
        return added(self.arm, values, self.effect, self.site.index, float(theta[0]))
