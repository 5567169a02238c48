"""Recursive inverse dynamics of serial chains, with the reactions of every joint.

A mechanism is described as the document on recursive inverse dynamics describes
it (links, joints of type 0, 1 or 2, external forces and moments, gravity flag);
Pinocchio computes the dynamics.

    mechanism, motion = read("config/exercises/3_2_with_gravity.yaml")
    loads = inverse_dynamics(mechanism, motion.q, motion.qd, motion.qdd)
    loads.tau, loads.reactions
"""

from dvrk_gravity.faces import attach

__getattr__, __dir__, __all__ = attach(__spec__)
