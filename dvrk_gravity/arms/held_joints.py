"""An arm with some joints held still: their links become rigid."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pinocchio as pin

from dvrk_gravity.arms.description import Description
from dvrk_gravity.errors import ConfigError

# rad or m by which a joint that is held may be elsewhere. Chosen: about 1 deg, more than a servo
# that holds moves by.
STAYS = 0.02


def hold_joints(arm: Description, where: Mapping[str, float]) -> Description:
    """Return an arm without the joints that are held.

    Args:
        arm: The arm.
        where: Position of each held joint, rad or m.

    Raises:
        ConfigError: A joint that there is not, none left, or one whose motor moves others.
    """
    names = arm.joint_names
    for name in where:
        if name not in names:
            raise ConfigError("held_joints", name, f"some of {', '.join(names)}")
    keep = [i for i, name in enumerate(names) if name not in where]
    gone = [i for i in range(len(names)) if i not in keep]
    if not keep:
        raise ConfigError("held_joints", ", ".join(where), "at least one joint that moves")
    matrix = arm.actuator_to_joint
    if matrix[np.ix_(keep, gone)].any() or matrix[np.ix_(gone, keep)].any():
        raise ConfigError(
            "held_joints",
            ", ".join(where),
            "joints whose motors move no other, and no other's them",
        )
    at = np.array([where[names[i]] for i in gone])
    bodies = []
    for body in arm.bodies:
        shift = float(body.row[gone] @ at)
        if body.kind == "revolute":
            step = pin.SE3(pin.utils.rotate("z", shift), np.zeros(3))
        else:
            step = pin.SE3(np.eye(3), np.array([0.0, 0.0, shift]))
        bodies.append(replace(body, placement=body.placement * step, row=body.row[keep]))

    def kept(values: np.ndarray | None) -> np.ndarray | None:
        return None if values is None else values[keep]

    return replace(
        arm,
        joints=tuple(arm.joints[i] for i in keep),
        bodies=tuple(bodies),
        actuator_to_joint=matrix[np.ix_(keep, keep)],
        actuator_effort_limit=arm.actuator_effort_limit[keep],
        drive_gains=kept(arm.drive_gains),
        drive_gain_error=kept(arm.drive_gain_error),
        frictionless=tuple(name for name in arm.frictionless if name not in where),
        held={**arm.held, **where},
    )


def distal_held_joints(arm: Description, recorded: tuple[str, ...]) -> dict[str, float] | None:
    """Return positions, rad or m, of unrecorded joints that lie beyond all recorded ones.

    At zero, or at the limit next to it. ``None`` if a recorded joint is carried by one that was
    not: its orientation is unknown then.
    """
    missing = [i for i, name in enumerate(arm.joint_names) if name not in recorded]
    moved = arm.expand != 0.0
    carried = moved.copy()  # (bodies, n) by the joint, or through its parent
    for index, body in enumerate(arm.bodies):
        if body.parent >= 0:
            carried[index] |= carried[body.parent]
    others = [i for i in range(len(arm.joints)) if i not in missing]
    if (carried[:, missing].any(axis=1) & moved[:, others].any(axis=1)).any():
        return None
    return {
        arm.joints[i].name: float(np.clip(0.0, arm.joints[i].lower, arm.joints[i].upper))
        for i in missing
    }
