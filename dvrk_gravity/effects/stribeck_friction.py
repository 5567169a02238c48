"""Friction that is larger at rest and at low speed than at speed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.arrays import Values, as_array, as_value, joint_arrays
from dvrk_gravity.effects.base.dry_friction import BUILT_UP, TRANSITION, DryFriction
from dvrk_gravity.effects.base.effect import Hypothesis, spread
from dvrk_gravity.effects.base.friction import columns_at_sites, friction_sites, velocities
from dvrk_gravity.effects.base.linear_term import Unknowns
from dvrk_gravity.effects.base.meaning import Meaning, meanings
from dvrk_gravity.effects.base.motion import Motion, State
from dvrk_gravity.effects.base.polynomials import Range
from dvrk_gravity.effects.base.term import Evaluator, PlantPart
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.parameters import Parameter, Value

_SPEEDS = (0.12, 0.3, 0.7)  # of the RMS speed, from which the search begins
_SLOWEST = 1e-4  # rad/s, of a velocity that a level can have
# rad (Arm.scale), over which it builds up when it is identified. Chosen: of friction that builds up
# over 2 mrad, 1 to 6 mrad leave 1.2 times the error that 2 do; none leaves 3 times.
_BUILDS_UP = 0.003
_GONE = 40.0  # exp(-40) is below a double's precision


@dataclass(frozen=True, eq=False)
class StribeckFriction(DryFriction):
    """tau = level exp(-(v / velocity)^2) sign(v), in addition to Coulomb friction.

    The Gaussian form of the Stribeck effect (Armstrong-Hélouvry, Dupont and Canudas de Wit 1994,
    Automatica 30:7, equation 6 with an exponent of two). Like Coulomb friction it rises linearly
    up to the transition velocity; a pose that was approached and held has all of it.

    After a reversal it builds up, where it has a displacement, as Coulomb friction does.

    Attributes:
        arm: The arm, for its transmission.
        joint: (n,) levels at rest at the joints, N·m.
        motor: (n,) levels at rest at the motors, N·m.
        joint_velocity: (n,) speeds of the joints at which 1/e is left, rad/s.
        motor_velocity: (n,) speeds of the motors at which 1/e is left, rad/s.
        transition_velocity: (n,) rad/s; 0 makes it a sign function.
        joint_displacement: (n,) rad over which it builds up at the joints.
        motor_displacement: (n,) rad over which it builds up at the motors.
    """

    NAME = "stribeck_friction"
    REMEDY = "if it is new, look at {joint}'s lubrication and gear"
    TITLE = "Stribeck friction"
    MEANINGS = meanings(
        level=Meaning("N·m", 0.0, label="greater at rest by", least=0.0),
        velocity=Meaning("rad/s", label="gone above about", least=0.0),
    )
    SETTING = "velocity"
    SETTING_UNIT = "rad/s"
    SETTING_TEXT = "within"
    # From 0.01 to 0.1 are usual (Armstrong-Hélouvry et al. 1994, table 1).
    SETTINGS = (0.01, 0.022, 0.046, 0.1)

    joint: Array
    motor: Array
    joint_velocity: Array
    motor_velocity: Array
    transition_velocity: Array
    joint_displacement: Array
    motor_displacement: Array

    @classmethod
    def schema(cls, arm: Arm) -> tuple[Parameter, ...]:
        declared = (
            ("joint", "N·m", "level at rest, at the joint"),
            ("motor", "N·m", "level at rest, at the motor"),
            ("joint_velocity", "rad/s", "the joint's speed that leaves 1/e"),
            ("motor_velocity", "rad/s", "the motor's speed that leaves 1/e"),
            ("transition_velocity", "rad/s", "sign complete from there"),
            ("joint_displacement", "rad", f"at the joint, {BUILT_UP}"),
            ("motor_displacement", "rad", f"at the motor, {BUILT_UP}"),
        )
        return joint_arrays(arm, cls.NAME, declared, lower=0.0)

    @classmethod
    def from_parameters(cls, arm: Arm, values: Mapping[str, Value]) -> StribeckFriction | None:
        """A level needs a velocity."""
        n = arm.n
        levels = [as_array(values.get(f"{cls.NAME}.{kind}"), n, 0.0) for kind in cls.COEFFICIENTS]
        if not any(level.any() for level in levels):
            return None
        speeds: list[Array] = []
        for kind, level in zip(cls.COEFFICIENTS, levels, strict=True):
            name = f"{cls.NAME}.{kind}_velocity"
            speed = as_array(values.get(name), n, 0.0)
            # A level that is fitted later, where none is now, falls within the least speed.
            speeds.append(np.where(speed > 0.0, speed, cls.SETTINGS[0] * arm.scale))
            for index in np.flatnonzero((level > 0.0) & (speed < _SLOWEST)).tolist():
                raise ConfigError(
                    f"{name} of {arm.joint_names[index]}",
                    float(speed[index]),
                    f"at least {_SLOWEST:g} rad/s beside a level of {level[index]:g} N·m",
                )
        transition = as_array(values.get(f"{cls.NAME}.transition_velocity"), n, 0.02)
        lengths = cls.displacements(arm, values)
        return cls(arm, levels[0], levels[1], speeds[0], speeds[1], transition, *lengths)

    def parameters(self) -> dict[str, Value]:
        used = [kind for kind in self.COEFFICIENTS if getattr(self, kind).any()]
        names = [name for kind in used for name in (kind, f"{kind}_velocity")]
        names.append("transition_velocity")
        values: dict[str, Value] = {
            f"{self.NAME}.{name}": as_value(getattr(self, name)) for name in names
        }
        return values | self.displacement_parameters(used)

    def torque(self, state: State) -> Array:
        """Return (…, n) friction torques, N·m; zero where no motion is known."""
        joint, motor = self._per_level(state, self.past(state))
        return self.joint * joint + self.arm.joint_effort(self.motor * motor)

    def columns(self, state: State, memory: Array) -> Array:
        return columns_at_sites(self.arm, *self._per_level(state, memory))

    def prepare(self) -> Evaluator:
        # Joints and motors side by side.
        motion = np.vstack([np.eye(self.arm.n), self.arm.joint_to_actuator])
        ramp = np.tile(self._slope, 2)[:, None] * motion
        fall = np.concatenate(self._inverse)[:, None] * motion
        spread = np.concatenate([self.joint, self.motor])[:, None] * motion

        def evaluate(q: Array, qd: Array | None) -> Array:
            if qd is None:
                return np.zeros(len(q))
            ways, ratio = np.minimum(np.maximum(ramp.dot(qd), -1.0), 1.0), fall.dot(qd)
            return (ways * np.exp(-ratio * ratio)).dot(spread)

        return evaluate

    def plant(self) -> PlantPart:
        """The levels, and the fraction that a velocity leaves of them."""
        level = np.concatenate([self.joint, self.motor])
        motion = np.vstack([np.eye(len(self.joint)), self.arm.joint_to_actuator])
        motion *= np.concatenate(self._inverse)[:, None]

        def fade(qd: Array) -> Array:
            ratio = motion.dot(qd)
            return np.exp(-ratio * ratio)

        return PlantPart(dry=np.array([level, level]), fade=fade)

    def _per_level(self, state: State, memory: Array | None) -> tuple[Array, Array]:
        """Return (…, n) torques per level at the joints and at the motors."""
        ways, motion = self.ways(state, memory), velocities(self.arm, state)
        if ways is None or motion is None:
            return np.zeros(state.q.shape), np.zeros(state.q.shape)
        if state.direction is not None:
            return ways
        joint, motor = (
            way * _decay((v * inverse) ** 2)
            for way, v, inverse in zip(ways, motion, self._inverse, strict=True)
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
        """One level at each site, which builds up as the friction of gears does."""
        nothing, length = np.zeros(arm.n), _BUILDS_UP * arm.scale
        term = cls(arm, *(nothing,) * 4, TRANSITION * arm.scale, length, length)
        return cls.for_settings(term, np.eye(2 * arm.n))

    @classmethod
    def hypotheses(cls, motion: Motion) -> Iterator[Hypothesis]:
        for site in () if motion.static else friction_sites(motion):
            row = site.row(motion.arm)
            # A joint may be displaced without a speed that its encoder shows.
            speed = max(float(np.sqrt(np.mean((motion.qd @ row) ** 2))), motion.slowest(row))
            for part in _SPEEDS:
                setting = {"velocity": part * speed}
                yield StribeckHypothesis(arm=motion.arm, site=site, setting=setting)


def _decay(square: Array) -> Array:
    """Return exp(-square), zero below rounding: sums of denormal numbers are slow."""
    return np.where(square < _GONE, np.exp(-np.minimum(square, _GONE)), 0.0)


@dataclass(frozen=True, eq=False, kw_only=True)
class StribeckHypothesis(Hypothesis):
    """Friction falls with speed, at a joint or a motor."""

    EFFECT = StribeckFriction
    CLAIM = (
        "friction of {where} is {level} greater at rest than at speed, "
        "and falls within about {velocity}"
    )

    refine = ("velocity",)
    variable = "velocity"
    n_comparisons = len(_SPEEDS)

    def regressor(self, motion: Motion) -> Array:
        row = self.site.row(self.arm)
        ratio = (motion.qd @ row) / self.setting["velocity"]
        return spread(row, motion.sign(row) * np.exp(-(ratio**2)))

    def parameters(self, theta: Array) -> dict[str, float]:
        return {"level": float(theta[0]), "velocity": self.setting["velocity"]}

    def merge(self, values: Values, theta: Array, motion: Motion) -> Values | None:
        """``None`` if the site has a level already."""
        name, index = f"{self.effect}.{self.site.kind.value}", self.site.index
        level, speed = (
            as_array(values.get(key), self.arm.n, 0.0) for key in (name, f"{name}_velocity")
        )
        if level[index] > 0.0 or theta[0] < 0.0:
            return None
        level[index], speed[index] = theta[0], self.setting["velocity"]
        return {**values, name: as_value(level), f"{name}_velocity": as_value(speed)}
