"""Friction that grows with what a joint transmits, which no term of a model has."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.motion import MeasuredMotion
from dvrk_gravity.effects import State
from dvrk_gravity.model import CalibrationSamples, TorqueModel


@dataclass(frozen=True)
class FrictionByLoadSettings:
    """How friction may grow.

    Attributes:
        part: Standard deviation of the part of the transmitted torque that is friction. Chosen:
            harmonic drives lose some per cent (Taghirad and Bélanger 1998); two joints of a UR10e 7
            and 8 % (docs/own_arm.md), and no more than twice the standard deviation.
    """

    part: float = 0.04


def friction_by_load(
    motion: MeasuredMotion, settings: FrictionByLoadSettings | None = None
) -> Array:
    """Return (N, n, m) torques by which friction may differ since loads do, N·m, of m joints.

    Coulomb friction as it was identified has what came of the loads of then, on average. What
    loads differ from that has come as a joint's friction that changed, which it is not.

    None of a model that does not know what it was identified on, and where it has no friction.
    """
    settings, model, joints = settings or FrictionByLoadSettings(), motion.model, of_joints(motion)
    samples, columns = _samples(motion), np.zeros((*motion.q.shape, len(joints)))
    if samples is None:
        return columns
    now = np.abs(motion.modelled - motion.friction)
    then = np.abs(
        _transmitted(model, State(samples.q - model.joint_offset, samples.qd, samples.qdd))
    )
    for index, joint in enumerate(joints):
        heavier = now[:, joint] - then[:, joint].mean()
        sign = motion.sign(np.eye(motion.arm.n)[joint])
        columns[:, joint, index] = settings.part * heavier * sign
    return columns


def of_joints(motion: MeasuredMotion) -> list[int]:
    """Return the joints that :func:`friction_by_load` has a column of, in order."""
    if _samples(motion) is None:
        return []
    rubs = motion.moves & motion.arm.rubs & motion.friction.any(axis=0)
    return [int(joint) for joint in np.flatnonzero(rubs)]


def _samples(motion: MeasuredMotion) -> CalibrationSamples | None:
    """Return what the model was identified on, if that tells of friction in this motion."""
    model = motion.model
    if model.uncertainty is None or model.of_file or motion.static:
        return None
    return model.uncertainty.calibration


def _transmitted(model: TorqueModel, state: State) -> Array:
    """Return (N, n) torque of a model without its friction."""
    torques = (term.torque(state) for term in model.terms if not term.FRICTION)
    return sum(torques, np.zeros(state.q.shape))
