"""A driver whose commands are compared with the limits, at 1 kHz, before the arm moves."""

from __future__ import annotations

from collections.abc import Callable
from typing import Self

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.calibration.certificate import Moved
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
        begin = path(np.zeros(1))[0]
        turns = limits.turns(self._arm, begin[0])
        start = (begin - turns) @ limits.rows.T
        # An arm that stands outside of a limit comes in.
        lower, upper = np.minimum(lower, start[0]), np.maximum(upper, start[0])
        moments = np.append(np.arange(0.0, duration, 1.0 / RATE), duration)
        for first in range(0, len(moments), _BLOCK):
            q, qd, qdd = path(moments[first : first + _BLOCK])
            q = q - turns
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


class KeptDriver:
    """A driver that refuses to leave the limits.

    Attributes:
        check: What was compared.
        seconds: Of motion.
    """

    def __init__(
        self,
        driver: Driver,
        limits: PlanLimits,
        arm: Arm,
        note: Callable[[Moved], None] = lambda motion: None,
    ) -> None:
        """Look at nothing yet.

        Args:
            driver: Moves the arm.
            limits: What is kept.
            arm: The arm.
            note: Receives how the arm was moved, before every path: what ends the process then
                does not lose it.
        """
        self._driver, self.check, self.seconds = driver, LimitCheck(limits, arm), 0.0
        self._note = note

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
        """Wait for the arm, and return its (n,) rest position, rad or m."""
        return self._driver.connect()

    def hold(self) -> bool:
        """Hold the arm if it was moved; return whether hold was sent."""
        return self._driver.hold()

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
        self.check.look(path, duration)
        self.seconds += duration
        self._note(self.motion())
        return self._driver.follow(path, duration, record, progress, watch)

    def motion(self, released: float = 0.0, rehearsed: float = 0.0) -> Moved:
        """Return how the arm was moved, with the s for which it was released, and rehearsed."""
        seconds, of = self.seconds - rehearsed + released, self.check
        return Moved(seconds, rehearsed, of.samples, of.used, of.most)
