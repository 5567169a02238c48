"""How an arm follows the positions that it is commanded, and where it is to stop."""

from __future__ import annotations

from collections import deque

import numpy as np

from dvrk_gravity.arms import Arm, mtm
from dvrk_gravity.arrays import Array
from dvrk_gravity.compensate.sample import Sample
from dvrk_gravity.errors import DvrkGravityError

FOLLOWING_ERROR = np.radians(8.0)
"""How far an arm that is no MTM may be from its set point, rad (see Arm.scale), beside its lag: as
the first joints of one."""

LAG = 0.1
"""How late the arm may be there, s: servos lag by some 0.05 s, the simulated one by 0.08 s, and a
measurement is up to 0.01 s old."""

STILL = np.radians(1.0)
"""How far an arm at rest may move in half of the time of listening, and, twice, until the first
command, rad (see Arm.scale). Chosen: encoders' noise is a tenth of it."""

MOST_OF_RANGE = 0.25
"""Part of a joint's range that it may be from its set point at most. Chosen: a joint with a small
range that does not move at all is noticed, too."""

AGREE = 5
"""So many readings in a row have to agree before a joint is stopped where they say. Chosen: two
nodes that measure, or an encoder that slips, are noticed within three."""


class MotionError(DvrkGravityError):
    """The arm could not be moved, or was stopped on its way."""


class Following:
    """Compares set points with where an arm is measured.

    Attributes:
        last: The last measurement that is believed; ``None`` before the first.
    """

    def __init__(self, arm: Arm) -> None:
        """Know nothing of the arm yet."""
        self._arm = arm
        error = mtm.defaults.FOLLOWING_ERROR if mtm.is_mtm(arm) else FOLLOWING_ERROR * arm.scale
        lower, upper = arm.range
        self._error = np.minimum(error, MOST_OF_RANGE * (upper - lower))
        self._recent: deque[Sample] = deque(maxlen=AGREE)
        self.last: Sample | None = None

    def add(self, sample: Sample) -> None:
        """Take a measurement that is believed."""
        self.last = sample
        self._recent.append(sample)

    @property
    def position(self) -> Array:
        """(n,) where the arm was last, rad or m."""
        assert self.last is not None  # who asks has waited for it
        return self.last.position

    @property
    def time(self) -> float:
        """The arm's own time, s."""
        assert self.last is not None
        return self.last.stamp * 1e-9

    def at_rest(self, heard: Array) -> Array:
        """Return the (n,) median of positions: a single wrong reading does not count.

        Args:
            heard: (N, n) positions over the time of listening, rad or m.

        Raises:
            MotionError: The arm moves.
        """
        early, late = (np.median(part, axis=0) for part in np.array_split(heard, 2))
        moved = np.abs(late - early)
        worst = int(np.argmax(moved / self._arm.scale))
        if not moved[worst] <= STILL * self._arm.scale[worst]:
            joint = self._arm.joints[worst]
            raise MotionError(
                f"{joint.name} moves by {joint.shown(moved[worst])} while nobody is to move it: "
                "let the arm rest, or stop what moves it"
            )
        median: Array = np.median(heard, axis=0)
        return median

    def check(self, position: Array, velocity: Array, first: bool) -> None:
        """Refuse a set point that is too far from where the arm is.

        Args:
            position: (n,) set point, rad or m.
            velocity: (n,) how fast it moves, rad/s or m/s: the arm lags.
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
                f"{joint.shown(allowed[worst], 1)} allowed at this speed: something is in its way, "
                "or the console does not let it move"
            )

    def resting_place(self, commanded: Array, velocity: Array, moving: Array) -> Array:
        """Return (n,) where an arm that follows comes to rest, by its lag; one that is stuck, is.

        Of a joint whose last readings differ by more than its motion: its set point.

        Args:
            commanded: (n,) last set point, which it does not go beyond, rad or m.
            velocity: (n,) how fast that moved, rad/s or m/s.
            moving: (n,) how fast the arm is measured to move, rad/s or m/s.
        """
        recent = np.array([sample.position for sample in self._recent])
        measured = np.median(recent, axis=0)
        ahead = commanded - measured
        way = np.clip(LAG * moving, np.minimum(ahead, 0.0), np.maximum(ahead, 0.0))
        span = 1e-9 * (self._recent[-1].stamp - self._recent[0].stamp)
        agree = np.ptp(recent, axis=0) < 0.5 * self._error + span * np.abs(velocity)
        return np.where(agree, measured + way, commanded)
