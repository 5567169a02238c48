"""Numbers of a master arm: defaults for programs that move it, link sizes, published errors."""

from __future__ import annotations

import numpy as np

NODE_DEFAULTS: dict[str, tuple[float, ...]] = {
    "slew_limit": (20.0, 20.0, 20.0, 5.0, 2.0, 2.0, 1.0),  # N·m/s
    # A tenth of 1.4 times the fastest motions in a published exciting trajectory of an MTM;
    # `benchmark/passivity.py` holds with it, and with delays not with twice as much. rad/s
    "friction_compensation.allowance": (0.4, 0.4, 0.4, 0.8, 0.8, 0.8, 2.5),
    # 1.4 times the fastest motion of the first joints and of the roll axis in a published
    # exciting trajectory of an MTM (2.95, 2.76, 1.07 and 17.7 rad/s), rounded; a hand leads
    # the wrist's other joints at 10 to 15 rad/s.
    "speed_limit": (4.0, 4.0, 4.0, 15.0, 15.0, 15.0, 25.0),
}
"""By parameter's name: (7,) defaults that are not the same for all joints."""

USED_RANGE = (0.7, 0.8, 0.7, 0.7, 0.6, 0.7, 0.25)
"""(7,) part of a joint's range that a simulated arm's motion uses: roll turns more than it need."""

SIMULATED_VELOCITY = (0.8, 0.8, 0.8, 1.5, 2.0, 2.0, 4.0)  # rad/s
SIMULATED_ACCELERATION = (4.0, 4.0, 4.0, 8.0, 10.0, 10.0, 20.0)  # rad/s^2
"""What a careful operator would ask of an MTM that goes from here to there."""

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
EXCITED_RANGE = (0.9, 0.9, 0.9, 0.9, 0.9, 0.9, 0.3)
"""(7,) part of what is left that an exciting motion uses: roll turns far more than it need."""
FOLLOWING_ERROR = np.radians([8.0, 8.0, 8.0, 8.0, 8.0, 8.0, 12.0])
"""(7,) greatest following error, rad: twice the 4 and 6 deg within which
the console takes a goal for reached (sawIntuitiveResearchKit, mtsIntuitiveResearchKitMTM.cpp)."""
# Within the range on which the arm of the example model was calibrated.
DEMONSTRATED_POSES = np.radians(
    [
        [0.0, 0.0, 0.0, 0.0, 90.0, 0.0, 0.0],
        [-10.0, 20.0, -15.0, 40.0, 60.0, 20.0, 30.0],
        [-20.0, 10.0, 20.0, -50.0, 120.0, -25.0, -60.0],
    ]
)
INITIAL_POSITION = (0.0, 0.0, 0.0, 0.0, np.pi / 2, 0.0, 0.0)
"""(7,) rad, where a simulated arm is at first."""


PUBLISHED_ERROR = {
    "outer_yaw": 0.082,
    "shoulder_pitch": 0.163,
    "elbow_pitch": 0.191,
    "wrist_platform": 0.223,
    "wrist_pitch": 0.280,
    "wrist_yaw": 0.235,
    "wrist_roll": 0.340,
}
"""By joint, as a part of its torque, of another motion than the one fitted: the larger of weighted
least squares and a convex fit, by the authors of WPI-AIM/dvrk_dynamics_identification."""


SIZES = {  # mass kg, extent m
    "link1": [1.0, 0.15],
    "link2": [0.8, 0.3],
    "crank": [0.2, 0.1],
    "link3": [0.4, 0.35],
    "bar": [0.3, 0.3],
    "link4": [0.4, 0.2],
    "link5": [0.15, 0.12],
    "link6": [0.1, 0.08],
    "link7": [0.05, 0.04],
}
