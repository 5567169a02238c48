"""Velocities in another unit than the positions have, or of another shaft."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import pi
from types import MappingProxyType

from dvrk_gravity.arms import Arm
from dvrk_gravity.effects.base.arrays import joint_array
from dvrk_gravity.effects.base.meaning import Meaning, meanings
from dvrk_gravity.effects.base.reading_errors import ReadingErrors
from dvrk_gravity.effects.base.sensor import SensorEffect, read_factors, written_factors
from dvrk_gravity.parameters import Parameter, Value

UNITS: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "rad": MappingProxyType(
            {"deg/s": 180.0 / pi, "rpm": 30.0 / pi, "rev/s": 0.5 / pi, "mrad/s": 1e3}
        ),
        "m": MappingProxyType({"mm/s": 1e3, "cm/s": 1e2}),
    }
)
"""By the joint's unit, the units that velocities are written in, and what one a second is in them.
"""


class VelocityScale(SensorEffect):
    """recorded velocity = factor x derivative of the recorded position."""

    NAME = "velocity_scale"
    FACTORS = "reading.velocity_scale"
    REMEDY = "write velocities in rad/s (m/s where a joint slides), of the joint and not the motor"
    MEANINGS = meanings(factor=Meaning("", 1.0, least=0.0))

    @classmethod
    def schema(cls, arm: Arm) -> tuple[Parameter, ...]:
        meaning = "measured velocity over the derivative of the measured position"
        return (joint_array(arm, cls.FACTORS, "1", meaning),)

    @classmethod
    def read(cls, arm: Arm, values: Mapping[str, Value], errors: ReadingErrors) -> ReadingErrors:
        factors = read_factors(arm, values, cls.FACTORS)
        return replace(errors, velocity=factors * errors.velocity)

    @classmethod
    def written(cls, arm: Arm, errors: ReadingErrors) -> dict[str, Value]:
        return written_factors(cls.FACTORS, errors.velocity)
