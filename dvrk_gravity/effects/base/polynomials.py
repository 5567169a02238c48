"""Polynomials of each joint's own position: in files, over a range, fast at one pose.

Outside the range that they were fitted on their argument is held at its edge: a quartic fitted on
+-40 deg is off by hundreds of mN·m beyond it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.arrays import as_array, as_value, joint_arrays, numbers
from dvrk_gravity.effects.base.motion import State
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.parameters import Parameter, Value

MAX_DEGREE = 12
_FAR = 1e6  # rad, beyond every joint


@dataclass(frozen=True, eq=False)
class Range:
    """Positions on which a polynomial was fitted.

    Attributes:
        lower: (n,) rad; ``-inf`` where there is no edge.
        upper: (n,) rad.
    """

    lower: Array
    upper: Array

    @classmethod
    def from_parameters(cls, arm: Arm, prefix: str, values: Mapping[str, Value]) -> Range:
        """Read ``prefix.valid_lower`` and ``prefix.valid_upper``.

        Raises:
            ConfigError: A lower edge above its upper edge.
        """
        lower = as_array(values.get(f"{prefix}.valid_lower"), arm.n, -np.inf)
        upper = as_array(values.get(f"{prefix}.valid_upper"), arm.n, np.inf)
        for joint, low, high in zip(arm.joint_names, lower.tolist(), upper.tolist(), strict=True):
            if low > high:
                raise ConfigError(
                    f"{prefix}.valid_lower of {joint}", low, f"at most valid_upper ({high:g})"
                )
        return cls(lower, upper)

    def parameters(self, prefix: str) -> dict[str, Value]:
        """Return the values that :meth:`from_parameters` reads."""
        edges = {"valid_lower": self.lower, "valid_upper": self.upper}
        # Parameters are finite: where only some joints have an edge, the others get a far one.
        return {
            f"{prefix}.{name}": as_value(np.clip(edge, -_FAR, _FAR))
            for name, edge in edges.items()
            if np.isfinite(edge).any()
        }

    def hold(self, q: Array) -> Array:
        """Return (…, n) positions with those outside the range at its edge."""
        return np.minimum(np.maximum(q, self.lower), self.upper)


@dataclass(frozen=True, eq=False)
class Blend:
    """How torque goes from the mean of two directions to that of one as the speed rises.

    Attributes:
        dead_band: (n,) speed below which the two are averaged, rad/s.
        saturation_velocity: (n,) speed from which on the blend is full, rad/s.
        ratio: (n,) part of the difference that is applied at full blend, 0 to 1.
        shape: How the blend rises from the dead band on: ``linear`` or ``sine``.
    """

    dead_band: Array
    saturation_velocity: Array
    ratio: Array
    shape: str = "linear"

    def of(self, state: State) -> Array | None:
        """Return (…, n) from -1, moving down, to 1, moving up; ``None``: no motion is known."""
        if state.direction is not None:
            return state.direction
        if state.qd is None:
            return None
        slope = 1.0 / (self.saturation_velocity - self.dead_band)
        rise = np.minimum(np.maximum((np.abs(state.qd) - self.dead_band) * slope, 0.0), 1.0)
        if self.shape == "sine":
            rise = np.sin(0.5 * np.pi * rise)
        return np.copysign(self.ratio * rise, state.qd)


@dataclass(frozen=True, eq=False)
class JointPolynomials:
    """tau_j = k0 + k1 q_j + k2 q_j^2 + …, one set of coefficients for each direction of motion.

    Attributes:
        positive: (degree + 1, n) coefficients while moving up, lowest power first, N·m/rad^k.
        negative: (degree + 1, n) coefficients while moving down.
        valid: Range of positions on which they were fitted; outside, q_j is held at its edge.
        blend: How the velocity chooses between them; ``None``: both are the same.
    """

    positive: Array
    negative: Array
    valid: Range
    blend: Blend | None = None

    @cached_property
    def mean(self) -> Array:
        """(degree + 1, n) coefficients at rest."""
        return 0.5 * (self.positive + self.negative)

    @cached_property
    def half_difference(self) -> Array:
        """(degree + 1, n) coefficients of what is added moving up, and taken away moving down."""
        return 0.5 * (self.positive - self.negative)


def declare_coefficients(arm: Arm, prefix: str, meaning: str) -> Iterator[Parameter]:
    """Declare ``prefix.JOINT`` for each joint: k0, k1, … of k0 + k1 q + …."""
    for joint in arm.joints:
        yield Parameter(
            f"{prefix}.{joint.name}",
            (),
            joint.own_unit("N·m/rad^k"),
            f"{meaning}, {joint.name}",
            lengths=tuple(range(1, MAX_DEGREE + 2)),
        )


def declare_range(arm: Arm, prefix: str) -> tuple[Parameter, ...]:
    """Declare the range of positions outside which the polynomial's argument is held."""
    declared = (
        ("valid_lower", "rad", "lower edge of the range it was fitted on"),
        ("valid_upper", "rad", "upper edge of the range it was fitted on"),
    )
    return joint_arrays(arm, prefix, declared)


