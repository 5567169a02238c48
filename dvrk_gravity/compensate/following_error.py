"""How an arm follows commanded positions, and where to stop it."""

from __future__ import annotations

from collections import deque

import numpy as np

from dvrk_gravity.arms import Arm, mtm
from dvrk_gravity.arrays import Array
from dvrk_gravity.compensate.sample import Sample
from dvrk_gravity.errors import DvrkGravityError

# Largest following error of an arm that is no MTM, beside its lag, rad (Arm.scale): that of the
# first joints of one.
FOLLOWING_ERROR = np.radians(8.0)
# Part of a joint's range that it may be from its set point at most. Chosen: a joint with a small
# range that does not move at all is noticed, too.
MOST_OF_RANGE = 0.25
# Largest lag, s: servos lag by some 0.05 s, the simulated one by 0.08 s, and a measurement is up to
# 0.01 s old.
LAG = 0.1
# An arm at rest may move so far in half of the time of listening, and twice as far until the first
# command, rad (Arm.scale). Chosen: encoders' noise is a tenth of it.
STILL = np.radians(1.0)
# So many consecutive readings have to agree on where a joint is stopped. Chosen: two nodes that
# measure, or an encoder that slips, are noticed within three.
AGREE = 5


class MotionError(DvrkGravityError):
    """The arm could not be moved, or was stopped."""


class FollowingErrorCheck:
    """Compares set points with measured positions."""

    def __init__(self, arm: Arm) -> None:
        self._arm = arm
        error = mtm.defaults.FOLLOWING_ERROR if mtm.is_mtm(arm) else FOLLOWING_ERROR * arm.scale
        lower, upper = arm.range
        self._error = np.minimum(error, MOST_OF_RANGE * (upper - lower))
        self._recent: deque[Sample] = deque(maxlen=AGREE)

    def add(self, sample: Sample) -> None:
        """Add a believed measurement."""
        self._recent.append(sample)

    @property
    def last(self) -> Sample | None:
        """The last believed measurement; ``None`` before the first."""
        return self._recent[-1] if self._recent else None

    @property
    def position(self) -> Array:
        """(n,) of the last measurement, which the caller has waited for, rad or m."""
        return self._recent[-1].position

    @property
    def time(self) -> float:
        """The arm's own time, s."""
        return self._recent[-1].stamp * 1e-9

    def rest_position(self, heard: Array) -> Array:
        """Return the (n,) median of (N, n) positions of an arm at rest, rad or m.

        Raises:
            MotionError: The arm moves.
        """
        early, late = (np.median(part, axis=0) for part in np.array_split(heard, 2))
        moved = np.abs(late - early)
        worst = int(np.argmax(moved / self._arm.scale))
        if not moved[worst] <= STILL * self._arm.scale[worst]:
            joint = self._arm.joints[worst]
            raise MotionError(
                f"{joint.name} moves by {joint.shown(moved[worst])} before the first command: let "
                "the arm rest, or stop what moves it"
            )
        median: Array = np.median(heard, axis=0)
        return median

    def check(self, position: Array, velocity: Array, first: bool) -> None:
        """Refuse a set point that is too far from the measured position.

        Args:
            position: (n,) set point, rad or m.
            velocity: (n,) its velocity, rad/s or m/s: the arm lags.
            first: The arm has rested until now.

        Raises:
            MotionError: Naming the joint that is furthest.
        """
        error = np.abs(position - self.position)
        lagging = self._error + LAG * np.abs(velocity)
        allowed = 2.0 * STILL * self._arm.scale if first else lagging
        worst = int(np.argmax(error / allowed))
        if not error[worst] <= allowed[worst]:
            joint = self._arm.joints[worst]
            raise MotionError(
                f"{joint.name} is {joint.shown(error[worst], 1)} from its set point, at most "
                f"{joint.shown(allowed[worst], 1)} allowed at this speed: is something in its way, "
                "or does the console not move it?"
            )

    def resting_place(self, commanded: Array, velocity: Array, moving: Array) -> Array:
        """Return the (n,) positions at which an arm that follows comes to rest, by its lag.

        A stuck joint stays where it is; a joint whose last readings differ by more than its motion
        goes to its set point.

        Args:
            commanded: (n,) last set point, which is not passed, rad or m.
            velocity: (n,) of the set point, rad/s or m/s.
            moving: (n,) measured velocity, rad/s or m/s.
        """
        recent = np.array([sample.position for sample in self._recent])
        measured = np.median(recent, axis=0)
        ahead = commanded - measured
        way = np.clip(LAG * moving, np.minimum(ahead, 0.0), np.maximum(ahead, 0.0))
        span = 1e-9 * (self._recent[-1].stamp - self._recent[0].stamp)
        agree = np.ptp(recent, axis=0) < 0.5 * self._error + span * np.abs(velocity)
        return np.where(agree, measured + way, commanded)
