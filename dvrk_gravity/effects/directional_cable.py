"""Cable torque with a set for each direction of motion, as the dVRK console models it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.arrays import as_array, as_value, diagonal_columns, joint_arrays
from dvrk_gravity.effects.base.joint_dynamics import JointDynamics
from dvrk_gravity.effects.base.linear_term import LinearTerm
from dvrk_gravity.effects.base.motion import State
from dvrk_gravity.effects.base.polynomials import (
    Blend,
    JointPolynomials,
    Range,
    declare_coefficients,
    declare_range,
    evaluate,
    prepare_polynomials,
    prepare_powers,
    read_coefficients,
)
from dvrk_gravity.effects.base.term import Evaluator, PlantPart, Term
from dvrk_gravity.effects.elastic_cable import ElasticCable
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.parameters import Parameter, Value


@dataclass(frozen=True, eq=False)
class DirectionalCable(LinearTerm):
    """Positive and negative polynomials blended by velocity.

    tau = alpha p_pos(q) + (1 - alpha) p_neg(q), where alpha is 0.5 inside the dead
    band and goes to 0.5 +- 0.5 ratio at the saturation velocity, odd about 0.5 in
    the velocity: linearly (dVRK console, gravity compensation of an MTM, version
    2.0) or as a quarter of a sine (version 1.0, whose dead band is 0 and whose
    ratio is 1). A static pose approached in a known direction has alpha 1 or 0.

    Attributes:
        arm: The arm, for its joints' names.
        positive: (degree + 1, n) coefficients while moving up, N·m/rad^k.
        negative: (degree + 1, n) coefficients while moving down.
        valid: Range of positions on which they were fitted.
        blend: How the velocity chooses between them.
    """

    NAME = "directional_cable"
    COEFFICIENTS = ("positive", "negative")
    AT_POSES = True

    arm: Arm
    positive: Array
    negative: Array
    valid: Range
    blend: Blend

    @classmethod
    def schema(cls, arm: Arm) -> tuple[Parameter, ...]:
        name = cls.NAME
        blend = (
            ("dead_band", "rad/s", "both sets averaged below"),
            ("saturation_velocity", "rad/s", "blend full from there"),
            ("ratio", "", "part of the difference applied"),
        )
        return (
            *declare_coefficients(arm, f"{name}.positive", "cable torque moving up"),
            *declare_coefficients(arm, f"{name}.negative", "cable torque moving down"),
            *declare_range(arm, name),
            *joint_arrays(arm, name, blend, lower=0.0),
            Parameter(
                f"{name}.blend", "linear", "",
                "how the blend rises between dead band and saturation velocity",
                choices=("linear", "sine"),
            ),
        )  # fmt: skip

    @classmethod
    def from_parameters(cls, arm: Arm, values: Mapping[str, Value]) -> DirectionalCable | None:
        positive = read_coefficients(arm, f"{cls.NAME}.positive", values)
        negative = read_coefficients(arm, f"{cls.NAME}.negative", values)
        if positive is None and negative is None:
            return None
        if positive is None or negative is None or positive.shape != negative.shape:
            raise ConfigError(
                f"{cls.NAME}.negative",
                None if negative is None else f"{len(negative)} coefficients",
                "as many coefficients as directional_cable.positive",
            )
        n = arm.n
        dead_band = as_array(values.get(f"{cls.NAME}.dead_band"), n, 0.02)
        saturation = as_array(values.get(f"{cls.NAME}.saturation_velocity"), n, 0.2)
        for joint, low, high in zip(arm.joint_names, dead_band, saturation, strict=True):
            if low >= high:
                raise ConfigError(
                    f"{cls.NAME}.dead_band of {joint}", low, f"less than {high:g} rad/s"
                )
        ratio = as_array(values.get(f"{cls.NAME}.ratio"), n, 1.0)
        if (ratio > 1).any():
            raise ConfigError(f"{cls.NAME}.ratio", ratio.max(), "0 to 1")
        valid = Range.from_parameters(arm, cls.NAME, values)
        shape = str(values.get(f"{cls.NAME}.blend", "linear"))
        return cls(arm, positive, negative, valid, Blend(dead_band, saturation, ratio, shape))

    def parameters(self) -> dict[str, Value]:
        # Zeros too: a set without them would be missing, and with it the whole term.
        sets = {
            f"{self.NAME}.{direction}.{joint}": as_value(coefficients[:, column])
            for direction, coefficients in (
                ("positive", self.positive),
                ("negative", self.negative),
            )
            for column, joint in enumerate(self.arm.joint_names)
        }
        return {
            **sets,
            **self.valid.parameters(self.NAME),
            f"{self.NAME}.dead_band": as_value(self.blend.dead_band),
            f"{self.NAME}.saturation_velocity": as_value(self.blend.saturation_velocity),
            f"{self.NAME}.ratio": as_value(self.blend.ratio),
            f"{self.NAME}.blend": self.blend.shape,
        }

    @cached_property
    def polynomials(self) -> JointPolynomials:
        return JointPolynomials(self.positive, self.negative, self.valid, self.blend)

    def elastic(self) -> ElasticCable:
        """Return the mean of both directions: what depends on the position alone."""
        return ElasticCable(self.arm, self.polynomials.mean, self.valid)

    def scaled(self, part: Array) -> DirectionalCable:
        """Return the rest, which is friction, with at most (n,) parts of it left at each joint.

        ``ratio`` is a part of the same friction: where it is the smaller, it stays. With
        :meth:`elastic` and all parts at 1 it makes up the whole term.
        """
        half = self.polynomials.half_difference
        blend = replace(self.blend, ratio=self.friction_part(part))
        return replace(self, positive=half, negative=-half, blend=blend)

    def split(self, part: Array) -> tuple[Term, Term]:
        return self.elastic(), self.scaled(part)

    def friction_part(self, part: Array) -> Array:
        return np.minimum(self.blend.ratio, part)

    def whole(self) -> DirectionalCable:
        return replace(self, blend=replace(self.blend, ratio=np.ones_like(self.blend.ratio)))

    @property
    def full_speed(self) -> Array:
        differs = self.polynomials.half_difference.any(axis=0)
        return np.where(differs, self.blend.saturation_velocity, 0.0)

    def regressor(self, state: State) -> Array:
        held, blend = self.valid.hold(state.q), self.blend.of(state)
        blend = np.zeros_like(held) if blend is None else blend
        sides = (0.5 * (1.0 + blend), 0.5 * (1.0 - blend))
        powers = [held**k for k in range(len(self.positive))]
        columns = [diagonal_columns(side * power) for side in sides for power in powers]
        return np.concatenate(columns, axis=-1)

    def torque(self, state: State) -> Array:
        q = self.valid.hold(state.q)
        torque = evaluate(self.polynomials.mean, q)
        blend = self.blend.of(state)
        if blend is not None:
            torque += blend * evaluate(self.polynomials.half_difference, q)
        return torque

    def prepare(self) -> Evaluator:
        parts, sum_up = self.prepare_parts(self.blend.ratio), np.ones(2).dot
        return lambda q, qd: sum_up(parts(q, qd))

    def prepare_parts(self, part: Array) -> Evaluator:
        """Both parts share the powers of the position."""
        elastic, friction = self.elastic(), self.scaled(part)
        blend = friction.blend
        if blend.shape != "linear":
            return lambda q, qd: np.stack([elastic.torque(State(q)), friction.torque(State(q, qd))])
        count, n = elastic.coefficients.shape
        slope = blend.ratio / (blend.saturation_velocity - blend.dead_band)
        coefficients = np.vstack([elastic.coefficients, friction.positive * slope])
        # A velocity cut at the one less the same velocity cut at the other: the blend's ramp.
        edges = np.array([blend.saturation_velocity, blend.dead_band])
        lowest, full_less_dead = -edges, np.array([1.0, -1.0]).dot
        powers = prepare_powers(elastic.valid, count)
        sum_up = np.repeat(np.eye(2), count, axis=1).dot
        factors = np.zeros((2 * count, n))
        plain, blended = factors[:count], factors[count:]

        def evaluate(q: Array, qd: Array | None) -> Array:
            powers(q, plain)
            ramp = 0.0 if qd is None else full_less_dead(np.minimum(np.maximum(qd, lowest), edges))
            np.multiply(plain, ramp, blended)
            return sum_up(coefficients * factors)

        return evaluate

    def joint_dynamics(self, arm: Arm, q: Array) -> JointDynamics:
        omits = "its curvature and its difference by direction: the file has a straight line"
        return replace(self.elastic().joint_dynamics(arm, q), omits=omits)

    def plant(self) -> PlantPart:
        """The mean, and half of the difference as dry friction.

        The arm has all of the difference: dead band, saturation velocity and ratio are a
        compensator's caution. Where a fit made it negative its size counts, since friction takes
        energy.
        """
        sets = self.polynomials.mean, self.polynomials.half_difference
        values = prepare_polynomials(self.valid, *sets)
        n = self.positive.shape[1]

        def at(q: Array, qd: Array) -> tuple[Array, Array | None]:
            torques = values(q)
            return torques[:n], np.abs(torques[n:])

        return PlantPart(at=at)
