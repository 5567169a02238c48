"""Viscous friction, at the joints and at the motors."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.arrays import (
    as_array,
    as_value,
    diagonal_columns,
    joint_arrays,
    motor_columns,
)
from dvrk_gravity.effects.base.effect import Hypothesis, Values, spread
from dvrk_gravity.effects.base.evidence import Motion
from dvrk_gravity.effects.base.friction_sites import (
    friction_site_kinds,
    friction_sites,
    likely_columns,
    moves_between,
    removable,
    where,
)
from dvrk_gravity.effects.base.meaning import MORE, meanings, size
from dvrk_gravity.effects.base.merging import array
from dvrk_gravity.effects.base.plant_part import PlantPart
from dvrk_gravity.effects.base.polynomial import Range
from dvrk_gravity.effects.base.site import Kind
from dvrk_gravity.effects.base.state import State
from dvrk_gravity.effects.base.supposed import SUPPOSED
from dvrk_gravity.effects.base.term import Evaluator, Friction
from dvrk_gravity.effects.base.unknowns import (
    PRIOR_FRACTION,
    ColumnTable,
    ModelChange,
    effort_of_motor,
    unit_way,
)
from dvrk_gravity.parameters import Parameter, Value


@dataclass(frozen=True, eq=False)
class ViscousFriction(Friction):
    """Torque proportional to the velocity of a joint or of a motor.

    Attributes:
        arm: The arm, for its transmission.
        joint: (n,) N·m·s/rad at the joints.
        motor: (n,) N·m·s/rad at the motors.
    """

    NAME = "viscous_friction"
    REMEDY = "if it is new, look at {joint}'s lubrication and gear"
    MEANINGS = meanings(coefficient=size("N·m·s/rad", MORE))
    EVERYWHERE = True

    @classmethod
    def schema(cls, arm: Arm) -> tuple[Parameter, ...]:
        """See :meth:`Term.schema`."""
        declared = (
            ("joint", "N·m·s/rad", "viscous friction at the joint"),
            ("motor", "N·m·s/rad", "viscous friction at the motor"),
        )
        return joint_arrays(arm, cls.NAME, declared, lower=0.0)

    @classmethod
    def from_parameters(cls, arm: Arm, values: Mapping[str, Value]) -> ViscousFriction | None:
        """See :meth:`Term.from_parameters`."""
        joint = as_array(values.get(f"{cls.NAME}.joint"), arm.n, 0.0)
        motor = as_array(values.get(f"{cls.NAME}.motor"), arm.n, 0.0)
        return cls(arm, joint, motor) if joint.any() or motor.any() else None

    @classmethod
    def nominal(cls, arm: Arm) -> ViscousFriction:
        """See :meth:`Term.nominal`: at the joints."""
        return cls(arm, SUPPOSED.viscous * arm.effort_limit / arm.scale, np.zeros(arm.n))

    @classmethod
    def stated(cls, arm: Arm) -> ViscousFriction | None:
        """See :meth:`Term.stated`: the damping of a URDF's joints."""
        damping = np.array([joint.damping for joint in arm.joints])
        return cls(arm, damping, np.zeros(arm.n)) if damping.any() else None

    def parameters(self) -> dict[str, Value]:
        """See :meth:`Term.parameters`."""
        levels = {"joint": self.joint, "motor": self.motor}
        return {f"{self.NAME}.{name}": as_value(v) for name, v in levels.items() if v.any()}

    def torque(self, state: State) -> Array:
        """Return (…, n) friction torques, N·m; zero where the velocity is unknown."""
        if state.qd is None:
            return np.zeros(state.q.shape)
        return state.qd @ self._damping

    def prepare(self) -> Evaluator:
        """See :meth:`Term.prepare`."""
        damping = self._damping
        return lambda q, qd: np.zeros(len(damping)) if qd is None else qd.dot(damping)

    @classmethod
    def plausible(cls, arm: Arm, valid: Range) -> ViscousFriction:
        """See :meth:`LinearTerm.plausible`: at one radian a second."""
        joint, motor = (
            PRIOR_FRACTION * effort_of_motor(arm, kind) / unit_way(arm, kind)
            for kind in (Kind.JOINT, Kind.MOTOR)
        )
        return cls(arm, joint, motor)

    def regressor(self, state: State) -> Array:
        """See :meth:`LinearTerm.regressor`."""
        if state.qd is None:
            return np.zeros((*state.q.shape, len(self.theta)))
        motor = motor_columns(self.arm, self.arm.actuator_position(state.qd))
        return np.concatenate([diagonal_columns(state.qd), motor], axis=-1)

    @classmethod
    def hypotheses(cls, motion: Motion) -> Iterator[Hypothesis]:
        """See :meth:`Effect.hypotheses`."""
        if motion.static:
            return
        for friction_site in friction_sites(motion):
            speed = motion.qd @ friction_site.row(motion.arm)
            yield ViscousHypothesis(
                arm=motion.arm, site=friction_site, joints=(friction_site.index,),
                removable=removable(motion, friction_site, speed),
            )  # fmt: skip

    def plant(self) -> PlantPart:
        """See :meth:`Term.plant`."""
        return PlantPart(damping=self._damping)

    @classmethod
    def moves(cls, table: ColumnTable, inside: set[int]) -> Iterator[ModelChange]:
        """See :meth:`LinearTerm.moves`.

        Every joint has viscous friction; what is too little to improve the cross-validated error
        would still be in the other parameters, beyond their intervals.
        """
        for joint in range(table.arm.n):
            present = inside & set(table.select(effect=cls.NAME, joint=joint))
            for kind in friction_site_kinds(table.arm, joint):
                here = tuple(table.select(effect=cls.NAME, site_kind=kind, joint=joint))
                text = f"{cls.NAME} {where(table.arm, joint, kind)}"
                if here[0] not in inside:
                    yield ModelChange(here, (), text)
                elif len(present) > 1:
                    yield ModelChange((), here, f"without {text}")
        yield from moves_between(cls.NAME, table, inside)

    @classmethod
    def plainest(cls, table: ColumnTable) -> list[int]:
        """See :meth:`LinearTerm.plainest`: at every joint or, where it is likelier, its motor."""
        return likely_columns(cls.NAME, table)

    @cached_property
    def _damping(self) -> Array:
        """(n, n) symmetric damping matrix in joint space."""
        to_motor = self.arm.joint_to_actuator
        return np.diag(self.joint) + to_motor.T @ np.diag(self.motor) @ to_motor


@dataclass(frozen=True, eq=False, kw_only=True)
class ViscousHypothesis(Hypothesis):
    """Viscous friction at a joint or a motor."""

    EFFECT = ViscousFriction
    CLAIM = "{where} has {coefficient} viscous friction than {model}"

    variable: str = "velocity"

    def regressor(self, motion: Motion) -> Array:
        """See :meth:`Hypothesis.regressor`."""
        row = self.site.row(self.arm)
        return spread(row, motion.qd @ row)

    def parameters(self, theta: Array) -> dict[str, float]:
        """See :meth:`Hypothesis.parameters`."""
        return {"coefficient": float(theta[0])}

    def merge(self, values: Values, theta: Array, motion: Motion) -> Values:
        """See :meth:`Hypothesis.merge`; no friction is below zero."""
        del motion
        name, index = f"{self.effect}.{self.site.kind.value}", self.site.index
        level = array(self.arm, values, name)
        level[index] = max(0.0, level[index] + theta[0])
        return {**values, name: tuple(level.tolist())}
