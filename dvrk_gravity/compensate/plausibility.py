"""Whether a joint can have moved as a measurement says."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arms import FASTEST, UNTIMED_STEP
from dvrk_gravity.arrays import Array
from dvrk_gravity.compensate.sample import DroppedSampleError, Sample


@dataclass(frozen=True)
class PlausibleMotion:
    """What is taken for possible.

    Attributes:
        speed: Fastest motion of a joint, rad/s.
        step: Positions may differ by so much at any rate, rad.
        interval: Velocities are compared so often, s.
        time_constant: Of the low-pass filters through which velocities are compared, s: longer
            than consoles' own velocity filters (some 10 ms), and at 0.006 rad a step and 100 Hz an
            encoder's steps leave 0.1 rad/s of ripple.
        slack: Filtered velocities may differ by so much, rad/s: five times that ripple.
        share: And by this part of the larger one.
    """

    speed: float = FASTEST
    step: float = UNTIMED_STEP
    interval: float = 0.005
    time_constant: float = 0.05
    slack: float = 0.5
    share: float = 0.5


class MotionCheck:
    """Compares each measurement with those before it.

    Attributes:
        doubtful: (n,) joints whose velocity was not believed in the last sample.
        velocity: (n,) of the last sample, rad/s: as told; where it is not told or not believed,
            from the positions, filtered.
    """

    def __init__(
        self,
        joint_names: tuple[str, ...],
        limits: PlausibleMotion | None = None,
        scale: Array | None = None,
    ) -> None:
        """Start with nothing known; ``scale`` (n,): what counts as much as a rad, ``Arm.scale``."""
        self._names = joint_names
        self._scale = np.ones(len(joint_names)) if scale is None else scale
        self._least = float(self._scale.min())
        self._limits = limits or PlausibleMotion()
        self._last: Sample | None = None  # and the monotonic time at which it came
        self._time = 0.0
        self._dropped: Sample | None = None  # the last one, if it was out of reach
        self._anchor: Sample | None = None  # the last one at which velocities were compared
        self._observed = self._reported = self.velocity = np.zeros(len(joint_names))
        self.doubtful: NDArray[np.bool_] = np.zeros(len(joint_names), dtype=bool)
        self._any_doubtful = False

    def check(self, sample: Sample, now: float, timeout: float) -> Sample:
        """Return the sample, the velocity zero at joints where it cannot be true.

        At zero velocity no friction is compensated, which never drives a joint.

        Args:
            sample: What came.
            now: Monotonic time at which it came, s.
            timeout: After so long without a sample nothing is known any more, s.

        Raises:
            DroppedSampleError: A joint cannot have got there since the last sample.
        """
        last = self._last
        if last is None or now - self._time > timeout:
            self._forget(sample)
        else:
            step = (sample.stamp - last.stamp) * 1e-9
            if step < 0.0:
                return sample  # out of order, or another clock: its stamp decides
            change = sample.position - last.position
            # Where the joints' way together is short, each one's is: that is quick to tell.
            reach = (self._limits.step + self._limits.speed * min(step, timeout)) * self._least
            near = self._dropped is None and change.dot(change) <= reach * reach
            if not near and (
                not self._within_reach(last, sample, timeout)
                or (
                    self._dropped is not None and self._within_reach(self._dropped, sample, timeout)
                )
            ):
                self._dropped = sample  # those behind it, where it is, are out of reach, too
                raise self._jumped(change, step)
        self._last, self._time, self._dropped = sample, now, None
        self._compare(sample)
        return self._believed(sample)

    def _compare(self, sample: Sample) -> None:
        """Compare velocities as they are told, if they are, with those of the positions."""
        limits, anchor = self._limits, self._anchor
        assert anchor is not None  # the first sample of all has been one
        step = (sample.stamp - anchor.stamp) * 1e-9
        if step >= limits.interval:
            # From the positions and from the velocities, through the same filter.
            moved = (sample.position - anchor.position) / step
            part = step / (step + limits.time_constant)
            self._observed = self._observed + part * (moved - self._observed)
            if sample.velocity is None:
                self._reported = self._observed
            else:
                most = 2 * limits.speed * self._scale
                told = np.minimum(np.maximum(sample.velocity, -most), most)
                self._reported = self._reported + part * (told - self._reported)
            self._anchor = sample
            larger = np.maximum(np.abs(self._observed), np.abs(self._reported))
            difference = np.abs(self._observed - self._reported)
            self.doubtful = difference > limits.slack * self._scale + limits.share * larger
            self._any_doubtful = bool(self.doubtful.any())

    def _believed(self, sample: Sample) -> Sample:
        """Return the sample without velocities that the positions, or reason, contradict."""
        speed, velocity = self._limits.speed, sample.velocity
        if velocity is None:
            self.velocity = self._observed
            return sample
        self.velocity = velocity
        if not self._any_doubtful and velocity.dot(velocity) <= (speed * self._least) ** 2:
            return sample
        doubtful = np.abs(velocity) > speed * self._scale
        doubtful |= self.doubtful
        if np.count_nonzero(doubtful) == 0:
            return sample
        self.velocity = np.where(doubtful, self._observed, velocity)
        return replace(sample, velocity=np.where(doubtful, 0.0, velocity))

    def _within_reach(self, last: Sample, sample: Sample, timeout: float) -> bool:
        step = min((sample.stamp - last.stamp) * 1e-9, timeout)
        farthest = self._limits.step + self._limits.speed * step
        near = np.abs(sample.position - last.position) <= farthest * self._scale
        return np.count_nonzero(near) == len(near)

    def _forget(self, sample: Sample) -> None:
        self._anchor = sample
        self._observed = self._reported = np.zeros(len(self._names))
        self.doubtful, self._any_doubtful = np.zeros(len(self._names), dtype=bool), False

    def _jumped(self, change: Array, step: float) -> DroppedSampleError:
        joint = int(np.argmax(np.abs(change / self._scale)))
        unit = "rad" if self._scale[joint] == 1.0 else "m"
        fastest = self._limits.speed * self._scale[joint]
        return DroppedSampleError(
            "position_jump",
            f"{self._names[joint]} by {change[joint]:.3g} {unit} in {step * 1e3:.3g} ms, faster "
            f"than {fastest:g} {unit}/s: a broken encoder, or another arm's messages?",
        )
