"""Coulomb friction, at the joints and at the motors, possibly different by direction."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.arrays import Values, as_array, as_value, joint_arrays
from dvrk_gravity.effects.base.column import Column
from dvrk_gravity.effects.base.dahl import DahlElements, dahl_of_parts
from dvrk_gravity.effects.base.dry_friction import BUILT_UP, TRANSITION, DryFriction
from dvrk_gravity.effects.base.effect import Hypothesis, remedy_text, spread
from dvrk_gravity.effects.base.friction import columns_at_sites, friction_sites, removable
from dvrk_gravity.effects.base.joint_dynamics import JointDynamics
from dvrk_gravity.effects.base.linear_term import LinearTerm, Unknowns
from dvrk_gravity.effects.base.meaning import MORE, Estimate, Meaning, Words, meanings, size
from dvrk_gravity.effects.base.motion import Motion, State
from dvrk_gravity.effects.base.polynomials import Range
from dvrk_gravity.effects.base.site import THE_ARM, Kind, Site
from dvrk_gravity.effects.base.term import Evaluator, PlantPart
from dvrk_gravity.parameters import Parameter, Value

_FACTOR = "factor"
_NONE = -0.05  # of friction, by which an estimate of none may scatter. Chosen
_DRIVES = 0.3  # of the larger level, within which the smaller may be below zero by chance
# Of a joint's largest effort, unmeasured. Chosen: what static poses of a real MTM leave of its
# calibrated model, mostly dry friction, is 0.004 to 0.19 of its joints' limits, RMS.
_NOMINAL = 0.02


@dataclass(frozen=True, eq=False)
class CoulombFriction(DryFriction):
    """Constant torque along the motion of a joint or of a motor.

    Friction at a motor acts on every joint that the motor moves: the elbow's is at q2 + q3. Below
    the transition velocity it rises linearly, so that a command does not jump when the motion
    reverses.

    Attributes:
        arm: The arm, for its transmission.
        joint_positive: (n,) N·m while the joint moves up.
        joint_negative: (n,) N·m while the joint moves down (also counted positive).
        motor_positive: (n,) N·m at the motor while it turns up.
        motor_negative: (n,) N·m at the motor while it turns down.
        transition_velocity: (n,) rad/s; 0 makes it a sign function.
        joint_displacement: (n,) rad over which it builds up at the joints.
        motor_displacement: (n,) rad over which it builds up at the motors.
    """

    NAME = "coulomb_friction"
    COEFFICIENTS = ("joint_positive", "joint_negative", "motor_positive", "motor_negative")
    REMEDY = "if it is new, look at {joint}'s cables, bearings and brake"
    TITLE = "Coulomb friction"
    MEANINGS = meanings(
        positive=size("N·m", MORE, "moving up"), negative=size("N·m", MORE, "moving down"),
    )  # fmt: skip
    EVERYWHERE = True
    IN_FILES = ("console", "urdf", "mjcf")
    SETTING = "displacement"
    SETTING_UNIT = "rad"
    SETTING_TEXT = "over"
    # Gears give by 1 or 2 mrad (docs/identification.md); longer ones are elements of presliding.
    SETTINGS = (0.0, 0.0005, 0.001, 0.002, 0.004)

    joint_positive: Array
    joint_negative: Array
    motor_positive: Array
    motor_negative: Array
    transition_velocity: Array
    joint_displacement: Array
    motor_displacement: Array

    @classmethod
    def meaning(cls, name: str) -> Meaning:
        """Factors are those of :class:`AllFrictionHypothesis`."""
        if name.endswith(_FACTOR):
            label = f"{name.replace('_', ' ')}, all joints"
            return Meaning("", 1.0, MORE, label, percent=True)
        return super().meaning(name)

    @classmethod
    def schema(cls, arm: Arm) -> tuple[Parameter, ...]:
        declared = (
            ("joint_positive", "N·m", "at the joint, moving up"),
            ("joint_negative", "N·m", "at the joint, moving down"),
            ("motor_positive", "N·m", "at the motor, turning up"),
            ("motor_negative", "N·m", "at the motor, turning down"),
            ("transition_velocity", "rad/s", "friction full from there"),
            ("joint_displacement", "rad", f"at the joint, {BUILT_UP}"),
            ("motor_displacement", "rad", f"at the motor, {BUILT_UP}"),
        )
        return joint_arrays(arm, cls.NAME, declared, lower=0.0)

    @classmethod
    def from_parameters(cls, arm: Arm, values: Mapping[str, Value]) -> CoulombFriction | None:
        """A direction that is not given has the other's level."""
        n = arm.n
        levels: list[Array] = []
        for kind in ("joint", "motor"):
            up = values.get(f"{cls.NAME}.{kind}_positive") or ()
            down = values.get(f"{cls.NAME}.{kind}_negative") or ()
            levels += as_array(up or down, n, 0.0), as_array(down or up, n, 0.0)
        if not any(level.any() for level in levels):
            return None
        transition = as_array(values.get(f"{cls.NAME}.transition_velocity"), n, 0.02)
        lengths = cls.displacements(arm, values)
        return cls(arm, levels[0], levels[1], levels[2], levels[3], transition, *lengths)

    def parameters(self) -> dict[str, Value]:
        values: dict[str, Value] = {}
        used: list[str] = []
        for kind in ("joint", "motor"):
            # Both or none: one alone would stand for both.
            levels = {
                name: getattr(self, name) for name in self.COEFFICIENTS if name.startswith(kind)
            }
            if any(level.any() for level in levels.values()):
                used.append(kind)
                values |= {f"{self.NAME}.{name}": as_value(v) for name, v in levels.items()}
        values[f"{self.NAME}.transition_velocity"] = as_value(self.transition_velocity)
        return values | self.displacement_parameters(used)

    @classmethod
    def nominal(cls, arm: Arm) -> CoulombFriction:
        return cls._at_joints(arm, _NOMINAL * arm.effort_limit)

    @classmethod
    def from_arm(cls, arm: Arm) -> CoulombFriction | None:
        """The friction of a URDF's joints."""
        level = np.array([joint.friction for joint in arm.joints])
        return cls._at_joints(arm, level) if level.any() else None

    @classmethod
    def _at_joints(cls, arm: Arm, level: Array) -> CoulombFriction:
        nothing = np.zeros(arm.n)
        return cls(arm, level, level, nothing, nothing, 0.02 * arm.scale, nothing, nothing)

    def torque(self, state: State) -> Array:
        """Return (…, n) friction torques, N·m; zero where no motion is known."""
        signs = self.ways(state, self.past(state))
        if signs is None:
            return np.zeros(state.q.shape)
        joint, motor = signs
        torque = np.where(joint > 0, self.joint_positive, self.joint_negative) * joint
        if self._at_motors:
            level = np.where(motor > 0, self.motor_positive, self.motor_negative)
            torque += self.arm.joint_effort(level * motor)
        return torque

    def columns(self, state: State, memory: Array) -> Array:
        signs = self.ways(state, memory)
        if signs is None:
            return np.zeros((*state.q.shape, len(self.theta)))
        up, down = (
            columns_at_sites(self.arm, *(cut(sign, 0.0) for sign in signs))
            for cut in (np.maximum, np.minimum)
        )
        n = self.arm.n
        columns = (up[..., :n], down[..., :n], up[..., n:], down[..., n:])
        return np.concatenate(columns, axis=-1)

    def prepare(self) -> Evaluator:
        # Joints and motors side by side, motion upwards and downwards one above the other.
        n = len(self.joint_positive)
        motion = np.vstack([np.eye(n), self.arm.joint_to_actuator])
        ramp = np.tile(self._slope, 2)[:, None] * motion
        lower = np.repeat([[0.0], [-1.0]], 2 * n, axis=1)
        upper = lower + 1.0
        spread = np.diag(self._by_direction.ravel()) @ np.vstack([motion, motion])

        def evaluate(q: Array, qd: Array | None) -> Array:
            if qd is None:
                return np.zeros(n)
            part = np.minimum(np.maximum(ramp.dot(qd), lower), upper)
            return part.ravel().dot(spread)

        return evaluate

    def joint_dynamics(self, arm: Arm, q: Array) -> JointDynamics:
        """The mean of both directions."""
        up, down = self._by_direction
        return JointDynamics(
            arm, friction=0.5 * (up + down).reshape(2, -1), omits="its difference by direction",
            directions=lambda state: self.ways(state, self.past(state)),
        )  # fmt: skip

    def plant(self) -> PlantPart:
        """Its levels, the transition being a compensator's smoothing alone.

        Where they build up, and are the same in both directions, with a state.
        """
        level = self._by_direction
        gives = self._builds_up & (level[0] == level[1])
        joint, motor = np.split(np.diag(np.where(gives, level[0], 0.0)), 2, axis=1)
        length = np.where(gives, self.displacement.ravel(), 1.0)
        return PlantPart(
            dry=np.where(gives, 0.0, level),
            memory=DahlElements(self.arm, length, joint, motor) if gives.any() else None,
        )

    @cached_property
    def _by_direction(self) -> Array:
        """(2, 2 n) levels moving up and down, at the joints and at the motors."""
        up = np.concatenate([self.joint_positive, self.motor_positive])
        return np.array([up, np.concatenate([self.joint_negative, self.motor_negative])])

    @cached_property
    def _at_motors(self) -> bool:
        return bool(self.motor_positive.any() or self.motor_negative.any())

    @classmethod
    def unknowns(cls, arm: Arm, valid: Range) -> Unknowns:
        """The same in both directions: a difference is a constant, which another column has."""
        nothing = np.zeros(arm.n)
        term = cls(arm, *(nothing,) * 4, TRANSITION * arm.scale, nothing, nothing)
        return cls.for_settings(
            term, np.kron(np.eye(2), np.tile(np.eye(arm.n), (2, 1))).astype(float)
        )

    @classmethod
    def in_file(cls, form: str, column: Column) -> bool:
        """Of the console's a motor's is the same as presliding; elsewhere it is full at once."""
        held = column.site.kind is Kind.JOINT if form == "console" else not column.index
        return held and super().in_file(form, column)

    @classmethod
    def hypotheses(cls, motion: Motion) -> Iterator[Hypothesis]:
        """At each site with one level and with two; at poses if their direction is known."""
        if motion.static and motion.direction is None:
            return
        for site in friction_sites(motion):
            setting, gives = dict[str, float](), _displacement(motion, site)
            if not (motion.static or gives):
                setting["transition"] = motion.slowest(site.row(motion.arm))
            both = CoulombHypothesis(
                arm=motion.arm, site=site, setting=setting, one_level=False, gives=gives
            )
            both = replace(both, removable=removable(motion, site, both.way(motion)))
            yield from (replace(both, one_level=True), both)
        yield from AllFrictionHypothesis.of(motion)

    @classmethod
    def unit_changes(cls, motion: Motion) -> Iterator[tuple[Hypothesis, Array]]:
        """Of each joint, the same in both directions; a reference's has a step of its own."""
        for each in () if motion.measured_twice else cls.hypotheses(motion):
            if isinstance(each, CoulombHypothesis) and each.one_level and each.of_joint:
                yield each, np.ones(1)

    def at(self, where: Site) -> float:
        """Return the larger level at a site, N·m; at a joint its motor's is added."""
        motor = max(self.motor_positive[where.index], self.motor_negative[where.index])
        if where.kind is Kind.MOTOR:
            return float(motor)
        joint = max(self.joint_positive[where.index], self.joint_negative[where.index])
        return float(joint + motor)


