"""What moves an arm along a path and reads it: through ROS, or a plant in this process."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, Self

from dvrk_gravity.arrays import Array
from dvrk_gravity.compensate import Sample

States = tuple[Array, Array, Array]  # positions, velocities, accelerations, rad or m and s


# A way from rest to rest: position, velocity, acceleration, (n,) each, at a time, s; or (N, n) at
# (N,) times.
Path = Callable[[float | Array], States]
# Receives every believed measurement, and where on the path the set point is then, s; raises
# MotionError to stop the arm.
Watch = Callable[[Sample, float], None]


class Driver(Protocol):
    """Moves an arm (context manager, which holds it at the end if it was moved)."""

    @property
    def topic(self) -> str:
        """Full name of the ``measured_js`` that is recorded."""

    def __enter__(self) -> Self:
        """Begin."""

    def __exit__(self, *_: object) -> None:
        """Hold the arm if it was moved."""

    def connect(self) -> Array:
        """Wait for the arm, and return its (n,) rest position, rad or m.

        Raises:
            MotionError: No arm, or one that must not be moved.
        """

    def follow(
        self,
        path: Path,
        duration: float,
        record: Callable[[bytes], None] | None = None,
        progress: Callable[[float], None] | None = None,
        watch: Watch | None = None,
    ) -> float:
        """Drive the arm along a path; hold it if anything ends that early.

        Args:
            path: The way, from where the arm is.
            duration: s.
            record: Receives every measured_js, as CDR bytes, while the arm moves.
            progress: Receives the completed part, 0 to 1, with every set point.
            watch: Looks at every measurement.

        Returns:
            Excess over ``duration``, s of the arm's clock.

        Raises:
            MotionError: The arm does not follow, is not heard, or must not be moved any more.
        """

    def hold(self) -> None:
        """Hold the arm where it comes to rest, if it was moved.

        Raises:
            MotionError: The arm has not acknowledged it.
        """
