"""Viscous friction, at the joints and at the motors."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.arrays import Values, added, as_array, as_value, joint_arrays
from dvrk_gravity.effects.base.column import PRIOR_FRACTION, ColumnTable
from dvrk_gravity.effects.base.effect import Hypothesis, spread
from dvrk_gravity.effects.base.friction import Friction, columns_at_sites, friction_sites, removable
from dvrk_gravity.effects.base.joint_dynamics import JointDynamics
from dvrk_gravity.effects.base.meaning import MORE, meanings, size
from dvrk_gravity.effects.base.motion import Motion, State
from dvrk_gravity.effects.base.polynomials import Range
from dvrk_gravity.effects.base.site import Site, effort_limits, unit_travel
from dvrk_gravity.effects.base.term import Evaluator, PlantPart
from dvrk_gravity.parameters import Parameter, Value

_NOMINAL = 0.01  # of a joint's largest effort at 1 rad/s (``Arm.scale``), unmeasured. Chosen


@dataclass(frozen=True, eq=False)
class ViscousFriction(Friction):
    """Torque proportional to the velocity of a joint or of a motor.

    Attributes:
        arm: The arm, for its transmission.
        joint: (n,) N·m·s/rad at the joints.
        motor: (n,) N·m·s/rad at the motors.
    """

    NAME = "viscous_friction"
    IN_FILES = ("console", "urdf", "mjcf")
    REMEDY = "if it is new, look at {joint}'s lubrication and gear"
    MEANINGS = meanings(coefficient=size("N·m·s/rad", MORE))
    EVERYWHERE = True

    joint: Array
    motor: Array

    @classmethod
    def schema(cls, arm: Arm) -> tuple[Parameter, ...]:
        declared = (
            ("joint", "N·m·s/rad", "viscous friction at the joint"),
            ("motor", "N·m·s/rad", "viscous friction at the motor"),
        )
        return joint_arrays(arm, cls.NAME, declared, lower=0.0)

    @classmethod
    def from_parameters(cls, arm: Arm, values: Mapping[str, Value]) -> ViscousFriction | None:
        joint, motor = (
            as_array(values.get(f"{cls.NAME}.{k}"), arm.n, 0.0) for k in cls.COEFFICIENTS
        )
        return cls(arm, joint, motor) if joint.any() or motor.any() else None

    def parameters(self) -> dict[str, Value]:
        levels = {"joint": self.joint, "motor": self.motor}
        return {f"{self.NAME}.{name}": as_value(v) for name, v in levels.items() if v.any()}

    @classmethod
    def nominal(cls, arm: Arm) -> ViscousFriction:
        return cls(arm, _NOMINAL * arm.effort_limit / arm.scale, np.zeros(arm.n))

    @classmethod
    def from_arm(cls, arm: Arm) -> ViscousFriction | None:
        """The damping of a URDF's joints."""
        damping = np.array([joint.damping for joint in arm.joints])
        return cls(arm, damping, np.zeros(arm.n)) if damping.any() else None

    def torque(self, state: State) -> Array:
        """Return (…, n) friction torques, N·m; zero where the velocity is unknown."""
        return np.zeros(state.q.shape) if state.qd is None else state.qd @ self._damping

    def prepare(self) -> Evaluator:
        damping = self._damping
        return lambda q, qd: np.zeros(len(damping)) if qd is None else qd.dot(damping)

    def joint_dynamics(self, arm: Arm, q: Array) -> JointDynamics:
        return JointDynamics(arm, damping=np.array([self.joint, self.motor]))

    def plant(self) -> PlantPart:
        return PlantPart(damping=self._damping)

    @cached_property
    def _damping(self) -> Array:
        """(n, n) symmetric damping matrix in joint space."""
        to_motor = self.arm.joint_to_actuator
        return np.diag(self.joint) + to_motor.T @ np.diag(self.motor) @ to_motor

    def regressor(self, state: State) -> Array:
        if state.qd is None:
            return np.zeros((*state.q.shape, len(self.theta)))
        return columns_at_sites(self.arm, state.qd, self.arm.actuator_position(state.qd))

    @classmethod
    def plausible(cls, arm: Arm, valid: Range) -> ViscousFriction:
        """Per rad/s (``Arm.scale``)."""
        joint, motor = (
            PRIOR_FRACTION * effort_limits(arm, kind) / unit_travel(arm, kind) for kind in cls.SITES
        )
        return cls(arm, joint, motor)

    @classmethod
    def may_be_absent(cls, table: ColumnTable, inside: set[int], joint: int) -> bool:
        """Only from one of two sites: every joint has viscous friction.

        If it is too little to improve the cross-validated error, it would still bias the other
        parameters beyond their intervals.
        """
        sites = (Site(kind, joint) for kind in cls.SITES)
        return sum(bool(inside.intersection(table.select(cls.NAME, site))) for site in sites) > 1

    @classmethod
    def hypotheses(cls, motion: Motion) -> Iterator[Hypothesis]:
        for site in () if motion.static else friction_sites(motion):
            limit = removable(motion, site, motion.qd @ site.row(motion.arm))
            yield ViscousHypothesis(arm=motion.arm, site=site, removable=limit)

    @classmethod
    def history_hypotheses(cls, motion: Motion) -> Iterator[Hypothesis]:
        """Of each joint."""
        return (each for each in cls.hypotheses(motion) if each.of_joint)


@dataclass(frozen=True, eq=False, kw_only=True)
class ViscousHypothesis(Hypothesis):
    """The model's viscous friction at a joint or a motor is wrong."""

    EFFECT = ViscousFriction
    CLAIM = "{where} has {coefficient} viscous friction than {model}"

    variable = "velocity"

    def regressor(self, motion: Motion) -> Array:
        row = self.site.row(self.arm)
        return spread(row, motion.qd @ row)

    def parameters(self, theta: Array) -> dict[str, float]:
        return {"coefficient": float(theta[0])}

    def merge(self, values: Values, theta: Array, motion: Motion) -> Values:
        """No friction below zero."""
        name = f"{self.effect}.{self.site.kind.value}"
        return added(self.arm, values, name, self.site.index, float(theta[0]), lower=0.0)