@dataclass(frozen=True, eq=False, kw_only=True)
class CoulombHypothesis(Hypothesis):
    """The model's Coulomb friction at a joint or a motor is wrong.

    Attributes:
        one_level: The same in both directions.
        gives: Displacement over which the model's there builds up, rad, and so what it lacks.
    """

    EFFECT = CoulombFriction

    one_level: bool
    gives: float = 0.0
    variable = "velocity"

    @property
    def refine(self) -> tuple[str, ...]:
        return tuple(self.setting)

    @property
    def unrestricted(self) -> CoulombHypothesis | None:
        return replace(self, one_level=False) if self.one_level else None

    def way(self, motion: Motion) -> Array:
        """Return (N,) direction at its site, -1 to 1."""
        row = self.site.row(self.arm)
        sign = motion.sign(row, self.setting.get("transition"))
        if not self.gives:
            return sign
        return dahl_of_parts(motion.q @ row, self.gives, np.sign(sign), motion)

    def regressor(self, motion: Motion) -> Array:
        row, way = self.site.row(self.arm), self.way(motion)
        if self.one_level:
            return spread(row, way)
        return spread(row, np.maximum(way, 0.0), np.minimum(way, 0.0))

    def parameters(self, theta: Array) -> dict[str, float]:
        return {"positive": float(theta[0]), "negative": float(theta[-1])}

    def plausible(self, theta: Array) -> bool:
        """Driving one way and braking the other is an offset, and not friction."""
        up, down = float(theta[0]), float(theta[-1])
        offset = up * down < 0.0 and min(abs(up), abs(down)) > _DRIVES * max(abs(up), abs(down))
        return not offset and super().plausible(theta)

    def merge(self, values: Values, theta: Array, motion: Motion) -> Values:
        return with_coulomb(self.arm, values, self.site, theta)

    def _claim(self, parameters: Mapping[str, Estimate], words: Words) -> str:
        where = self.site.words(self.arm)
        up, down = (parameters[name] for name in ("positive", "negative"))
        if up == down:
            return f"{where} has {words['positive']} Coulomb friction than {self.against}"
        if up.value * down.value > 0.0 and not (up.doubtful(0.0) or down.doubtful(0.0)):
            levels = f"{up.magnitude.shown} moving up, {down.magnitude.shown} moving down"
            way = MORE[up.value < 0.0]
            return f"{where} has {way} Coulomb friction than {self.against}: {levels}"
        levels = f"{words['positive']} moving up, {words['negative']} moving down"
        return f"Coulomb friction of {where} differs from {self.against}'s: {levels}"


