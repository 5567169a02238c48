"""Coulomb friction, at the joints and at the motors, possibly different by direction."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.all_friction import FACTOR, AllFriction
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
from dvrk_gravity.effects.base.meaning import MORE, Estimate, Meaning, meanings, size
from dvrk_gravity.effects.base.merging import array
from dvrk_gravity.effects.base.plant_part import PlantPart
from dvrk_gravity.effects.base.polynomial import Range
from dvrk_gravity.effects.base.site import Kind, Site
from dvrk_gravity.effects.base.state import State
from dvrk_gravity.effects.base.supposed import SUPPOSED
from dvrk_gravity.effects.base.term import Evaluator, LinearTerm, Unknowns
from dvrk_gravity.effects.base.unknowns import (
    PRIOR_FRACTION,
    ColumnTable,
    ModelChange,
    effort_of_motor,
    site_columns,
)
from dvrk_gravity.parameters import Parameter, Value

_DRIVES = 0.3  # of the larger level, within which the smaller may be below zero by chance
_SIGN: Array = np.array(1e9)  # slope that makes the ramp a sign function, while 0 stays 0
_TRANSITION = 0.003  # rad/s (a tenth in m/s) over which it changes its sign when it is identified
_LEVELS = ("joint_positive", "joint_negative", "motor_positive", "motor_negative")


@dataclass(frozen=True, eq=False)
class CoulombFriction(LinearTerm):
    """Constant torque along the motion of a joint or of a motor.

    Friction at a motor acts on every joint that the motor moves: the elbow's
    lives at q2 + q3. Below the transition velocity it rises linearly, so that a
    command does not jump when the motion reverses.

    Attributes:
        arm: The arm, for its transmission.
        joint_positive: (n,) N·m while the joint moves up.
        joint_negative: (n,) N·m while the joint moves down (also counted positive).
        motor_positive: (n,) N·m at the motor while it turns up.
        motor_negative: (n,) N·m at the motor while it turns down.
        transition_velocity: (n,) rad/s; 0 makes it a sign function.
    """

    NAME = "coulomb_friction"
    REMEDY = "if it is new, look at {joint}'s cables, bearings and brake"
    TITLE = "Coulomb friction"
    MEANINGS = meanings(
        positive=size("N·m", MORE, "moving up"), negative=size("N·m", MORE, "moving down"),
    )  # fmt: skip
    FRICTION = True
    EVERYWHERE = True

    arm: Arm
    joint_positive: Array
    joint_negative: Array
    motor_positive: Array
    motor_negative: Array
    transition_velocity: Array

    @classmethod
    def meaning(cls, name: str) -> Meaning:
        """See :meth:`Effect.meaning`; factors are of some kind of friction, or all of it."""
        if name.endswith(FACTOR):
            label = f"{name.replace('_', ' ')}, all joints"
            return Meaning("", 1.0, MORE, label, percent=True)
        return super().meaning(name)

    @classmethod
    def schema(cls, arm: Arm) -> tuple[Parameter, ...]:
        """See :meth:`Term.schema`."""
        declared = (
            ("joint_positive", "N·m", "at the joint, moving up"),
            ("joint_negative", "N·m", "at the joint, moving down"),
            ("motor_positive", "N·m", "at the motor, turning up"),
            ("motor_negative", "N·m", "at the motor, turning down"),
            ("transition_velocity", "rad/s", "friction full from there"),
        )
        return joint_arrays(arm, cls.NAME, declared, lower=0.0)

    @classmethod
    def from_parameters(cls, arm: Arm, values: Mapping[str, Value]) -> CoulombFriction | None:
        """See :meth:`Term.from_parameters`; a direction that is not given equals the other."""
        n = arm.n
        levels = {}
        for kind in ("joint", "motor"):
            up = values.get(f"{cls.NAME}.{kind}_positive") or ()
            down = values.get(f"{cls.NAME}.{kind}_negative") or ()
            levels[f"{kind}_positive"] = as_array(up or down, n, 0.0)
            levels[f"{kind}_negative"] = as_array(down or up, n, 0.0)
        if not any(level.any() for level in levels.values()):
            return None
        transition = as_array(values.get(f"{cls.NAME}.transition_velocity"), n, 0.02)
        return cls(arm, **levels, transition_velocity=transition)

    @classmethod
    def nominal(cls, arm: Arm) -> CoulombFriction:
        """See :meth:`Term.nominal`: at the joints."""
        level, nothing = SUPPOSED.coulomb * arm.effort_limit, np.zeros(arm.n)
        return cls(arm, level, level, nothing, nothing, 0.02 * arm.scale)

    @classmethod
    def stated(cls, arm: Arm) -> CoulombFriction | None:
        """See :meth:`Term.stated`: the friction of a URDF's joints."""
        level, nothing = np.array([joint.friction for joint in arm.joints]), np.zeros(arm.n)
        return cls(arm, level, level, nothing, nothing, 0.02 * arm.scale) if level.any() else None

    def parameters(self) -> dict[str, Value]:
        """See :meth:`Term.parameters`."""
        values: dict[str, Value] = {}
        for kind in ("joint", "motor"):
            # Both or none: one alone would stand for both.
            levels = {name: getattr(self, name) for name in _LEVELS if name.startswith(kind)}
            if any(level.any() for level in levels.values()):
                values |= {f"{self.NAME}.{name}": as_value(v) for name, v in levels.items()}
        return values | {f"{self.NAME}.transition_velocity": as_value(self.transition_velocity)}

    @property
    def full_speed(self) -> Array:
        """See :meth:`Term.full_speed`."""
        return self.transition_velocity

    def torque(self, state: State) -> Array:
        """Return (…, n) friction torques, N·m; zero where no motion is known."""
        if state.direction is not None:  # no speed: friction is full
            motion, slope = state.direction, _SIGN
        elif state.qd is not None:
            motion, slope = state.qd, self._slope
        else:
            return np.zeros(state.q.shape)
        torque = _level(motion, slope, self.joint_positive, self.joint_negative)
        if self._at_motors:
            motor = self.arm.actuator_position(motion)
            torque += self.arm.joint_effort(
                _level(motor, slope, self.motor_positive, self.motor_negative)
            )
        return torque

    def scaled(self, part: Array) -> CoulombFriction:
        """See :meth:`Term.scaled`."""
        return replace(self, **{name: part * getattr(self, name) for name in _LEVELS})

    def prepare(self) -> Evaluator:
        """See :meth:`Term.prepare`."""
        # Joints and motors side by side, motion upwards and downwards one above the other.
        n = len(self.joint_positive)
        motion = np.vstack([np.eye(n), self.arm.joint_to_actuator])
        slope = np.tile(self._slope, 2)
        lower = np.repeat([[0.0], [-1.0]], 2 * n, axis=1)
        upwards = np.concatenate([self.joint_positive, self.motor_positive])
        downwards = np.concatenate([self.joint_negative, self.motor_negative])
        spread = np.diag(np.concatenate([upwards, downwards])) @ np.vstack([motion, motion])

        def evaluate(q: Array, qd: Array | None) -> Array:
            if qd is None:
                return np.zeros(n)
            part = np.minimum(np.maximum(motion.dot(qd) * slope, lower), lower + 1.0)
            return part.ravel().dot(spread)

        return evaluate

    def plant(self) -> PlantPart:
        """See :meth:`Term.plant`: its levels; the transition is a compensator's caution."""
        up = np.concatenate([self.joint_positive, self.motor_positive])
        down = np.concatenate([self.joint_negative, self.motor_negative])
        return PlantPart(dry=np.array([up, down]))

    @classmethod
    def moves(cls, table: ColumnTable, inside: set[int]) -> Iterator[ModelChange]:
        """See :meth:`LinearTerm.moves`."""
        for joint in range(table.arm.n):
            for kind in friction_site_kinds(table.arm, joint):
                here = tuple(table.select(effect=cls.NAME, site_kind=kind, joint=joint))
                text = f"{cls.NAME} {where(table.arm, joint, kind)}"
                if here[0] in inside:
                    yield ModelChange((), here, f"without {text}")
                else:
                    yield ModelChange(here, (), text)
        yield from moves_between(cls.NAME, table, inside)

    @classmethod
    def plainest(cls, table: ColumnTable) -> list[int]:
        """See :meth:`LinearTerm.plainest`: at every joint or, where it is likelier, its motor."""
        return likely_columns(cls.NAME, table)

    @property
    def theta(self) -> Array:
        """See :meth:`LinearTerm.theta`: joint up, joint down, motor up, motor down."""
        return np.concatenate([getattr(self, name) for name in _LEVELS])

    def with_theta(self, theta: Array) -> CoulombFriction:
        """See :meth:`LinearTerm.with_theta`."""
        up, down, motor_up, motor_down = np.reshape(theta, (4, -1))
        return CoulombFriction(self.arm, up, down, motor_up, motor_down, self.transition_velocity)

    @classmethod
    def unknowns(cls, arm: Arm, valid: Range) -> Unknowns:
        """See :meth:`LinearTerm.unknowns`.

        The same upwards and downwards: a difference is a constant, which is a column of another.
        """
        nothing = np.zeros(arm.n)
        term = cls(arm, *(nothing,) * 4, transition_velocity=_TRANSITION * arm.scale)
        columns = [
            column
            for kind in (Kind.JOINT, Kind.MOTOR)
            for column in site_columns(
                cls.NAME, kind, PRIOR_FRACTION * effort_of_motor(arm, kind), 0, True, "N·m"
            )
        ]
        basis = np.kron(np.eye(2), np.tile(np.eye(arm.n), (2, 1)))
        return Unknowns(term, tuple(columns), basis.astype(float))

    def regressor(self, state: State) -> Array:
        """See :meth:`LinearTerm.regressor`."""
        if state.direction is not None:
            motion, slope = state.direction, _SIGN
        elif state.qd is not None:
            motion, slope = state.qd, self._slope
        else:
            return np.zeros((*state.q.shape, len(self.theta)))
        joint = np.clip(motion * slope, -1.0, 1.0)
        motor = np.clip(self.arm.actuator_position(motion) * slope, -1.0, 1.0)
        columns = [
            diagonal_columns(np.maximum(joint, 0.0)),
            diagonal_columns(np.minimum(joint, 0.0)),
            motor_columns(self.arm, np.maximum(motor, 0.0)),
            motor_columns(self.arm, np.minimum(motor, 0.0)),
        ]
        return np.concatenate(columns, axis=-1)

    @classmethod
    def hypotheses(cls, motion: Motion) -> Iterator[Hypothesis]:
        """See :meth:`Effect.hypotheses`; of poses only where their direction is known."""
        if motion.static and motion.direction is None:
            return
        for friction_site in friction_sites(motion):
            setting: dict[str, float] = {}
            if not motion.static:
                setting["transition"] = motion.slowest(friction_site.row(motion.arm))
            sign = motion.sign(friction_site.row(motion.arm), setting.get("transition"))
            most = removable(motion, friction_site, sign)
            for one_level in (True, False):
                yield CoulombHypothesis(
                    arm=motion.arm, site=friction_site, joints=(friction_site.index,),
                    setting=setting, refine=tuple(setting), one_level=one_level, removable=most,
                )  # fmt: skip
        yield from AllFrictionHypothesis.of(motion)

    def at(self, where: Site) -> float:
        """Return the larger level at a site, N·m; at a joint its motor's is felt as well."""
        motor = max(self.motor_positive[where.index], self.motor_negative[where.index])
        if where.kind is Kind.MOTOR:
            return float(motor)
        joint = max(self.joint_positive[where.index], self.joint_negative[where.index])
        return float(joint + motor)

    @cached_property
    def _at_motors(self) -> bool:
        return bool(self.motor_positive.any() or self.motor_negative.any())

    @cached_property
    def _slope(self) -> Array:
        return 1.0 / np.maximum(self.transition_velocity, 1.0 / _SIGN)


