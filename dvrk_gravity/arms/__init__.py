"""Arms as data: what joints there are, what they move, and how far."""

from dvrk_gravity.arms.arm import GRAVITY, Arm, Body, Joint, JointKind, gravity_in_base

__all__ = ["GRAVITY", "Arm", "Body", "Joint", "JointKind", "gravity_in_base"]
