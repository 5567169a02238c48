"""Recordings whose clock runs wrong by a factor: written, or stamped, at another rate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from dvrk_gravity.arms import Arm
from dvrk_gravity.effects.base.meaning import Meaning, meanings
from dvrk_gravity.effects.base.reading_errors import ReadingErrors
from dvrk_gravity.effects.base.sensor import SensorEffect
from dvrk_gravity.parameters import Parameter, Value


class TimeScale(SensorEffect):
    """recorded time = factor x true time.

    Differentiated positions are then 1 / factor times the true velocities, and their derivatives
    1 / factor^2 times the true accelerations; measured velocities are what they are.
    """

    NAME = "time_scale"
    FACTOR = "reading.time_scale"
    REMEDY = "give the recording its true times, or the rate that it was sampled at"
    MEANINGS = meanings(factor=Meaning("", 1.0, least=0.0))

    @classmethod
    def schema(cls, arm: Arm) -> tuple[Parameter, ...]:
        return (
            Parameter(cls.FACTOR, 1.0, "1", "recorded over true time", lower=0.01, upper=100.0),
        )

    @classmethod
    def read(cls, arm: Arm, values: Mapping[str, Value], errors: ReadingErrors) -> ReadingErrors:
        clock = values.get(cls.FACTOR, 1.0)
        assert isinstance(clock, float)
        return replace(errors, clock=clock)

    @classmethod
    def written(cls, arm: Arm, errors: ReadingErrors) -> dict[str, Value]:
        return {} if errors.clock == 1.0 else {cls.FACTOR: errors.clock}

    @classmethod
    def invalidates_commands(cls, arm: Arm, errors: ReadingErrors) -> bool:
        """It is a recording's: a node takes times from its own clock."""
        return False
