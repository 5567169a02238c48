"""Friction that is larger at rest and at low speed than at speed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.arrays import (
    Range,
    Values,
    as_array,
    as_value,
    joint_arrays,
    number_array,
)
from dvrk_gravity.effects.base.effect import Hypothesis, spread
from dvrk_gravity.effects.base.friction import (
    Friction,
    columns_at_sites,
    friction_sites,
    moves_between,
    site_text,
    sites_of_columns,
    sites_with_friction,
    velocities,
)
from dvrk_gravity.effects.base.linear_term import (
    PRIOR_FRACTION,
    Column,
    ColumnTable,
    ModelChange,
    Unknowns,
    site_columns,
)
from dvrk_gravity.effects.base.meaning import Meaning, meanings
from dvrk_gravity.effects.base.motion import Motion, State
from dvrk_gravity.effects.base.site import effort_limits
from dvrk_gravity.effects.base.term import PlantPart
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.parameters import Parameter, Value

_SPEEDS = (0.12, 0.3, 0.7)  # of the RMS speed, from which the search begins
_SLOWEST = 1e-4  # rad/s, of a velocity that a level can have
# Speeds that identification chooses from, rad/s (Arm.scale). From 0.01 to 0.1 are usual
# (Armstrong-Hélouvry et al. 1994, table 1); a factor of three apart, a level between two is fitted
# to a tenth by the nearer one.
SPEEDS = (0.01, 0.03, 0.1, 0.3)
_TRANSITION = 0.003  # rad/s (Arm.scale), as of Coulomb friction that is identified


@dataclass(frozen=True, eq=False)
class StribeckFriction(Friction):
    """tau = level exp(-(v / velocity)^2) sign(v), in addition to Coulomb friction.

    The Gaussian form of the Stribeck effect (Armstrong-Hélouvry, Dupont and Canudas de Wit 1994,
    Automatica 30:7, equation 6 with an exponent of two). Like Coulomb friction it rises linearly
    up to the transition velocity; a pose that was approached and held has all of it.

    Attributes:
        arm: The arm, for its transmission.
        joint: (n,) levels at rest at the joints, N·m.
        motor: (n,) levels at rest at the motors, N·m.
        joint_velocity: (n,) speeds of the joints at which 1/e is left, rad/s.
        motor_velocity: (n,) speeds of the motors at which 1/e is left, rad/s.
        transition_velocity: (n,) rad/s; 0 makes it a sign function.
    """

    NAME = "stribeck_friction"
    REMEDY = "if it is new, look at {joint}'s lubrication and gear"
    BY_MOTION = True
    TITLE = "Stribeck friction"
    MEANINGS = meanings(
        level=Meaning("N·m", 0.0, label="greater at rest by", least=0.0),
        velocity=Meaning("rad/s", label="gone above about", least=0.0),
    )

    joint: Array
    motor: Array
    joint_velocity: Array
    motor_velocity: Array
    transition_velocity: Array

    @classmethod
    def schema(cls, arm: Arm) -> tuple[Parameter, ...]:
        declared = (
            ("joint", "N·m", "level at rest, at the joint"),
            ("motor", "N·m", "level at rest, at the motor"),
            ("joint_velocity", "rad/s", "the joint's speed that leaves 1/e"),
            ("motor_velocity", "rad/s", "the motor's speed that leaves 1/e"),
            ("transition_velocity", "rad/s", "sign complete from there"),
        )
        return joint_arrays(arm, cls.NAME, declared, lower=0.0)

    @classmethod
    def from_parameters(cls, arm: Arm, values: Mapping[str, Value]) -> StribeckFriction | None:
        """A level needs a velocity."""
        n = arm.n
        levels = {kind: as_array(values.get(f"{cls.NAME}.{kind}"), n, 0.0) for kind in cls.LEVELS}
        if not any(level.any() for level in levels.values()):
            return None
        speeds = {}
        for kind, level in levels.items():
            name = f"{cls.NAME}.{kind}_velocity"
            speeds[f"{kind}_velocity"] = speed = as_array(values.get(name), n, 0.0)
            for index in np.flatnonzero((level > 0.0) & (speed < _SLOWEST)).tolist():
                raise ConfigError(
                    f"{name} of {arm.joint_names[index]}",
                    float(speed[index]),
                    f"at least {_SLOWEST:g} rad/s beside a level of {level[index]:g} N·m",
                )
        transition = as_array(values.get(f"{cls.NAME}.transition_velocity"), n, 0.02)
        return cls(arm, **levels, **speeds, transition_velocity=transition)

    def parameters(self) -> dict[str, Value]:
        used = [kind for kind in self.LEVELS if getattr(self, kind).any()]
        names = [name for kind in used for name in (kind, f"{kind}_velocity")]
        names.append("transition_velocity")
        return {f"{self.NAME}.{name}": as_value(getattr(self, name)) for name in names}

    @property
    def full_speed(self) -> Array:
        return self.transition_velocity

    def torque(self, state: State) -> Array:
        """Return (…, n) friction torques, N·m; zero where no motion is known."""
        joint, motor = self._per_level(state)
        return self.joint * joint + self.arm.joint_effort(self.motor * motor)

    def regressor(self, state: State) -> Array:
        return columns_at_sites(self.arm, *self._per_level(state))

    def plant(self) -> PlantPart:
        """The levels, and the fraction that a velocity leaves of them."""
        level = np.concatenate([self.joint, self.motor])
        motion = np.vstack([np.eye(len(self.joint)), self.arm.joint_to_actuator])
        motion *= np.concatenate(self._inverse)[:, None]

        def fade(qd: Array) -> Array:
            ratio = motion.dot(qd)
            return np.exp(-ratio * ratio)

        return PlantPart(dry=np.array([level, level]), fade=fade)

    def _per_level(self, state: State) -> tuple[Array, Array]:
        """Return (…, n) torques per level at the joints and at the motors."""
        motion = velocities(self.arm, state)
        if motion is None:
            return np.zeros(state.q.shape), np.zeros(state.q.shape)
        if state.direction is not None:
            return np.sign(motion[0]), np.sign(motion[1])
        slope = 1.0 / np.maximum(self.transition_velocity, 1e-9)
        joint, motor = (
            np.clip(v * slope, -1.0, 1.0) * np.exp(-((v * inverse) ** 2))
            for v, inverse in zip(motion, self._inverse, strict=True)
        )
        return joint, motor

    @cached_property
    def _inverse(self) -> tuple[Array, Array]:
        """1 / velocity at the joints and at the motors; 0 where there is none, nor a level."""
        joint, motor = (
            np.divide(1.0, speed, out=np.zeros(speed.shape), where=speed >= _SLOWEST)
            for speed in (self.joint_velocity, self.motor_velocity)
        )
        return joint, motor

    @classmethod
    def unknowns(cls, arm: Arm, valid: Range) -> Unknowns:
        """One level at each site, that falls within one of :data:`SPEEDS`."""
        sites = sites_with_friction(arm)
        columns = [
            column
            for index in range(len(SPEEDS))
            for kind in cls.SITES
            for column in site_columns(
                cls.NAME, kind, PRIOR_FRACTION * effort_limits(arm, kind), index, True, "N·m"
            )
            if column.site in sites
        ]
        nothing, scale = np.zeros(arm.n), arm.scale
        term = cls(arm, nothing, nothing, scale, scale, _TRANSITION * scale)
        return StribeckUnknowns(term, tuple(columns))

    @classmethod
    def moves(cls, table: ColumnTable, inside: set[int]) -> Iterator[ModelChange]:
        """Add a level where there is none, remove it, and exchange its speed."""
        for joint, kind in sites_of_columns(table.arm):
            here = table.select(effect=cls.NAME, site_kind=kind, joint=joint)
            chosen = tuple(index for index in here if index in inside)
            text = f"{cls.NAME} {site_text(table.arm, joint, kind)}"
            if chosen:
                yield ModelChange((), chosen, f"without {text}")
            for index, speed in zip(here, SPEEDS, strict=True):
                if index not in inside:
                    yield ModelChange((index,), chosen, f"{text}, {speed:g} rad/s")
        yield from moves_between(cls.NAME, table, inside)

    @classmethod
    def coefficient_name(cls, arm: Arm, column: Column) -> str:
        speed = f"{SPEEDS[column.index]:g} {column.site.unit(arm, 'rad/s')}"
        return f"{super().coefficient_name(arm, column)} within {speed}"

    @classmethod
    def hypotheses(cls, motion: Motion) -> Iterator[Hypothesis]:
        for site in () if motion.static else friction_sites(motion):
            row = site.row(motion.arm)
            # A joint may be displaced without a speed that its encoder shows.
            speed = max(float(np.sqrt(np.mean((motion.qd @ row) ** 2))), motion.slowest(row))
            for part in _SPEEDS:
                setting = {"velocity": part * speed}
                yield StribeckHypothesis(arm=motion.arm, site=site, setting=setting)


@dataclass(frozen=True, eq=False)
class StribeckUnknowns(Unknowns):
    """Levels of several speeds at each site, of which the model has the largest one's speed."""

    term: StribeckFriction

    def regressor(self, state: State, memory: Array) -> Array:
        """Return (N, n, p) torques of all columns at (N, n) states."""
        found = np.zeros((*state.q.shape, len(self.columns)))
        for number, speed in enumerate(SPEEDS):
            own = [i for i, column in enumerate(self.columns) if column.index == number]
            found[..., own] = self._at(speed).regressor(state)[..., self._places(own)]
        return found

    def found(self, coefficients: Array) -> StribeckFriction | None:
        """Return the term with (p,) coefficients of the fit, ``None`` if all are zero."""
        if not coefficients.any():
            return None
        level = np.zeros(2 * self.term.arm.n)
        largest, speed = np.zeros(level.shape), np.full(level.shape, SPEEDS[0])
        places = self._places(range(len(self.columns)))
        for place, column, value in zip(places, self.columns, coefficients, strict=True):
            level[place] += value
            if abs(value) > largest[place]:
                largest[place], speed[place] = abs(value), SPEEDS[column.index]
        joint, motor = np.split(speed * np.tile(self.term.arm.scale, 2), 2)
        return replace(self.term, joint_velocity=joint, motor_velocity=motor).with_theta(level)

    def _at(self, speed: float) -> StribeckFriction:
        wide = speed * self.term.arm.scale
        return replace(self.term, joint_velocity=wide, motor_velocity=wide)

    def _places(self, columns: Iterable[int]) -> list[int]:
        """Return the places of columns in the term's theta."""
        n, sites = self.term.arm.n, (self.columns[i].site for i in columns)
        return [n * StribeckFriction.SITES.index(site.kind) + site.index for site in sites]