def _level(motion: Array, slope: Array, positive: Array, negative: Array) -> Array:
    blend = np.clip(motion * slope, -1.0, 1.0)
    return np.where(blend > 0, positive, negative) * blend


@dataclass(frozen=True, eq=False, kw_only=True)
class CoulombHypothesis(Hypothesis):
    """Coulomb friction that is whole from a speed on; of poses, whole.

    Attributes:
        one_level: The same in both directions.
    """

    EFFECT = CoulombFriction

    one_level: bool
    variable: str = "velocity"
    directed: bool = True

    @property
    def unrestricted(self) -> CoulombHypothesis | None:
        """See :meth:`Hypothesis.unrestricted`: a level for each direction."""
        return replace(self, one_level=False) if self.one_level else None

    def regressor(self, motion: Motion) -> Array:
        """See :meth:`Hypothesis.regressor`."""
        row = self.site.row(self.arm)
        sign = motion.sign(row, self.setting.get("transition"))
        if self.one_level:
            return spread(row, sign)
        return spread(row, np.maximum(sign, 0.0), np.minimum(sign, 0.0))

    def parameters(self, theta: Array) -> dict[str, float]:
        """See :meth:`Hypothesis.parameters`."""
        return {"positive": float(theta[0]), "negative": float(theta[-1])}

    def plausible(self, theta: Array) -> bool:
        """Tell whether it is friction: driving one way and braking the other is an offset."""
        up, down = float(theta[0]), float(theta[-1])
        offset = up * down < 0.0 and min(abs(up), abs(down)) > _DRIVES * max(abs(up), abs(down))
        return not offset and super().plausible(theta)

    def merge(self, values: Values, theta: Array, motion: Motion) -> Values:
        """See :meth:`Hypothesis.merge`."""
        del motion
        return with_coulomb(self.arm, values, self.site, theta)

    def claim(self, parameters: Mapping[str, Estimate]) -> str:
        """See :meth:`Hypothesis.claim`."""
        where, told = self.site.words(self.arm), self._in_words(parameters)
        up, down = (parameters[name] for name in ("positive", "negative"))
        if up == down:
            return f"{where} has {told['positive']} Coulomb friction than {self.against}"
        if up.value * down.value > 0.0 and not (up.doubtful(0.0) or down.doubtful(0.0)):
            levels = f"{up.magnitude.shown} moving up, {down.magnitude.shown} moving down"
            way = MORE[up.value < 0.0]
            return f"{where} has {way} Coulomb friction than {self.against}: {levels}"
        levels = f"{told['positive']} moving up, {told['negative']} moving down"
        return f"{where} has another Coulomb friction than {self.against}: {levels}"


@dataclass(frozen=True, eq=False, kw_only=True)
class AllFrictionHypothesis(AllFriction):
    """Friction of every kind: Coulomb's is most of it, and lends its name."""

    EFFECT = CoulombFriction


def with_coulomb(arm: Arm, values: Values, where: Site, levels: Array) -> dict[str, Any]:
    """Return a model's parameters with more Coulomb friction, up and down, none below zero."""
    prefix, index = f"{CoulombFriction.NAME}.{where.kind.value}", where.index
    up = array(arm, values, f"{prefix}_positive", f"{prefix}_negative")
    down = array(arm, values, f"{prefix}_negative", f"{prefix}_positive")
    up[index] = max(0.0, up[index] + levels[0])
    down[index] = max(0.0, down[index] + levels[-1])
    return {
        **values,
        f"{prefix}_positive": tuple(up.tolist()),
        f"{prefix}_negative": tuple(down.tolist()),
    }
