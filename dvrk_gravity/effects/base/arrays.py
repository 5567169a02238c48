"""Numbers a joint: as parameters of files, as regressor columns, as polynomials of positions."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.parameters import Parameter, Value

Values = Mapping[str, Any]

MAX_DEGREE = 12
_FAR = 1e6  # rad, beyond every joint


def diagonal_columns(values: Array) -> Array:
    """Return (N, n, n) columns that act on one joint each, from (N, n) values."""
    columns = np.zeros((*values.shape, values.shape[-1]))
    index = np.arange(values.shape[-1])
    columns[..., index, index] = values
    return columns


def motor_columns(arm: Arm, values: Array) -> Array:
    """Return (N, n, n) joint torques of (N, n) motor torques, a column a motor."""
    return values[..., None, :] * arm.joint_to_actuator.T


def joint_array(arm: Arm, name: str, unit: str, meaning: str, lower: float = -np.inf) -> Parameter:
    """Declare an optional array with a number for each joint of an arm.

    Args:
        arm: The arm.
        name: Its name.
        unit: Of a joint that turns; one that slides has N and m in it.
        meaning: What it is.
        lower: Least value of each.
    """
    units = tuple(joint.own_unit(unit) for joint in arm.joints)
    return Parameter(name, (), unit, meaning, lower=lower, lengths=(arm.n,), units=units)


def joint_arrays(
    arm: Arm, name: str, declared: Iterable[tuple[str, str, str]], lower: float = -np.inf
) -> tuple[Parameter, ...]:
    """Declare such arrays of an effect, each by its own name, unit and meaning."""
    return tuple(
        joint_array(arm, f"{name}.{field}", unit, meaning, lower)
        for field, unit, meaning in declared
    )


def as_array(value: Value | None, n: int, default: float) -> Array:
    """Return a parameter's (n,) array, filled with ``default`` where it is not given."""
    return np.array(value, dtype=float) if value else np.full(n, default)


def as_value(array: Array) -> tuple[float, ...]:
    """Return an array as a parameter's value."""
    return tuple(array.tolist())


def numbers(values: Mapping[str, Value], name: str) -> tuple[float, ...]:
    """Return an optional list, empty if it is not given."""
    given = values.get(name) or ()
    assert isinstance(given, tuple)
    return given


def check_count(name: str, given: Sequence[float], count: int, expected: str) -> None:
    """Refuse a list of another length than ``count``, which ``expected`` says in words.

    Raises:
        ConfigError: Naming the list.
    """
    if len(given) != count:
        raise ConfigError(name, f"{len(given)} numbers", expected)


def read_rows(arm: Arm, values: Mapping[str, Value], name: str, count: int, expected: str) -> Array:
    """Return (count, n) numbers, a column a joint; zeros for joints without a list.

    Raises:
        ConfigError: A list of another length, which ``expected`` says in words.
    """
    rows = np.zeros((count, arm.n))
    for column, joint in enumerate(arm.joint_names):
        given = numbers(values, f"{name}.{joint}")
        if given:
            check_count(f"{name}.{joint}", given, count, expected)
            rows[:, column] = given
    return rows


def write_rows(arm: Arm, name: str, rows: Array) -> dict[str, Value]:
    """Return (count, n) numbers as lists; joints that have nothing but zeros are left out."""
    return {
        f"{name}.{joint}": as_value(rows[:, column])
        for column, joint in enumerate(arm.joint_names)
        if rows[:, column].any()
    }


def added(
    arm: Arm, values: Values, name: str, index: int, change: float, lower: float = -np.inf
) -> dict[str, Any]:
    """Return a model's parameters with one entry of such an array changed, not below ``lower``."""
    total = as_array(values.get(name), arm.n, 0.0)
    total[index] = max(lower, total[index] + change)
    return {**values, name: as_value(total)}


def position_offset(arm: Arm, values: Values) -> Array:
    """Return (n,) measured minus true positions, as far as a model's parameters know."""
    return as_array(values.get("joint_offset"), arm.n, 0.0)


# Polynomials of a joint's own position, held at the edge of their range: a quartic fitted on
# +-40 deg is off by hundreds of mN·m beyond it.


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


def prepare_polynomials(valid: Range, *sets: Array) -> Callable[[Array], Array]:
    """Return what evaluates some (degree + 1, n) sets of coefficients together at one pose.

    Returns:
        (n,) positions, held within the range, -> (n sets,) values, set after set.
    """
    lower, upper = valid.lower, valid.upper
    powers = np.ones(sets[0].shape)
    flat, beyond_zero = powers.reshape(-1), powers[1:]
    # One product of a vector and a sparse matrix is faster than a short sum a joint.
    matrix = np.hstack([np.vstack([np.diag(row) for row in rows]) for rows in sets])

    def values(q: Array) -> Array:
        if len(powers) > 1:
            np.minimum(np.maximum(q, lower), upper, out=beyond_zero)
            np.multiply.accumulate(powers, axis=0, out=powers)
        return flat.dot(matrix)

    return values


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
