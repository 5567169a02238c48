"""By what two recordings of one motion may differ without a cause that is worth telling."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.load_friction import FrictionByLoadSettings
from dvrk_gravity.diagnosis.motion import MeasuredMotion
from dvrk_gravity.diagnosis.nearby import NearbyTorque
from dvrk_gravity.effects import mean_slope_by_delay
from dvrk_gravity.estimation import NORMAL_95

_EACH, _OF_SPRING, _OF_FRICTION = 6, 3, 4  # columns of a joint, the last two of its friction


@dataclass(frozen=True)
class ReferenceErrorSettings:
    """How friction, springs and efforts may differ from the reference's.

    How friction grows with load is one number, with a model as with a reference
    (``FrictionByLoadSettings``).

    Attributes:
        by_inertia: Standard deviation of the part by which the inertia of what changed reads larger
            or smaller: drives that give way swing further than their motors (of f / f0 squared, at
            f of a drive's natural frequency f0), and efforts are not read when positions are.
            Chosen; a PSM's weight, of which only inertia tells the mass, reads a tenth light
            against one of two days (docs/psm.md).
        by_clock: Standard deviation of the time, s, by which efforts are read sooner or later after
            positions than they were. Chosen: half the interval of a recording at 1 kHz.
        by_sitting: Standard deviation of the part by which friction differs between two recordings
            of one sitting, since it falls with warmth; a third of what it does from one day to
            another (``FrictionChangeSettings``). Chosen: with three times that, friction that has
            doubled is not reported.
        beyond: Times that, from which on it is no other day's. A convention: two standard
            deviations.
        exchanged: Correlation of a spring of another day with what is told of its joint, from which
            on that is such a spring itself. Chosen.
        by_cable: Standard deviation of what cables and springs hold otherwise at the ends of the
            way, as a part of the joint's torque. Chosen by a PSM's two days, whose pitch differs by
            0.1 to 0.25 of it (docs/psm.md); charged to a weight, that took the true one out of its
            interval. No constant: that is told as the zero of an effort.
    """

    by_inertia: float = 0.1
    by_clock: float = 0.0005
    by_sitting: float = 0.1
    by_cable: float = 0.1
    beyond: float = 2.0
    exchanged: float = 0.9


def reference_columns(
    motion: MeasuredMotion, settings: ReferenceErrorSettings | None = None
) -> Array:
    """Return (N, n, d) torques by which a difference may be off, of one standard deviation each.

    Of every joint that moves: friction of which the transmitted torque has grown, inertia of what
    changed, efforts read later, springs that pull otherwise, and friction that is another one.
    """
    settings = settings or ReferenceErrorSettings()
    joints = np.flatnonzero(motion.moves).tolist()
    # Not the measured difference: noise in a column would explain itself.
    assert motion.reference is not None
    changed = NearbyTorque.fit(motion, motion.residual)
    load = changed.inertial_torque(motion)
    inertia = changed.inertial_torque(motion, np.zeros(3))
    grown = np.abs(motion.reference + load) - np.abs(motion.reference)
    late = mean_slope_by_delay(motion)
    columns = np.zeros((*motion.q.shape, _EACH * len(joints)))
    middle, half = motion.travel
    size = np.sqrt(np.mean(motion.reference**2, axis=0))
    friction = NearbyTorque.fit(motion, motion.reference).friction_torque(motion)
    rubs = np.sqrt(np.mean(friction**2, axis=0))
    for index, joint in enumerate(joints):
        sign, speed = motion.sign(np.eye(motion.arm.n)[joint]), motion.qd[:, joint]
        columns[:, joint, _EACH * index] = FrictionByLoadSettings().part * grown[:, joint] * sign
        columns[:, joint, _EACH * index + 1] = settings.by_inertia * inertia[:, joint]
        columns[:, joint, _EACH * index + 2] = settings.by_clock * late[:, joint]
        along = (motion.q[:, joint] - middle[joint]) / half[joint]
        if joint not in motion.pulls_otherwise:
            columns[:, joint, _EACH * index + _OF_SPRING] = settings.by_cable * size[joint] * along
        if joint in motion.rubs_otherwise:
            continue
        # Either may take as much of the other's part.
        for column, way in enumerate((sign, speed), start=_OF_FRICTION):
            owed = rubs[joint] / max(float(np.sqrt(np.mean(way**2))), 1e-12)
            columns[:, joint, _EACH * index + column] = settings.by_sitting * owed * way
    return columns


def rubbing_otherwise(
    motion: MeasuredMotion, moved: Array, settings: ReferenceErrorSettings | None = None
) -> tuple[int, ...]:
    """Return joints whose friction differs by more than that of another day does.

    Args:
        motion: The motion.
        moved: (d,) how far each of :func:`reference_columns` had to go, in standard deviations.
        settings: How friction may differ.
    """
    settings = settings or ReferenceErrorSettings()
    friction = np.abs(moved.reshape(-1, _EACH)[:, _OF_FRICTION:]).max(axis=1, initial=0.0)
    joints = np.flatnonzero(motion.moves)
    return tuple(joints[friction > settings.beyond].tolist())


def pulling_otherwise(
    motion: MeasuredMotion, mean: Array, covariance: Array, told: Mapping[int, Sequence[int]],
    settings: ReferenceErrorSettings | None = None,
) -> tuple[int, ...]:  # fmt: skip
    """Return joints of which a constant or a spring is told beside a spring of another day.

    A spring that is at rest elsewhere than in the middle of the way is a constant and a spring:
    of the two together, the one is not told and the other forgiven. Nor is part of a spring that is
    told another day's.

    Args:
        motion: The motion.
        mean: (d + k,) how far each of :func:`reference_columns` had to go, in standard deviations,
            and the parameters of what is told.
        covariance: (d + k, d + k) of them.
        told: By joint, which of them are of its own.
        settings: How springs may differ.
    """
    settings = settings or ReferenceErrorSettings()
    deviation = np.sqrt(np.diag(covariance))
    found = []
    for index, joint in enumerate(np.flatnonzero(motion.moves).tolist()):
        spring, own = _EACH * index + _OF_SPRING, list(told.get(joint, ()))
        if not own or deviation[spring] == 0.0:
            continue
        there = abs(mean[spring]) > NORMAL_95 * deviation[spring]
        with_told = covariance[spring, own] / (deviation[spring] * deviation[own])
        if there or np.abs(with_told).max() > settings.exchanged:
            found.append(joint)
    return tuple(found)