def read_coefficients(arm: Arm, prefix: str, values: Mapping[str, Value]) -> Array | None:
    """Return (degree + 1, n) coefficients, lowest power first; ``None`` if not given."""
    given = [numbers(values, f"{prefix}.{joint}") for joint in arm.joint_names]
    length = max(map(len, given))
    if length == 0:
        return None
    coefficients = np.zeros((length, len(given)))
    for column, value in enumerate(given):
        coefficients[: len(value), column] = value
    return coefficients


def evaluate(coefficients: Array, q: Array) -> Array:
    """Return (…, n) values of (degree + 1, n) coefficients at (…, n) positions (Horner)."""
    result = np.broadcast_to(coefficients[-1], q.shape).copy()
    for row in coefficients[-2::-1]:
        result *= q
        result += row
    return result


def prepare_powers(valid: Range, count: int) -> Callable[..., Array]:
    """Return what makes (count, n) powers 0, 1, … of (n,) positions held within a range."""
    lower, upper = valid.lower, valid.upper
    steps = np.ones((count, len(lower)))
    beyond_zero = steps[1:]

    def powers(q: Array, out: Array | None = None) -> Array:
        np.minimum(np.maximum(q, lower), upper, out=beyond_zero)
        return np.multiply.accumulate(steps, 0, None, out)

    return powers


def prepare_polynomials(valid: Range, *sets: Array) -> Callable[[Array], Array]:
    """Return what evaluates some (degree + 1, n) sets of coefficients together at one pose.

    Returns:
        (n,) positions, held within the range, -> (n sets,) values, set after set.
    """
    powers = prepare_powers(valid, len(sets[0]))
    # One product of a vector and a sparse matrix is faster than a short sum a joint.
    matrix = np.hstack([np.vstack([np.diag(row) for row in rows]) for rows in sets])
    return lambda q: powers(q).reshape(-1).dot(matrix)


def legendre(valid: Range, degree: int) -> Array:
    """Return (k, k) from coefficients of Legendre polynomials over a range to those of powers.

    Both order by order, and of one order joint by joint.
    """
    n = len(valid.lower)
    matrix = np.zeros((degree + 1, n, degree + 1, n))
    orders = np.zeros((degree + 1, degree + 1))  # of powers of u, which goes from -1 to 1
    for order, unit in enumerate(np.eye(degree + 1)):
        orders[: order + 1, order] = np.polynomial.legendre.leg2poly(unit[: order + 1])
    for joint, (low, high) in enumerate(zip(valid.lower, valid.upper, strict=True)):
        if high - low <= 1e-3:
            low, high = low - 1.0, low + 1.0
        u = np.array([-(high + low), 2.0]) / (high - low)  # in powers of the position
        powers, power = np.zeros((degree + 1, degree + 1)), np.ones(1)
        for k in range(degree + 1):
            powers[: k + 1, k] = power
            power = np.convolve(power, u)
        matrix[:, joint, :, joint] = powers @ orders
    return matrix.reshape((degree + 1) * n, -1)
