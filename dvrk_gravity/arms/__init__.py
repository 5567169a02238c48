"""Arms as data: what joints there are, what they move, and how far."""

from dvrk_gravity.arms.arm import Arm, gravity_in_base
from dvrk_gravity.arms.description import GRAVITY, Body, Joint, JointKind

__all__ = ["GRAVITY", "Arm", "Body", "Joint", "JointKind", "gravity_in_base"]
