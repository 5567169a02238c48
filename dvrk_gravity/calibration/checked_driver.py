"""A driver whose commands are compared with the limits, at 1 kHz, before the arm moves."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import replace
from typing import Self

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.calibration.tally import MotionTally
from dvrk_gravity.collecting import Driver, Path, Watch
from dvrk_gravity.compensate import MotionError
from dvrk_gravity.planning import PlanLimits, distances

RATE = 1000.0  # Hz
_BLOCK = 20_000  # moments looked at at a time
_ROUNDING = 1e-9


class LimitCheck:
    """Compares commands with the limits.

    Attributes:
        samples: Commands looked at.
        used: Greatest part of a limit that they use; 1 is at the limit.
        most: Of which one.
    """

    def __init__(self, limits: PlanLimits, arm: Arm) -> None:
        """Look at nothing yet."""
        self._limits, self._arm = limits, arm
        self.samples, self.used, self.most = 0, 0.0, ""

    def look(self, path: Path, duration: float) -> None:
        """Compare a path with the limits.

        Raises:
            MotionError: It leaves them.
        """
        limits = self._limits
        lower, upper = limits.range
        start = path(np.zeros(1))[0] @ limits.rows.T
        # An arm that stands outside of a limit comes in.
        lower, upper = np.minimum(lower, start[0]), np.maximum(upper, start[0])
        moments = np.append(np.arange(0.0, duration, 1.0 / RATE), duration)
        for first in range(0, len(moments), _BLOCK):
            q, qd, qdd = path(moments[first : first + _BLOCK])
            along = [each @ limits.rows.T for each in (q, qd, qdd)]
            if not np.isfinite(along).all():
                raise MotionError("a command would not be a finite number: not moved")
            half = 0.5 * (upper - lower)
            with np.errstate(invalid="ignore", divide="ignore"):
                parts = {
                    "position": np.abs(along[0] - 0.5 * (lower + upper)) / half,
                    "velocity": np.abs(along[1]) / limits.rates[0],
                    "acceleration": np.abs(along[2]) / limits.rates[1],
                }
            self.samples += len(q)
            for kind, part in parts.items():
                greatest = np.nan_to_num(part, nan=0.0).max(axis=0)
                k = int(np.argmax(greatest))
                if greatest[k] > 1.0 + _ROUNDING:
                    raise MotionError(
                        f"a command would use {100 * greatest[k]:.3g} % of the limit of {kind} of "
                        f"{limits.names[k]}: not moved"
                    )
                if greatest[k] > self.used:
                    self.used, self.most = float(greatest[k]), f"{kind} of {limits.names[k]}"
            if limits.boxes and (near := float(distances(self._arm, limits.boxes, q).min())) < 0.0:
                raise MotionError(f"a command would go {-1e3 * near:.3g} mm into a box: not moved")


class CheckedDriver:
    """A driver that refuses to leave the limits.

    Attributes:
        check: What was compared.
        seconds: Of motion, rehearsals apart; of a path that was stopped, up to there.
        rehearsed: Of rehearsals, s.
        rehearsing: Whether paths are a rehearsal's.
    """

    def __init__(
        self,
        driver: Driver,
        limits: PlanLimits,
        arm: Arm,
        note: Callable[[MotionTally], None] = lambda motion: None,
    ) -> None:
        """Look at nothing yet.

        Args:
            driver: Moves the arm.
            limits: What is kept.
            arm: The arm.
            note: Receives how the arm was moved: before every path, as if it were whole, so that
                what kills the process then does not lose it, and after it.
        """
        self._driver, self.check, self._note = driver, LimitCheck(limits, arm), note
        self._limits, self._arm = limits, arm
        self._looked: deque[Path] = deque(maxlen=2)  # an approach, and what it leads to
        self.seconds = self.rehearsed = 0.0
        self.rehearsing = False

    @property
    def topic(self) -> str:
        """Full name of the ``measured_js`` that is recorded."""
        return self._driver.topic

    def __enter__(self) -> Self:
        """Begin."""
        return self

    def __exit__(self, *error: object) -> None:
        """Hold the arm if it was moved."""
        self.hold()

    def connect(self) -> Array:
        """Wait for the arm, and return its (n,) rest position, rad or m.

        Raises:
            MotionError: An endless joint is in another turn than its limits: what is identified
                there holds there, and the arm is to be released within the limits.
        """
        where = self._driver.connect()
        turns = self._limits.turns(self._arm, where)
        if turns.any():
            joint = int(np.argmax(np.abs(turns)))
            least, most = np.degrees([self._limits.lower[joint], self._limits.upper[joint]])
            raise MotionError(
                f"{self.topic}: {self._arm.joint_names[joint]} is at "
                f"{np.degrees(where[joint]):.4g} deg, in another turn than its limits, {least:.4g} "
                f"to {most:.4g} deg: turn it back by hand, or give limits about where it is"
            )
        return where

    def hold(self) -> bool:
        """Hold the arm if it was moved; return whether hold was sent."""
        return self._driver.hold()

    def look(self, path: Path, duration: float) -> None:
        """Compare a path with the limits; :meth:`follow` does not do so again.

        Of a long path it takes seconds, for which an arm under command must not be left alone.

        Raises:
            MotionError: It leaves them.
        """
        self.check.look(path, duration)
        self._looked.append(path)

    def follow(
        self,
        path: Path,
        duration: float,
        record: Callable[[bytes], None] | None = None,
        progress: Callable[[float], None] | None = None,
        watch: Watch | None = None,
    ) -> float:
        """Drive the arm along a path: :meth:`Driver.follow`.

        Raises:
            MotionError: The path leaves the limits; nothing has moved.
        """
        if path not in self._looked:
            self.look(path, duration)
        made = 0.0

        def moved(part: float) -> None:
            nonlocal made
            made = part * duration
            if progress is not None:
                progress(part)

        self._note(self._tally_after(duration))
        try:
            longer = self._driver.follow(path, duration, record, moved, watch)
            made = duration + longer
        finally:
            after = self._tally_after(made)
            self.seconds, self.rehearsed = after.seconds, after.rehearsed
            self._note(after)
        return longer

    def motion(self, released: float = 0.0) -> MotionTally:
        """Return how the arm was moved, with the s for which it was released."""
        return MotionTally(
            self.seconds + released, self.rehearsed, self.check.samples, self.check.used,
            self.check.most,
        )  # fmt: skip

    def _tally_after(self, seconds: float) -> MotionTally:
        """Return how it was moved after so many s of a path."""
        before = self.motion()
        if self.rehearsing:
            return replace(before, rehearsed=before.rehearsed + seconds)
        return replace(before, seconds=before.seconds + seconds)