@dataclass(frozen=True, eq=False, kw_only=True)
class AllFrictionHypothesis(Hypothesis):
    """All friction of a model changed by a factor at every joint: warmth, an idle month.

    Joint by joint that takes as many causes as there are joints, and each alone explains less than
    one wrong cause that all of them share, a scale of all efforts, say. Most of it is Coulomb
    friction, which gives the finding its name.

    Attributes:
        divided: One factor for all (``""``), for each of its ``kinds``, or for each kind at each of
            the ``joints``.
        kinds: Effects that are its friction, by name.
        titles: The same for reports.
    """

    EFFECT = CoulombFriction

    divided: Literal["", "kinds", "joints"] = ""
    kinds: tuple[str, ...] = ()
    titles: tuple[str, ...] = ()
    variable = "velocity"

    @classmethod
    def of(cls, motion: Motion) -> Iterator[AllFrictionHypothesis]:
        """Yield hypotheses on all friction of an identified model: one factor, and one by kind."""
        rubs = np.flatnonzero(motion.friction.any(axis=0)).tolist()
        if motion.static or motion.model.of_file or len(rubs) < 2:
            return
        terms = [term for term in motion.model.terms if term.FRICTION]
        whole = cls(
            arm=motion.arm, site=THE_ARM, joints=tuple(rubs), form="all",
            kinds=tuple(term.NAME for term in terms),
            titles=tuple(term.title() for term in terms),
        )  # fmt: skip
        yield whole
        if len(terms) > 1:
            yield replace(whole, divided="kinds", form="all, by kind")

    @property
    def unrestricted(self) -> AllFrictionHypothesis | None:
        return None if self.divided == "joints" else replace(self, divided="joints", form="each")

    def regressor(self, motion: Motion) -> Array:
        if not self.divided:
            return motion.friction[:, :, None]
        state = motion.state_at(motion.true_q)
        terms = {term.NAME: term for term in motion.model.terms}
        kinds = np.stack([terms[kind].torque(state) for kind in self.kinds], axis=2)
        if self.divided == "kinds":
            return kinds
        pieces = kinds[:, :, :, None] * np.eye(self.arm.n)[:, None, self.joints]
        return pieces.reshape(*kinds.shape[:2], -1)

    def parameters(self, theta: Array) -> dict[str, float]:
        if self.divided == "joints":
            return {}  # it is compared with one factor, and never found
        factors = (1.0 + theta).tolist()
        if not self.divided:
            return {_FACTOR: factors[0]}
        return {f"{kind}_{_FACTOR}": each for kind, each in zip(self.kinds, factors, strict=True)}

    def plausible(self, theta: Array) -> bool:
        """Friction may vanish, but not drive the arm."""
        return bool((1.0 + theta >= _NONE).all())

    def _claim(self, parameters: Mapping[str, Estimate], words: Words) -> str:
        if not self.divided:
            return f"there is {words[_FACTOR]} friction than in {self.against}"
        named = [(f"{kind}_{_FACTOR}", t) for kind, t in zip(self.kinds, self.titles, strict=True)]
        sure = [(name, title) for name, title in named if not parameters[name].doubtful(1.0)]
        kinds = " and ".join(f"{words[name]} {title}" for name, title in sure or named)
        return f"there is {kinds} than in {self.against}"

    def remedy(self, carried: bool) -> str:
        return remedy_text(
            "if the arm is as warm as it was, look at what all joints share", carried
        )

    def merge(self, values: Values, theta: Array, motion: Motion) -> Values:
        """Scale the model's linear friction terms, none below zero."""
        changed = dict(values)
        by_kind = dict(zip(self.kinds, np.broadcast_to(theta, len(self.kinds)), strict=True))
        for term in motion.model.terms:
            if term.NAME not in by_kind or not isinstance(term, LinearTerm):
                continue
            had, factor = term.parameters(), max(1.0 + by_kind[term.NAME], 0.0)
            has = term.with_theta(factor * term.theta).parameters()
            for name, before in had.items():
                nothing = np.zeros(np.shape(before))  # levels that are zero are not in a file
                if has.get(name) != before:
                    more = np.asarray(has.get(name, nothing)) - np.asarray(before)
                    total = np.array(values.get(name, nothing), dtype=float)
                    # Another finding, an element of presliding say, may have appended to it.
                    total[: len(more)] += more
                    changed[name] = as_value(total)
        return changed


def _displacement(motion: Motion, site: Site) -> float:
    """Return over which displacement the model's friction at a site builds up, rad; 0: at once."""
    term = motion.model.term(CoulombFriction.NAME)
    if motion.static or not isinstance(term, CoulombFriction):
        return 0.0
    return float(getattr(term, f"{site.kind.value}_displacement")[site.index])


def with_coulomb(arm: Arm, values: Values, where: Site, levels: Array) -> Values:
    """Return a model's parameters with more Coulomb friction, up and down, none below zero."""
    prefix, index = f"{CoulombFriction.NAME}.{where.kind.value}", where.index
    had_up, had_down = (values.get(f"{prefix}_{way}") for way in ("positive", "negative"))
    up, down = as_array(had_up or had_down, arm.n, 0.0), as_array(had_down or had_up, arm.n, 0.0)
    up[index] = max(0.0, up[index] + levels[0])
    down[index] = max(0.0, down[index] + levels[-1])
    return {**values, f"{prefix}_positive": as_value(up), f"{prefix}_negative": as_value(down)}