@dataclass(frozen=True, eq=False, kw_only=True)
class StribeckHypothesis(Hypothesis):
    """Friction falls with speed, at a joint or a motor."""

    EFFECT = StribeckFriction
    CLAIM = (
        "friction of {where} is {level} greater at rest than at speed, "
        "and falls within about {velocity}"
    )

    refine: tuple[str, ...] = ("velocity",)
    variable: str = "velocity"
    n_comparisons: int = len(_SPEEDS)

    def regressor(self, motion: Motion) -> Array:
        row = self.site.row(self.arm)
        ratio = (motion.qd @ row) / self.setting["velocity"]
        return spread(row, motion.sign(row) * np.exp(-(ratio**2)))

    def parameters(self, theta: Array) -> dict[str, float]:
        return {"level": float(theta[0]), "velocity": self.setting["velocity"]}

    def merge(self, values: Values, theta: Array, motion: Motion) -> Values | None:
        """``None`` if the site has a level already."""
        name, index = f"{self.effect}.{self.site.kind.value}", self.site.index
        level, speed = (number_array(self.arm, values, key) for key in (name, f"{name}_velocity"))
        if level[index] > 0.0 or theta[0] < 0.0:
            return None
        level[index], speed[index] = theta[0], self.setting["velocity"]
        return {**values, name: as_value(level), f"{name}_velocity": as_value(speed)}
