"""Units of an arm's joints in tables and pictures, where numbers are a thousandth of SI ones."""

from __future__ import annotations

import math

from dvrk_gravity.arms import Arm
from dvrk_gravity.arms.description import thousandth


def milli_effort(arm: Arm) -> str:
    """Return mN·m or mN, with the joints named whose unit is the other one."""
    return _milli(arm, arm.effort_units)


def milli(arm: Arm, name: str) -> str:
    """Return mN·m or mN, of a joint by its name."""
    return thousandth(arm.effort_units[arm.joint_names.index(name)])


def milli_position(arm: Arm) -> str:
    """Return mrad or mm, with the joints named whose unit is the other one."""
    return _milli(arm, arm.units)


def _milli(arm: Arm, units: tuple[str, ...]) -> str:
    first = units[0]
    others = [
        f"{name} {thousandth(unit)}"
        for name, unit in zip(arm.joint_names, units, strict=True)
        if unit != first
    ]
    return thousandth(first) + (f" ({', '.join(others)})" if others else "")


def shown_position(arm: Arm) -> tuple[tuple[float, str], ...]:
    """Return factor and unit of each joint's position as a person reads it: deg or mm."""
    return tuple(_SHOWN[unit] for unit in arm.units)


_SHOWN = {"rad": (math.degrees(1.0), "deg"), "m": (1e3, "mm")}
