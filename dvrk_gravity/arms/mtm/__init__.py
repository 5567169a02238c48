"""What is true of the da Vinci's master arms alone: gY(q) beta, the parallelogram, the names."""

from dvrk_gravity.arms.mtm import defaults
from dvrk_gravity.arms.mtm.bodies import BODIES, JOINT_NAMES, N_JOINTS, beta_tree, is_mtm

__all__ = ["BODIES", "JOINT_NAMES", "N_JOINTS", "beta_tree", "defaults", "is_mtm"]
