"""Drag that grows with the square of the speed: an effect that the package has never heard of."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import (
    MORE,
    PRIOR_FRACTION,
    Hypothesis,
    LinearTerm,
    Motion,
    Range,
    Site,
    State,
    Values,
    added,
    as_array,
    as_value,
    diagonal_columns,
    joint_array,
    meanings,
    size,
    spread,
)
from dvrk_gravity.parameters import Parameter, Value


@dataclass(frozen=True, eq=False)
class QuadraticDrag(LinearTerm):
    """tau = drag |qd| qd: a joint that stirs a fluid.

    Attributes:
        drag: (n,) N·m·s^2/rad^2.
    """

    NAME = "quadratic_drag"
    COEFFICIENTS = ("drag",)
    FRICTION = True
    MEANINGS = meanings(coefficient=size("N·m·s^2/rad^2", MORE))

    drag: Array

    # In model files.
    @classmethod
    def schema(cls, arm: Arm) -> tuple[Parameter, ...]:
        return (joint_array(arm, cls.NAME, "N·m·s^2/rad^2", "drag of each joint", 0.0),)

    @classmethod
    def from_parameters(cls, arm: Arm, values: Mapping[str, Value]) -> QuadraticDrag | None:
        drag = as_array(values.get(cls.NAME), arm.n, 0.0)
        return cls(drag) if drag.any() else None

    def parameters(self) -> dict[str, Value]:
        return {self.NAME: as_value(self.drag)}

    # Compensated and simulated.
    def torque(self, state: State) -> Array:
        return self.regressor(state) @ self.drag

    def scaled(self, part: Array) -> Self:
        """The part that the compensator applies."""
        return replace(self, drag=part * self.drag)

    # Identified.
    @classmethod
    def plausible(cls, arm: Arm, valid: Range) -> QuadraticDrag:
        """Prior sizes for a fit."""
        return cls(PRIOR_FRACTION * arm.actuator_effort_limit)

    def regressor(self, state: State) -> Array:
        speed = np.zeros(state.q.shape) if state.qd is None else state.qd
        return diagonal_columns(np.abs(speed) * speed)

    # Found by the diagnosis.
    @classmethod
    def hypotheses(cls, motion: Motion) -> Iterator[Hypothesis]:
        if not motion.static:
            for joint in np.flatnonzero(motion.moves).tolist():
                yield DragHypothesis(arm=motion.arm, site=Site.joint(joint))


@dataclass(frozen=True, eq=False, kw_only=True)
class DragHypothesis(Hypothesis):
    """A joint stirs a fluid that the model leaves out."""

    EFFECT = QuadraticDrag
    CLAIM = "{where} stirs a fluid: {coefficient} drag than {model}"

    variable = "velocity"

    def regressor(self, motion: Motion) -> Array:
        speed = motion.qd[:, self.site.index]
        return spread(self.site.row(self.arm), np.abs(speed) * speed)

    def parameters(self, theta: Array) -> dict[str, float]:
        return {"coefficient": float(theta[0])}

    def merge(self, values: Values, theta: Array, motion: Motion) -> Values:
        return added(self.arm, values, self.effect, self.site.index, float(theta[0]), lower=0.0)
