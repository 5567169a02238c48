"""Arrays with a number a joint or a motor: as columns of a regressor, as parameters."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.parameters import Parameter, Value


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
