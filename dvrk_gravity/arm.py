"""The arm, and the MTM's joints, under the names that they had."""

from dvrk_gravity.arms.arm import SUPPORTED, Arm, gravity_in_base
from dvrk_gravity.arms.description import GRAVITY, Array, Joint
from dvrk_gravity.arms.mtm.parallelogram import JOINT_NAMES

N_JOINTS = len(JOINT_NAMES)

__all__ = [
    "GRAVITY", "JOINT_NAMES", "N_JOINTS", "SUPPORTED", "Arm", "Array", "Joint", "gravity_in_base",
]  # fmt: skip
