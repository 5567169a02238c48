"""How well models of a master arm have been published to predict it."""

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
