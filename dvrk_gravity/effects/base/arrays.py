"""Numbers a joint: as parameters of files, as regressor columns."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.parameters import Parameter, Value

Values = Mapping[str, Any]


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
