"""What moves an arm along a path and reads it: through ROS, or a plant in this process."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol, Self

from dvrk_gravity.arrays import Array
from dvrk_gravity.compensate import MotionError, Sample

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

    def hold(self) -> bool:
        """Hold the arm where it comes to rest, if it was moved; return whether hold was sent.

        Raises:
            MotionError: The arm has not acknowledged it.
        """


@contextmanager
def hold_on_error(hold: Callable[[], bool]) -> Iterator[None]:
    """Hold the arm if anything ends the block early, and say so where the arm is the reason.

    Args:
        hold: Holds it if it was moved, and returns whether hold was sent.

    Raises:
        MotionError: What ended the block, and whether the arm was held; or, whatever ended it, that
            the arm has not acknowledged the hold.
    """
    try:
        yield
    except BaseException as error:
        try:
            held = hold()
        except MotionError as unheld:
            raise MotionError(f"{str(error) or 'interrupted'}; {unheld}") from error
        if held and isinstance(error, MotionError):
            raise MotionError(f"{error}; sent hold") from error
        raise
