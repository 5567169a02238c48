"""What a model on trial says of itself: how its torque may be off, and its known error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.load_friction import friction_by_load
from dvrk_gravity.diagnosis.data.motion import MeasuredMotion
from dvrk_gravity.diagnosis.data.reference_error import reference_columns
from dvrk_gravity.effects import State
from dvrk_gravity.model import ModelUncertainty


@dataclass(frozen=True)
class ExtrapolationSettings:
    """How far a model may be off outside the positions and speeds that it was identified on.

    However far outside, it is off by no more than the joint can exert.

    Attributes:
        growth: Standard deviation of each of the functions below where a joint is as far outside as
            the range is wide, in units of the joint's known error. Chosen: simulated cables and
            springs of other shapes than the model's were off by four times that at a tenth of the
            range outside and by thirteen half of it (benchmark/lab_trials.py, seeds 0 to 8 of mtmr,
            mtml, ur5, panda and chain).
        powers: Powers of the distance from the range's edge: with three, cables of any smooth
            course are within reach. Chosen.
        farthest: Parts of the range's width outside it, beyond which a torque may have any course
            over the position: a cubic that is off by an error within a range may be off by 26 times
            that there (Chebyshev's polynomial of degree three, at two).
        courses: Powers of the distance that make up such a course: as many as a cable's has.
        faster: Standard deviation likewise where a joint is twice as fast as ever before. Chosen.
    """

    growth: float = 25.0
    powers: int = 3
    farthest: float = 0.5
    courses: int = 6
    faster: float = 10.0


@dataclass(frozen=True)
class FrictionChangeSettings:
    """How friction may differ from what it was when the model was identified.

    Attributes:
        part: By which all friction of a joint is another one, as a standard deviation. By so much
            an error that no cause explains is expected. From a PSM that was recorded twice in one
            motion: the efforts of its four instrument motors, nearly all of them friction, differ
            by 24 to 40 % (docs/psm.md).
        deviations: Of its changes at the other joints, by which it may change likewise, and of
            ``part``, beyond which it is told however it changed elsewhere: two, a convention.
        shared: Part of a torque that all friction times a factor must reproduce to be its change.
            Chosen.
    """

    part: float = 0.3
    deviations: float = 2.0
    shared: float = 0.5


def friction_torque(motion: MeasuredMotion) -> Array:
    """Return the (N, n) torque of a model's friction, N·m.

    Zero of a model that does not tell how sure it is, of one whose friction an arm's own file
    states, which was measured on no day, and of poses.
    """
    if motion.model.uncertainty is None or motion.model.of_file or motion.static:
        return np.zeros(motion.q.shape)
    return motion.friction


def changed_friction(
    motion: MeasuredMotion, settings: FrictionChangeSettings | None = None
) -> Array:
    """Return (n,) RMS torque by which a model's friction may be another one on another day, N·m."""
    part = (settings or FrictionChangeSettings()).part
    return np.asarray(part * np.sqrt(np.mean(friction_torque(motion) ** 2, axis=0)))


def friction_change(
    friction: Array, error: Array, settings: FrictionChangeSettings | None = None
) -> Array:
    """Return (n,) by what part the friction of each joint may be another one, without being told.

    By no more than it has changed by at the other joints, for a day changes many of them, and than
    it may by all that is known, within two standard deviations. Zero where the model has none.

    Args:
        friction: (R, n) of the model.
        error: (R, n) of the model, but for what is due to other causes.
        settings: How friction changes.
    """
    settings = settings or FrictionChangeSettings()
    rubbing = friction.any(axis=0)
    change = part_of_friction(error, friction)
    other_joints = max(int(rubbing.sum()) - 1, 1)
    elsewhere = np.sqrt(np.maximum((change**2).sum() - change**2, 0.0) / other_joints)
    likely = np.minimum(settings.part, elsewhere)
    return np.where(rubbing, settings.deviations * likely, 0.0)


def part_of_friction(torque: Array, friction: Array) -> Array:
    """Return (n,) the part of (R, n) friction that a torque is most like, by least squares."""
    square = (friction**2).sum(axis=0)
    return np.asarray((friction * torque).sum(axis=0) / np.where(square > 0.0, square, 1.0))


def like_friction(
    torque: Array, friction: Array, settings: FrictionChangeSettings | None = None
) -> NDArray[np.bool_]:
    """Return (n,) where a factor of a model's (R, n) friction reproduces most of a torque."""
    settings = settings or FrictionChangeSettings()
    square, friction_square = (torque**2).sum(axis=0), (friction**2).sum(axis=0)
    shared = (friction * torque).sum(axis=0) ** 2 > settings.shared * square * friction_square
    return np.asarray(shared & (square > 0.0))


def like_changed_friction(
    torque: Array, friction: Array, most: Array, of_friction: bool = False,
    settings: FrictionChangeSettings | None = None,
) -> NDArray[np.bool_]:  # fmt: skip
    """Return (n,) where a torque is what friction may have changed by since the model was made.

    Friction may change in any shape, and a motor's at all of its joints together; another effect
    looks like its change where a factor of the model's friction reproduces most of it.

    Args:
        torque: (R, n) of a hypothesis.
        friction: (R, n) of the model.
        most: (n,) see :func:`friction_change`.
        of_friction: The hypothesis is about friction.
        settings: How friction changes.
    """
    square, friction_square = (torque**2).sum(axis=0), (friction**2).sum(axis=0)
    acts = (square > 0.0) & (friction_square > 0.0)
    if of_friction:
        # In units of the joints' friction, for joints differ; each counts as far as it is rubbed.
        part = np.where(acts, square / np.where(acts, friction_square, 1.0), 0.0)
        return np.asarray(acts & bool((part * part).sum() <= (part * most**2).sum()))
    factor = part_of_friction(torque, friction)
    return np.asarray(acts & like_friction(torque, friction, settings) & (np.abs(factor) <= most))


def model_columns(motion: MeasuredMotion, settings: ExtrapolationSettings | None = None) -> Array:
    """Return (N, n, d) changes of the model's torque that its uncertainty allows.

    In each of d independent directions, of one standard deviation each: those of its parameters,
    of what it says outside the range that it was identified on, and of friction under other loads.
    None of a model that does not tell how sure it is.
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
    outside = _extrapolated(motion, uncertainty, settings or ExtrapolationSettings())
    return np.concatenate([torque, outside, friction_by_load(motion)], axis=2)


def _extrapolated(
    motion: MeasuredMotion, uncertainty: ModelUncertainty, settings: ExtrapolationSettings
) -> Array:
    """Return (N, n, e) torques by which joints outside the model's range may be off."""
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
                (joint, np.minimum(settings.growth * error * away**power, most))
                for power in range(1, settings.powers + 1)
            ]
            if farthest > settings.farthest:
                columns += [
                    (joint, most * (away / farthest) ** power)
                    for power in range(1, settings.courses + 1)
                ]
        faster = np.maximum(np.abs(qd) / max(uncertainty.speed[joint], 1e-9) - 1.0, 0.0)
        faster = np.minimum(settings.faster * error * np.nan_to_num(faster), most)
        columns.append((joint, np.sign(qd) * faster))
    columns = [(joint, column) for joint, column in columns if column.any()]
    torque = np.zeros((*motion.q.shape, len(columns)))
    for index, (joint, column) in enumerate(columns):
        torque[:, joint, index] = column
    return torque
