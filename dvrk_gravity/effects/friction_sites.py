"""Where friction can be told: joints and motors that move, or were approached from both sides."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.effects import site
from dvrk_gravity.effects.evidence import Motion


def friction_sites(motion: Motion) -> Iterator[site.Site]:
    """Yield joints that move, and motors that move more than a joint of their own."""
    arm = motion.arm
    for joint in range(arm.n):
        if motion.moves[joint] or _both_ways(motion, joint):
            yield site.joint(joint)
    for motor in mixed_motors(arm):
        if motion.moves[arm.joint_to_actuator[motor] != 0.0].any() and motion.present.all():
            yield site.motor(motor)


def mixed_motors(arm: Arm) -> list[int]:
    """Return the motors that move more than their own joint, or other joints with theirs."""
    off = np.abs(arm.joint_to_actuator - np.eye(arm.n)).max(axis=1)
    return [int(motor) for motor in np.flatnonzero(off > 1e-9)]


def _both_ways(motion: Motion, joint: int) -> bool:
    """Tell whether poses at which a joint is always the same were approached from both sides."""
    return motion.direction is not None and bool(np.ptp(motion.direction[:, joint]) > 0.0)
