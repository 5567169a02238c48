"""A model's parameters with changes put in, by those who merge what was found into a model."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array

Values = Mapping[str, Any]


def array(arm: Arm, values: Values, name: str, fallback: str = "") -> Array:
    """Return an array with a number a joint, zeros where neither name is given."""
    value = values.get(name) or values.get(fallback) or np.zeros(arm.n)
    return np.array(value, dtype=float)


def added(arm: Arm, values: Values, name: str, index: int, change: float) -> dict[str, Any]:
    """Return the values with a change of one entry of such an array."""
    total = array(arm, values, name)
    total[index] += change
    return {**values, name: tuple(total.tolist())}


def position_offset(arm: Arm, values: Values) -> Array:
    """Return (n,) what encoders read too much, as far as the values know."""
    return array(arm, values, "joint_offset")
