"""A simulated endoscope arm that is released through ROS."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.compensate import MotionError
from dvrk_gravity.ros import PRIVATE
from dvrk_gravity.simulate import PlantFile

ARM = Arm.load("ecm")
MODEL = PlantFile.of(ARM).model
NAMESPACE = f"{PRIVATE}/ECM"


def stalled(error: str) -> bool:
    """Return whether this machine stood still for a second: then the arm is held, rightly."""
    return any(words in error for words in ("hold", "was heard", "no valid", "to command"))


def patiently(release: Callable[[], np.ndarray]) -> np.ndarray:
    """Release an arm, and once more where the machine stood still."""
    for _ in range(5):
        try:
            return release()
        except MotionError as error:
            if not stalled(str(error)):
                raise
    raise AssertionError("this machine stands still again and again")
