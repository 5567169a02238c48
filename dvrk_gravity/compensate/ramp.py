"""The way from the torque that is there to the one that is wanted, without a jump."""

from __future__ import annotations

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.compensate.limits import EffortLimits
from dvrk_gravity.compensate.settings import CHANGE, Settings

# N·m; less than this is rounding.
_NOTHING = 1e-9


class Ramp:
    """Blends out the difference between a first command and the wanted torque.

    What fades is the difference alone: the command follows the wanted torque from the beginning
    where the arm is moved meanwhile, however often ramps begin. Limits that were lowered below the
    first command come down with it; the torque under a person's hand does not jump into them.

    Attributes:
        over: The wanted torque has been reached.
    """

    def __init__(self, first: Array, wanted: Array, now: float, settings: Settings) -> None:
        """Begin at time ``now``, s.

        Args:
            first: (n,) the command that is there, N·m.
            wanted: (n,) the one that is wanted at the same measurement, N·m.
            now: Monotonic time, s.
            settings: The present settings.
        """
        self.over = False
        self._first = first
        self._start = now
        self._difference = first - wanted
        size = np.abs(self._difference)
        considerable = (size > CHANGE.considerable * settings.model.arm.effort_limit).any()
        self._duration = max(settings.ramp_time, CHANGE.least_ramp if considerable else 0.0)
        if (size <= _NOTHING).all():
            self._duration = 0.0

    def blend(self, wanted: Array, now: float, settings: Settings) -> Array:
        """Return the (n,) torque on the way to the ``wanted`` one, within the limits, N·m."""
        elapsed = now - self._start
        if elapsed >= self._duration:
            self.over = True
            return wanted
        remaining = 1.0 - elapsed / self._duration
        return self._limits(remaining, settings.limits).clip(wanted + remaining * self._difference)

    def _limits(self, remaining: float, limits: EffortLimits) -> EffortLimits:
        motor = limits.arm.actuator_effort(self._first)
        return limits.widened(remaining * np.abs(self._first), remaining * np.abs(motor))
