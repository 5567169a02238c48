"""Lists of numbers that parameters give for each joint of an arm, as ``NAME.JOINT``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.arrays import as_value
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.parameters import Value


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
