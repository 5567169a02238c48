"""Where an arm is released under compensation, and whether its model is sure to hold it there."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.calibration.settings import CalibrationSettings
from dvrk_gravity.errors import PlanError
from dvrk_gravity.identification import POOR, Fit
from dvrk_gravity.model import TORQUE, TorqueModel
from dvrk_gravity.planning import PlanLimits, Straight, resting_positions, slacks

PART = 0.5  # of the limits, on the way from pose to pose
WITHIN = 1.96  # standard deviations: 95 % of a normal distribution
_DRAWS = 1000  # poses among which those are chosen
_ROUNDING = 1e-9


def release_poses(
    arm: Arm, limits: PlanLimits, model: TorqueModel, fitted: Array, settings: CalibrationSettings,
    seed: int, start: Array,
) -> tuple[Array, float]:  # fmt: skip
    """Return (k, n) poses within the identified range that nothing was fitted on, and how far.

    They are random, and visited in an order in which all limits are kept on the straight ways
    between them.

    Args:
        arm: The arm.
        limits: What is kept.
        model: The model; its range is that of the poses.
        fitted: (N, n) measured positions of all that was fitted, rad or m.
        settings: How many poses, and how far from those.
        seed: Of the poses.
        start: (n,) where the arm is, rad or m.

    Returns:
        The poses, and the least distance of one from a fitted sample, rad (``Arm.scale``), of the
        joint that is furthest.

    Raises:
        PlanError: There is no such pose.
    """
    found = random_poses(arm, limits, model, seed)
    distance = np.array(
        [np.abs((fitted - q) / arm.scale).max(axis=1).min(initial=np.inf) for q in found]
    )
    left = [k for k in range(len(found)) if distance[k] >= settings.min_distance][
        : 2 * settings.poses
    ]
    order: list[int] = []
    where = start
    while left and len(order) < settings.poses:
        # The nearest of so many as are still wanted: of all, poses would lie beside each other.
        some = left[: settings.poses - len(order)]
        some.sort(key=lambda k: Straight.within(where, found[k], limits, PART).duration)
        near = next((k for k in some if _is_clear(where, found[k], limits, arm, model)), None)
        if near is None:
            left = left[len(some) :]
            continue
        left.remove(near)
        order.append(near)
        where = found[near]
    if not order:
        raise PlanError("no pose within the identified range can be reached within the limits")
    return found[order], float(distance[order].min())


def settle_constants(model: TorqueModel, poses: Array, drift: Array, allowed: float) -> TorqueModel:
    """Return a model whose constant torques a release has settled, as far as it did.

    An arm that stays where it is let go feels what the model commands, but for what friction
    holds: a bias of its readings would push it away. Stiction alone may hold it at one pose; each
    joint counts that stayed on both sides of the middle of its identified range, at all poses.

    Args:
        model: The model, its constants in doubt.
        poses: (k, n) measured positions at which it was released, rad or m.
        drift: (k, n) how far each joint went, rad or m.
        allowed: Greatest drift of an arm that stays, rad (``Arm.scale``).
    """
    arm, known = model.arm, model.uncertainty
    lower, upper = arm.range if known is None else (known.lower, known.upper)
    middle = 0.5 * (lower + upper) + model.joint_offset
    stayed = bool((drift <= allowed * arm.scale).all())
    both = (poses < middle).any(axis=0) & (poses > middle).any(axis=0)
    felt = (model.constant != 0.0) & both & stayed
    if not felt.any():
        return model
    names = ", ".join(name for name, is_felt in zip(arm.joint_names, felt, strict=True) if is_felt)
    settled = f"{names}: {TORQUE} (stayed where it was released, at {len(poses)} poses)"
    return replace(
        model,
        constant=np.where(felt, 0.0, model.constant),
        constant_is="; ".join(filter(None, (model.constant_is, settled))),
    )


def random_poses(arm: Arm, limits: PlanLimits, model: TorqueModel, seed: int) -> Array:
    """Return (k, n) random poses within the limits and the range that a model was identified on.

    Raises:
        PlanError: There is none.
    """
    known, random = model.uncertainty, np.random.default_rng(seed)
    if known is not None:
        limits = replace(
            limits,
            lower=np.maximum(limits.lower, known.lower + model.joint_offset),
            upper=np.minimum(limits.upper, known.upper + model.joint_offset),
        )
    found = resting_positions(limits, arm, model, random, _DRAWS)
    return np.asarray(found[random.permutation(len(found))])


def _is_clear(start: Array, goal: Array, limits: PlanLimits, arm: Arm, model: TorqueModel) -> bool:
    """Return whether a straight way keeps all limits; of positions, its ends decide."""
    way = Straight.within(start, goal, limits, PART)
    return all(
        each.left >= -_ROUNDING
        for each in slacks(way, limits, arm, model)
        if each.limit in ("effort", "distance")
    )


def friction_hold_share(
    fit: Fit, limits: PlanLimits, settings: CalibrationSettings, seed: int
) -> dict[str, Any]:
    """Return at which part of random poses friction is sure to hold all joints, and each of them.

    Poses are drawn as those of a release. Of a model that is unfit, none.

    Args:
        fit: The identification.
        limits: What poses keep.
        settings: Part of its friction that the arm has.
        seed: Of the poses.

    Returns:
        ``part`` of poses with all joints held, the joint held ``least``, and ``joints``: the part
        of each, by name.
    """
    model, arm = fit.model, fit.model.arm
    if model.verdict == POOR:
        return {"part": 0.0, "least": "", "joints": {}}
    sure = hold_ratio(fit, random_poses(arm, limits, model, seed), settings.friction) < 1.0
    joints = dict(zip(arm.joint_names, sure.mean(axis=0).tolist(), strict=True))
    least = min(joints, key=lambda name: joints[name])
    return {"part": float(sure.all(axis=1).mean()), "least": least, "joints": joints}


def hold_ratio(fit: Fit, poses: Array, part: float) -> Array:
    """Return (k, n) 95 % bands of the torque at rest, over a part of each joint's dry friction.

    Below 1 that friction holds the arm. What the model lacks counts (:attr:`Fit.rest_error`).

    Args:
        fit: The identification.
        poses: (k, n) measured positions, rad or m.
        part: Of its friction that the arm has.
    """
    friction = np.array([fit.holding[name].friction for name in fit.model.arm.joint_names])
    with np.errstate(divide="ignore"):
        return np.asarray(WITHIN * fit.rest_error(poses) / (part * friction))
