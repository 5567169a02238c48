"""How far, how fast and how hard an MTM may be driven by a program."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arm import Arm

Array = NDArray[np.float64]

# Way that is left to the stops of the arm's file. On an MTMR that makes -54…29, -10…57, -45…30,
# -80…190, -85…175, -38…38, -460…430 deg: the ranges of published exciting motions of these arms and
# of the console's own calibration (joints 4 and 5), to a few degrees.
MARGIN = np.radians([11.0, 8.0, 5.0, 15.0, 10.0, 7.0, 20.0])
# Published exciting motions keep elbow_pitch, and the angle q2 + q3 of its motor, within these.
ELBOW = np.radians([-30.0, 30.0])
ELBOW_MOTOR = np.radians([-9.0, 39.0])
# What the console allows an MTM in motions that it plans itself (`move_jp`): 90 deg/s and
# 90 deg/s^2, roll 360 (limits of the trajectory in sawIntuitiveResearchKit's
# mtsIntuitiveResearchKitMTM.cpp; later versions halve the acceleration, but for roll).
VELOCITY = np.radians([90.0, 90.0, 90.0, 90.0, 90.0, 90.0, 360.0])
ACCELERATION = VELOCITY.copy()


@dataclass(frozen=True, eq=False)
class MotionLimits:
    """Limits of a planned motion.

    Attributes:
        lower: (7,) lowest joint positions, rad.
        upper: (7,) highest joint positions, rad.
        elbow_motor: (2,) lowest and highest q2 + q3, rad.
        velocity: (7,) of the joints, rad/s; that of joint 3 holds for its motor, too.
        acceleration: (7,) likewise, rad/s^2.
    """

    lower: Array
    upper: Array
    elbow_motor: Array
    velocity: Array
    acceleration: Array

    @classmethod
    def of(cls, arm: Arm) -> MotionLimits:
        """Return the limits of an MTM, left or right."""
        lower, upper = arm.lower + MARGIN, arm.upper - MARGIN
        lower[2], upper[2] = max(lower[2], ELBOW[0]), min(upper[2], ELBOW[1])
        return cls(lower, upper, ELBOW_MOTOR, VELOCITY, ACCELERATION)
