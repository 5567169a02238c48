"""What everything that commands an arm asks of a measurement before it believes it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.compensate.freshness import Freshness
from dvrk_gravity.compensate.plausibility import MotionCheck
from dvrk_gravity.compensate.sample import Sample


class Admitted(NamedTuple):
    """A measurement that is believed.

    Attributes:
        sample: It, the velocity zero at joints where it cannot be true.
        step: Time since the one before it, s.
        gap: Time since the stamp last advanced before it, s.
    """

    sample: Sample
    step: float
    gap: float


class InputGate:
    """Admits samples that are of now and that a joint can have reached since the last one.

    Times are seconds of a monotonic clock.
    """

    def __init__(self, arm: Arm) -> None:
        """Start with nothing received of an arm."""
        self._fresh = Freshness()
        self._motion = MotionCheck(arm.joint_names, scale=arm.scale)

    @property
    def velocity(self) -> Array:
        """(n,) of the last sample, rad/s or m/s; from the positions where it is not believed."""
        return self._motion.velocity

    @property
    def doubtful(self) -> NDArray[np.bool_]:
        """(n,) joints whose velocity was not believed in the last sample."""
        return self._motion.doubtful

    def silence(self, now: float, timeout: float) -> str:
        """Return what has been missing for longer than ``timeout`` seconds, ``""``: nothing."""
        return self._fresh.silence(now, timeout)

    def admit(
        self, sample: Sample, now: float, clock: int, timeout: float, oldest: float, active: bool
    ) -> Admitted:
        """Return the sample if it is believed.

        Args:
            sample: What came.
            now: Monotonic time at which it came, s.
            clock: The node's clock, ns, to which stamps are compared.
            timeout: Longest time without fresh input, s.
            oldest: How far the stamp may be from the clock, s; 0: not checked.
            active: The arm is under our command.

        Raises:
            DroppedSampleError: Its stamp, or where it says that the arm is, disqualifies it.
        """
        step, gap = self._fresh.judge(sample.stamp, now, clock, timeout, oldest, active)
        believed = self._motion.check(sample, now, timeout)
        self._fresh.accept(sample.stamp, now)
        return Admitted(believed, step, gap)
