"""Units of an arm's joints in tables and pictures: one for all efforts of each, deg and mm."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from dvrk_gravity.arms import Arm, Joint, thousandth
from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis import Diagnosis

_MOST = 1.0  # N·m or N, from which a table or a picture is not in thousandths


def effort_in_table(arm: Arm, values: Iterable[float]) -> tuple[str, float, int]:
    """Return the unit of a table of efforts, its factor, and the decimals to show.

    Thousandths, unless the largest of these has four digits before its point; with the joints
    named whose unit is the other one.

    Args:
        arm: The arm.
        values: Those of the table, N·m or N; NaN where one is not known.
    """
    if max(filter(math.isfinite, values), default=0.0) < _MOST:
        return (
            _joined_units([thousandth(unit) for unit in arm.effort_units], arm.joint_names),
            1e3,
            3,
        )
    return _joined_units(arm.effort_units, arm.joint_names), 1.0, 4


def effort_in_picture(joint: Joint, *values: Array) -> tuple[str, float]:
    """Return the unit of a joint's efforts in a picture, and its factor, as in a table.

    Args:
        joint: The joint.
        values: What is shown, N·m or N; NaN where it is not known.
    """
    largest = max(float(np.nanmax(np.abs(array), initial=0.0)) for array in values)
    return (thousandth(joint.effort_unit), 1e3) if largest < _MOST else (joint.effort_unit, 1.0)


def _joined_units(units: Sequence[str], joints: Sequence[str]) -> str:
    first = units[0]
    others = [f"{name} {u}" for name, u in zip(joints, units, strict=True) if u != first]
    return first + (f" ({', '.join(others)})" if others else "")


def position_units(arm: Arm) -> tuple[tuple[float, str], ...]:
    """Return factor and unit of each joint's position as a person reads it: deg or mm."""
    return tuple(_SHOWN[unit] for unit in arm.units)


def position_in_picture(joint: Joint) -> tuple[str, float]:
    """Return the unit of a joint's positions in a picture, and its factor."""
    factor, unit = _SHOWN[joint.unit]
    return unit, factor


_SHOWN = {"rad": (math.degrees(1.0), "deg"), "m": (1e3, "mm")}


def errors_of(diagnosis: Diagnosis) -> tuple[Mapping[str, float], ...]:
    """Return RMS errors by joint: before, after, noise floor, and expected; N·m or N."""
    return diagnosis.before, diagnosis.after, diagnosis.floor, diagnosis.expected


def sizes_of(diagnosis: Diagnosis) -> tuple[float, ...]:
    """Return the errors that a table's unit fits: not those expected, which extrapolate."""
    return tuple(value for errors in errors_of(diagnosis)[:3] for value in errors.values())
