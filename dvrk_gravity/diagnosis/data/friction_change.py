"""Friction that changes from day to day: what counts as such, and what is worth reporting."""

from __future__ import annotations

import numpy as np

from dvrk_gravity.arrays import Array, Mask

# Standard deviation of the relative change of a joint's friction since calibration. A PSM that was
# recorded twice in one motion: the efforts of its four instrument motors, nearly all of them
# friction, differ by 24 to 40 % (docs/psm.md).
FRICTION_PART = 0.3
_DEVIATIONS = 2.0  # beyond which a change of friction is reported; a convention
_SHARED = 0.5  # of a torque that scaled friction must reproduce to count as its change. Chosen


def friction_change(friction: Array, error: Array) -> Array:
    """Return (n,) relative change of each joint's friction that is not worth reporting.

    It is what the other joints' friction changed by, since a day changes many of them, and at most
    :data:`FRICTION_PART`, both within two standard deviations. Zero without friction.

    Args:
        friction: (R, n) of the model.
        error: (R, n) of the model, without what other causes explain.
    """
    rubbing = friction.any(axis=0)
    change = part_of_friction(error, friction)
    other_joints = max(int(rubbing.sum()) - 1, 1)
    elsewhere = np.sqrt(np.maximum((change**2).sum() - change**2, 0.0) / other_joints)
    return np.where(rubbing, _DEVIATIONS * np.minimum(FRICTION_PART, elsewhere), 0.0)


def part_of_friction(torque: Array, friction: Array) -> Array:
    """Return (n,) the factor of (R, n) friction that is closest to a torque, by least squares."""
    square = (friction**2).sum(axis=0)
    return np.asarray((friction * torque).sum(axis=0) / np.where(square > 0.0, square, 1.0))


def like_friction(torque: Array, friction: Array) -> Mask:
    """Return (n,) where a factor of (R, n) friction reproduces most of a torque."""
    square, friction_square = (torque**2).sum(axis=0), (friction**2).sum(axis=0)
    shared = (friction * torque).sum(axis=0) ** 2 > _SHARED * square * friction_square
    return np.asarray(shared & (square > 0.0))


def like_changed_friction(
    torque: Array, friction: Array, most: Array, of_friction: bool = False
) -> Mask:
    """Return (n,) where a torque may be a change of friction since calibration.

    Friction may change in any shape, and a motor's at all of its joints together; another effect
    looks like its change where scaled friction reproduces most of it.

    Args:
        torque: (R, n) of a hypothesis.
        friction: (R, n) of the model.
        most: (n,) see :func:`friction_change`.
        of_friction: The hypothesis is about friction.
    """
    square, friction_square = (torque**2).sum(axis=0), (friction**2).sum(axis=0)
    acts = (square > 0.0) & (friction_square > 0.0)
    if of_friction:
        # Relative to each joint's friction, weighted by it.
        part = np.where(acts, square / np.where(acts, friction_square, 1.0), 0.0)
        return np.asarray(acts & bool((part * part).sum() <= (part * most**2).sum()))
    factor = part_of_friction(torque, friction)
    return np.asarray(acts & like_friction(torque, friction) & (np.abs(factor) <= most))
