"""Where friction can be: at joints, and at motors that move more than a joint of their own."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.evidence import Motion
from dvrk_gravity.effects.base.site import Site
from dvrk_gravity.effects.base.unknowns import ColumnTable, ModelChange


def friction_sites(motion: Motion) -> Iterator[Site]:
    """Yield joints that move, and motors that move more than a joint of their own."""
    arm = motion.arm
    for joint, name in enumerate(arm.joint_names):
        seen = motion.moves[joint] or _both_ways(motion, joint)
        if seen and name not in arm.frictionless:
            yield Site.joint(joint)
    for motor in mixed_motors(arm):
        if motion.moves[arm.joint_to_actuator[motor] != 0.0].any() and motion.present.all():
            yield Site.motor(motor)


@lru_cache(maxsize=8)
def mixed_motors(arm: Arm) -> tuple[int, ...]:
    """Return the motors that move more than their own joint, or other joints with theirs."""
    off = np.abs(arm.joint_to_actuator - np.eye(arm.n)).max(axis=1)
    return tuple(int(motor) for motor in np.flatnonzero(off > 1e-9))


def removable(motion: Motion, where: Site, torque: Array) -> float:
    """Return how much friction of one kind takes the power that all of the model's takes there.

    Were there less by more than that, friction would drive the arm.

    Args:
        motion: The motion; of static poses, which take no power, there is no limit.
        where: A joint, or a motor that moves several.
        torque: (N,) torque at that site of one unit of the friction.
    """
    row = where.row(motion.arm)
    unit = float(torque @ (motion.qd @ row))
    if unit <= 0.0:
        return np.inf
    moved = row != 0.0
    return max(float((motion.friction * motion.qd)[:, moved].sum()), 0.0) / unit


def _both_ways(motion: Motion, joint: int) -> bool:
    """Tell whether poses at which a joint is always the same were approached from both sides."""
    return motion.direction is not None and bool(np.ptp(motion.direction[:, joint]) > 0.0)


def friction_site_kinds(arm: Arm, joint: int) -> tuple[str, ...]:
    """Return where a joint's friction may be, ``joint`` or ``motor``; nowhere if it has none."""
    at_joint = () if arm.joint_names[joint] in arm.frictionless else ("joint",)
    return (*at_joint, "motor") if joint in mixed_motors(arm) else at_joint


def likely_site_kind(arm: Arm, joint: int) -> str:
    """Return where it is likelier: at a motor that moves another joint as far as its own."""
    if arm.joint_names[joint] in arm.frictionless:
        return "motor"
    row = np.abs(arm.joint_to_actuator[joint])
    return "motor" if np.delete(row, joint).max(initial=0.0) >= row[joint] else "joint"


def likely_columns(effect: str, table: ColumnTable) -> list[int]:
    """Return the columns of a friction at each joint or, where that is likelier, at its motor."""
    return [
        index
        for joint in range(table.arm.n)
        if friction_site_kinds(table.arm, joint)
        for index in table.select(
            effect=effect, site_kind=likely_site_kind(table.arm, joint), joint=joint
        )
    ]


def where(arm: Arm, joint: int, kind: str) -> str:
    """Return what a move calls a joint, or its motor, as the site of friction."""
    name = arm.joint_names[joint]
    return f"{name} ({kind})" if len(friction_site_kinds(arm, joint)) > 1 else name


def moves_between(effect: str, table: ColumnTable, inside: set[int]) -> Iterator[ModelChange]:
    """Yield the moves of a joint's friction to its motor and back."""
    for joint in mixed_motors(table.arm):
        here, there = (
            table.select(effect=effect, site_kind=kind, joint=joint) for kind in ("joint", "motor")
        )
        for old, new, kind in ((here, there, "motor"), (there, here, "joint")):
            pairs = [
                (a, b) for a, b in zip(old, new, strict=True) if a in inside and b not in inside
            ]
            if pairs:
                gone, come = zip(*pairs, strict=True)
                text = f"{effect} {table.arm.joint_names[joint]} at the {kind}"
                yield ModelChange(come, gone, text)
