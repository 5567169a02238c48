"""How large a joint's effort plausibly is, where the arm's file states no limit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin

from dvrk_gravity.arms.description import GRAVITY, SCALES, Body, Description
from dvrk_gravity.arms.tree import nominal_inertias, pinocchio_model
from dvrk_gravity.arrays import Array

# Of the joints of ten arms of example-robot-data (panda, ur3, ur5, ur10, j2s6s200, xarm7, z1,
# so101, talos_left_arm, tiago_no_hand), a quarter state less than 2.6 times what their masses need
# in any pose and mounting, a tenth less than 1.6 times.
OVER_WEIGHT = 2.0
# Of the largest of them, where a joint carries next to nothing: the same arms' last joints state
# 0.02 to 0.5 times what the strongest joint's weight needs.
OF_LARGEST = 0.1
_KNOWN_NOTHING = pin.Inertia.FromSphere(1.0, 0.1)  # 1 kg, as link_prior has it
_POSES = 200


def with_plausible_efforts(arm: Description) -> Description:
    """Return an arm whose joints all have an effort limit: a plausible one where none is stated.

    It is twice what the masses in the file (1 kg a link, if it has none) need at most in any pose
    and mounting. A fit takes it for the size of efforts; nothing is commanded by it.
    """
    if all(joint.effort_stated for joint in arm.joints):
        return arm
    plausible = _plausible(arm).tolist()
    joints = tuple(
        joint if joint.effort_stated else replace(joint, effort_limit=effort)
        for joint, effort in zip(arm.joints, plausible, strict=True)
    )
    return replace(
        arm,
        joints=joints,
        actuator_effort_limit=np.array([joint.effort_limit for joint in joints]),
    )


def _plausible(arm: Description) -> Array:
    """Return (n,) plausible effort limits, N·m or N."""
    scale = np.array([SCALES[joint.kind] for joint in arm.joints])
    heaviest = _heaviest(arm.bodies, nominal_inertias(arm) or _nominal(arm.bodies), arm)
    # A joint that slides counts at its lever. At least what 1 kg takes at 0.1 m.
    largest = max(float((heaviest * scale).max()), GRAVITY * 0.1)
    return np.asarray(OVER_WEIGHT * np.maximum(heaviest, OF_LARGEST * largest / scale))


def _nominal(bodies: Sequence[Body]) -> dict[str, pin.Inertia]:
    """Return links of which nothing is known, off their axes."""
    away = pin.SE3(np.eye(3), np.array([0.1, 0.0, 0.0]))
    return {body.name: away.act(_KNOWN_NOTHING) for body in bodies}


def _heaviest(bodies: Sequence[Body], inertias: dict[str, pin.Inertia], arm: Description) -> Array:
    """Return (n,) largest efforts that weight takes, with gravity along each axis of the base."""
    lower, upper = np.array([[joint.lower, joint.upper] for joint in arm.joints]).T
    endless = ~np.isfinite(lower) | ~np.isfinite(upper)
    lower, upper = np.where(endless, -np.pi, lower), np.where(endless, np.pi, upper)
    poses = np.random.default_rng(0).uniform(lower, upper, (_POSES, len(lower))) @ arm.expand.T
    found = np.zeros(len(lower))
    for direction in GRAVITY * np.eye(3):
        model = pinocchio_model(bodies, inertias, direction)
        data = model.createData()
        for q in poses:
            effort = pin.computeGeneralizedGravity(model, data, q) @ arm.expand
            found = np.maximum(found, np.abs(effort))
    return found
