"""Motions: smooth ways from here to there, motions that excite, and the limits that they keep."""

from dvrk_gravity.planning.exciting import coverage, covering_motion, exciting_motion
from dvrk_gravity.planning.limits import MotionLimits, PairLimit, careful
from dvrk_gravity.planning.move import Move
from dvrk_gravity.planning.multisine import Multisine

__all__ = [
    "MotionLimits",
    "Move",
    "Multisine",
    "PairLimit",
    "careful",
    "coverage",
    "covering_motion",
    "exciting_motion",
]
