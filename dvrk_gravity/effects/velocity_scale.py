"""Velocities in another unit than the positions have, or of another shaft."""

from __future__ import annotations

from collections.abc import Mapping
from math import pi
from types import MappingProxyType

from dvrk_gravity.effects.base.meaning import Meaning, meanings
from dvrk_gravity.effects.base.sensor import FactorEffect

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


class VelocityScale(FactorEffect):
    """recorded velocity = factor x derivative of the recorded position."""

    NAME = "velocity_scale"
    FACTORS = "reading.velocity_scale"
    FACTOR_OF = "velocity"
    FACTOR_MEANING = "measured velocity over the derivative of the measured position"
    REMEDY = "write velocities in rad/s (m/s where a joint slides), of the joint and not the motor"
    MEANINGS = meanings(factor=Meaning("", 1.0, least=0.0))
