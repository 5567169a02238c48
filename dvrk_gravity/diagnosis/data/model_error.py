"""How the torque of a model under test may be off, by its own account."""

from __future__ import annotations

import numpy as np

from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.diagnosis.data.motion import MeasuredMotion
from dvrk_gravity.diagnosis.data.reference_error import FRICTION_BY_LOAD, reference_columns
from dvrk_gravity.effects import State
from dvrk_gravity.model import CalibrationSamples, ModelUncertainty

# Extrapolation, with the known error as unit; never more than a joint can exert.
#
# Standard deviation of each power below where a joint is as far outside the identified range as the
# range is wide. Chosen: simulated cables and springs of other shapes than the model's were off by
# four times the error at a tenth of the range outside, by thirteen half of it outside
# (benchmark/lab_trials.py, seeds 0 to 8 of mtmr, mtml, ur5, panda and chain).
_GROWTH = 25.0
_POWERS = 3  # of the distance from the range's edge: cables of any smooth shape. Chosen
# Range widths outside, beyond which torque may be any function of position: a cubic that is off by
# an error within a range may be off by 26 times that there (Chebyshev's polynomial, at two).
_FARTHEST = 0.5
_SHAPES = 6  # powers of the distance that span such a function, as many as a cable has
_FASTER = 10.0  # standard deviation at twice the highest identified speed. Chosen

# Standard deviation of the relative change of a joint's friction since calibration. A PSM that was
# recorded twice in one motion: the efforts of its four instrument motors, nearly all of them
# friction, differ by 24 to 40 % (docs/psm.md).
FRICTION_PART = 0.3
_DEVIATIONS = 2.0  # beyond which a change of friction is reported; a convention
_SHARED = 0.5  # of a torque that scaled friction must reproduce to count as its change. Chosen


def friction_torque(motion: MeasuredMotion) -> Array:
    """Return the (N, n) torque of friction that may have changed since calibration, N·m.

    Zero for a model without uncertainty, for friction stated in an arm's file, and for poses.
    """
    if motion.model.uncertainty is None or motion.model.of_file or motion.static:
        return np.zeros(motion.q.shape)
    return motion.friction


def friction_variation(motion: MeasuredMotion) -> Array:
    """Return (n,) RMS torque by which a model's friction varies from day to day, N·m."""
    return np.asarray(FRICTION_PART * np.sqrt(np.mean(friction_torque(motion) ** 2, axis=0)))


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


def model_columns(motion: MeasuredMotion) -> Array:
    """Return (N, n, d) torques by which a model may be off, one standard deviation each.

    In d independent directions: its parameters' posterior, its extrapolation outside the range that
    it was identified on, and friction that grows with load. None without an uncertainty; beside a
    reference recording, :func:`reference_columns`.
    """
    if motion.reference is not None:
        return reference_columns(motion)
    model = motion.model
    uncertainty = model.uncertainty
    if uncertainty is None:
        return np.zeros((*motion.q.shape, 0))
    at_rest = motion.static
    state = State(
        motion.true_q,
        None if at_rest else motion.qd,
        None if at_rest else motion.qdd,
        motion.direction if at_rest else None,
    )
    torque = uncertainty.torque(model.terms, state)
    if uncertainty.offset.any():
        torque -= motion.slope @ uncertainty.offset
    return np.concatenate([torque, _extrapolated(motion, uncertainty), friction_by_load(motion)], 2)


def _extrapolated(motion: MeasuredMotion, uncertainty: ModelUncertainty) -> Array:
    """Return (N, n, e) torques by which joints outside the identified range may be off."""
    columns = []
    for joint in np.flatnonzero(motion.present).tolist():
        most = motion.arm.joints[joint].effort_limit
        error = float(np.nan_to_num(uncertainty.error[joint]))
        low, high = uncertainty.lower[joint], uncertainty.upper[joint]
        width = max(high - low, 1e-9)
        q, qd = motion.true_q[:, joint], motion.qd[:, joint]
        for beyond in (q - high, low - q):
            away = np.maximum(beyond, 0.0) / width
            farthest = float(away.max(initial=0.0))
            columns += [
                (joint, np.minimum(_GROWTH * error * away**power, most))
                for power in range(1, _POWERS + 1)
            ]
            if farthest > _FARTHEST:
                columns += [
                    (joint, most * (away / farthest) ** power) for power in range(1, _SHAPES + 1)
                ]
        faster = np.maximum(np.abs(qd) / max(uncertainty.speed[joint], 1e-9) - 1.0, 0.0)
        faster = np.minimum(_FASTER * error * np.nan_to_num(faster), most)
        columns.append((joint, np.sign(qd) * faster))
    columns = [(joint, column) for joint, column in columns if column.any()]
    torque = np.zeros((*motion.q.shape, len(columns)))
    for index, (joint, column) in enumerate(columns):
        torque[:, joint, index] = column
    return torque


def friction_by_load(motion: MeasuredMotion) -> Array:
    """Return (N, n, m) torques by which friction differs since loads do, N·m, for m joints.

    Identified Coulomb friction includes what came of the loads of calibration, on average. Friction
    under other loads would otherwise be reported as changed friction.
    """
    joints, samples = joints_rubbing_by_load(motion), _calibration(motion)
    columns = np.zeros((*motion.q.shape, len(joints)))
    if samples is None:
        return columns
    model = motion.model
    state = State(samples.q - model.joint_offset, samples.qd, samples.qdd)
    transmitted = [term.torque(state) for term in model.terms if not term.FRICTION]
    then = np.abs(sum(transmitted, np.zeros(state.q.shape)))
    now = np.abs(motion.modelled - motion.friction)
    for index, joint in enumerate(joints):
        heavier = now[:, joint] - then[:, joint].mean()
        sign = motion.sign(np.eye(motion.arm.n)[joint])
        columns[:, joint, index] = FRICTION_BY_LOAD * heavier * sign
    return columns


def joints_rubbing_by_load(motion: MeasuredMotion) -> list[int]:
    """Return the joints that :func:`friction_by_load` has a column for, in order."""
    if _calibration(motion) is None:
        return []
    rubs = motion.moves & motion.arm.rubs & motion.friction.any(axis=0)
    return [int(joint) for joint in np.flatnonzero(rubs)]


def _calibration(motion: MeasuredMotion) -> CalibrationSamples | None:
    """Return the samples that the model was identified on, where friction may have changed."""
    model = motion.model
    if model.uncertainty is None or model.of_file or motion.static:
        return None
    return model.uncertainty.calibration
