"""Recordings whose clock runs wrong by a factor: written, or stamped, at another rate."""

from __future__ import annotations

from dvrk_gravity.effects.base.effect import Effect
from dvrk_gravity.effects.base.meaning import Meaning, meanings


class TimeScale(Effect):
    """recorded time = factor x true time.

    Differentiated positions are then 1 / factor times the true velocities, and their derivatives
    1 / factor^2 times the true accelerations; measured velocities are what they are.
    """

    NAME = "time_scale"
    REMEDY = "give the recording its true times, or the rate that it was sampled at"
    MEANINGS = meanings(factor=Meaning("", 1.0, least=0.0))
