"""What a file of a recording holds: arrays of some joints, as they were read, not yet checked."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arms import Arm
from dvrk_gravity.arms.shipped import larger_arm
from dvrk_gravity.errors import RecordingError

Coordinates = Literal["joint", "actuator"]
TimeBase = Literal["stamp", "receive"]
Storage = Literal["sqlite3", "mcap"]
Array = NDArray[np.float64]

QUANTITIES = ("position", "velocity", "effort")
CHUNK = 10_000  # samples read at a time
LARGEST = 1e12  # no reading of a robot; keeps squares and sums finite


@dataclass(frozen=True, eq=False)
class Samples:
    """N samples of n joints: what readers of files return and writers take.

    Attributes:
        joints: Names of the n columns; joints that were not recorded are left out. Of an arm, they
            are in its order.
        time: ``(N,)`` s, strictly increasing, relative to ``start_ns`` (so the first sample
            of a file is at 0; a slice keeps its own times). ``None``: static poses.
        position: ``(N, n)`` rad or m.
        velocity: ``(N, n)`` rad/s or m/s, or ``None`` where not recorded.
        effort: ``(N, n)`` N·m or N that the actuators apply, or ``None`` where not recorded.
        direction: ``(N, n)``, +1 or -1: how a static pose was approached, or ``None``.
        coordinates: ``"joint"`` (what measured_js publishes) or ``"actuator"`` (motors).
        source: File or folder that it came from.
        start_ns: Absolute stamp of time 0, ns; 0 where the file does not tell.
        invalid: Number of messages left out because they carried stamp 0, which is how the
            dVRK marks invalid data.
        repeated: Number of samples left out because they carried the stamp of the sample before.
        arm: Whose joints these are; ``None`` where it is not known: then nothing tells units apart.
    """

    joints: tuple[str, ...]
    time: Array | None
    position: Array
    velocity: Array | None = None
    effort: Array | None = None
    direction: Array | None = None
    coordinates: Coordinates = "joint"
    source: str = "recording"
    start_ns: int = 0
    invalid: int = 0
    repeated: int = 0
    arm: Arm | None = None

    def __len__(self) -> int:
        """Return the number of samples N."""
        return self.position.shape[0]


def check_joints(source: str, names: Collection[str], arm: Arm | None) -> None:
    """Check that a file's joints are not those of a larger arm, of which these are a part.

    Raises:
        RecordingError: They are.
    """
    other = larger_arm(arm.name, names) if arm else ""
    if arm and other:
        raise RecordingError(
            source, f"has the joints of arm {other}, expected those of {arm.name} alone"
        )
