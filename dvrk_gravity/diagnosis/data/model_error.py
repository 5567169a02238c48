"""By how much an identified model may be off without a cause worth reporting."""

from __future__ import annotations

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.motion import MeasuredMotion
from dvrk_gravity.effects import State
from dvrk_gravity.model import CalibrationSamples, ModelUncertainty

# Standard deviation of the relative change of a joint's friction since calibration. A PSM that was
# recorded twice in one motion: the efforts of its four instrument motors, nearly all of them
# friction, differ by 24 to 40 % (docs/psm.md).
FRICTION_PART = 0.3
_OF_LOAD = 6  # columns of a joint that a load may be mistaken for, by a model
_SLOW = 0.3  # of the RMS speed, about which friction falls with speed (``stribeck_friction``)
# Of the part of the transmitted torque that is friction, with a model as with a reference: harmonic
# drives lose some per cent (Taghirad and Bélanger 1998); two joints of a UR10e 7 and 8 %
# (docs/own_arm.md), and no more than twice the standard deviation.
FRICTION_BY_LOAD = 0.04
BY_CABLE = 0.1  # of a joint's torque, that cables and springs change by at the ends of its travel.
# A PSM's pitch differs by 0.1 to 0.25 of it between two days (docs/psm.md), which took the true
# weight out of its interval. A constant is reported as an effort offset instead

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


def model_columns(motion: MeasuredMotion) -> Array:
    """Return (N, n, d) torques by which a model may be off, one standard deviation each.

    In d independent directions: its parameters' posterior, its extrapolation outside the range that
    it was identified on, and friction that grows with load. None without an uncertainty.
    """
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
        torque -= np.tensordot(motion.slope, uncertainty.offset, 1)
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
        sign = motion.signs[:, joint]
        columns[:, joint, index] = FRICTION_BY_LOAD * heavier * sign
    return columns


def load_columns(motion: MeasuredMotion, load: Array) -> Array:
    """Return (N, n, d) torques that a load may be mistaken for, one standard deviation each.

    For each joint that moves: a spring and a constant that changed since, friction that grows with
    the load, and friction of the day: Coulomb, viscous, and what is more of it near zero speed,
    which a model of another speed does not show. Beside a reference, a baseline's own columns have
    springs and friction. None of a model that is exact, or stated in an arm's file.

    Args:
        motion: The motion.
        load: (N, n) torque of the load as it was found.
    """
    by_model = not motion.measured_twice
    known = not by_model or _calibration(motion) is not None
    joints = np.flatnonzero(motion.moves).tolist() if known else []
    each = _OF_LOAD if by_model else 1
    columns = np.zeros((*motion.q.shape, each * len(joints)))
    middle, half = motion.travel
    size = BY_CABLE * np.sqrt(np.mean(motion.effort**2, axis=0))
    carried = motion.modelled - motion.friction
    grown = np.abs(carried + load) - np.abs(carried)
    for index, joint in enumerate(joints):
        own = columns[:, joint, each * index : each * (index + 1)]
        own[:, 0] = size[joint]
        if not by_model:
            continue
        sign, speed = motion.signs[:, joint], motion.qd[:, joint]
        own[:, 1] = size[joint] * (motion.q[:, joint] - middle[joint]) / half[joint]
        own[:, 2] = FRICTION_BY_LOAD * grown[:, joint] * sign
        rms = float(np.sqrt(np.mean(speed**2)))
        slow = sign * np.exp(-((speed / (_SLOW * rms)) ** 2))
        level = FRICTION_PART * float(np.sqrt(np.mean(motion.friction[:, joint] ** 2)))
        own[:, 3:] = level * np.column_stack([sign, speed / rms, slow])
    return columns


def joints_rubbing_by_load(motion: MeasuredMotion) -> list[int]:
    """Return the joints that :func:`friction_by_load` has a column for, in order."""
    if _calibration(motion) is None:
        return []
    rubs = motion.moves & motion.arm.has_friction & motion.friction.any(axis=0)
    return [int(joint) for joint in np.flatnonzero(rubs)]


def _calibration(motion: MeasuredMotion) -> CalibrationSamples | None:
    """Return the samples that the model was identified on, where friction may have changed."""
    model = motion.model
    if model.uncertainty is None or model.of_file or motion.static:
        return None
    return model.uncertainty.calibration
