"""Recursive inverse dynamics of serial chains, with the reactions of every joint.

A mechanism is described as the document on recursive inverse dynamics describes
it (links, joints of type 0, 1 or 2, external forces and moments, gravity flag);
Pinocchio computes the dynamics.

    mechanism, motion = read("config/exercises/3_2_with_gravity.yaml")
    loads = inverse_dynamics(mechanism, motion.q, motion.qd, motion.qdd)
    loads.tau, loads.reactions
"""

from dvrk_gravity.newton_euler.dynamics import JointLoads, inverse_dynamics, pinocchio_model
from dvrk_gravity.newton_euler.mechanism import (
    JointType,
    Link,
    LinkJoint,
    Mechanism,
    rotation_matrix,
)
from dvrk_gravity.newton_euler.reader import JointMotion, parse, read

__all__ = [
    "JointLoads",
    "JointMotion",
    "JointType",
    "Link",
    "LinkJoint",
    "Mechanism",
    "inverse_dynamics",
    "parse",
    "pinocchio_model",
    "read",
    "rotation_matrix",
]
