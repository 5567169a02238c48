"""Closed-form gravity model of the dVRK master arm, ``tau = Y(q) beta``; see ``arms/mtm``."""

from dvrk_gravity.arms import (
    BETA_NAMES,
    COLUMNS,
    GRAVITY,
    JOINTS,
    LENGTHS,
    LINKS,
    Lengths,
    LinkMass,
    beta_from_links,
    beta_from_pinocchio,
    regressor,
    torque,
)

__all__ = [
    "BETA_NAMES",
    "COLUMNS",
    "GRAVITY",
    "JOINTS",
    "LENGTHS",
    "LINKS",
    "Lengths",
    "LinkMass",
    "beta_from_links",
    "beta_from_pinocchio",
    "regressor",
    "torque",
]
