"""By how much a baseline recording may be off without a cause worth reporting."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arms import rigid_body
from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.model_error import BY_CABLE, FRICTION_BY_LOAD
from dvrk_gravity.diagnosis.data.motion import MeasuredMotion
from dvrk_gravity.effects import mean_slope_by_delay
from dvrk_gravity.estimation import NORMAL_95, solve

_EACH, _OF_SPRING, _OF_FRICTION = 6, 3, 4  # columns of a joint, the last two of its friction
# Beside a reference, standard deviations. All are chosen.
_BY_INERTIA = 0.1  # by which the inertia of a change reads larger or smaller: flexible drives swing
# further than their motors (f / f0 squared, f0 their natural frequency). A PSM's weight, of which
# only inertia shows the mass, reads a tenth light against a recording of a day before (docs/psm.md)
_BY_CLOCK = 0.0005  # s, between the sampling of positions and efforts: half the interval at 1 kHz
_BY_SITTING = 0.1  # of all friction, which falls with warmth, between two recordings of one
# sitting; a third of what it changes by from day to day: with that, doubled friction would go
# unreported
_BEYOND = 2.0  # standard deviations from which on a change of friction is reported; a convention
_EXCHANGED = 0.9  # correlation with a reported cause from which on a spring's change is that cause
# Of normal equations of unit diagonal, where the motion does not identify a link's parameters: ten
# times the square root of a double's precision.
_RIDGE = 1e-7


@dataclass(frozen=True, eq=False)
class NearbyTorque:
    """Torque of links' masses and of each joint's Coulomb and viscous friction.

    Not a usable model of the arm: inertial parameters that the motion does not identify are
    arbitrary. Only its change from one motion to a similar one is used.

    Attributes:
        links: (10 bodies,) the links' inertial parameters, in the order of ``rigid_body``.
        friction: (2, n) N·m and N·m·s/rad.
    """

    links: Array
    friction: Array

    @classmethod
    def fit(cls, motion: MeasuredMotion, target: Array | None = None) -> NearbyTorque:
        """Fit to (N, n) torques, by default the measured efforts, each joint by its own scale."""
        target = motion.effort if target is None else target
        weight = 1.0 / np.maximum(target.std(axis=0), 1e-9) * motion.present
        links, n = rigid_body.PER_LINK * len(motion.arm.bodies), motion.arm.n
        gram, right = np.zeros((links + 2 * n,) * 2), np.zeros(links + 2 * n)
        sign_and_speed = _sign_and_speed(motion)
        for rows in motion.pieces():
            inertial = motion.regressor(rows, motion.gravity)
            friction = [values[rows, :, None] * np.eye(n) for values in sign_and_speed]
            columns = np.concatenate([inertial, *friction], axis=2) * weight[:, None]
            columns = columns.reshape(-1, len(right))
            gram += columns.T @ columns
            right += columns.T @ (target[rows] * weight).ravel()
        found = solve(gram, right, _RIDGE)
        return cls(found[:links], found[links:].reshape(2, n))

    def friction_torque(self, motion: MeasuredMotion) -> Array:
        """Return (N, n) friction torques, N·m."""
        sign, speed = _sign_and_speed(motion)
        return np.asarray(self.friction[0] * sign + self.friction[1] * speed)

    def inertial_torque(self, motion: MeasuredMotion, gravity: Array | None = None) -> Array:
        """Return (N, n) torques of the links, N·m; by default in the motion's gravity."""
        return rigid_body.torque(
            motion.arm, self.links, motion.true_q, motion.qd, motion.qdd,
            motion.gravity if gravity is None else gravity,
        )  # fmt: skip


def _sign_and_speed(motion: MeasuredMotion) -> tuple[Array, Array]:
    return motion.signs, motion.qd


def baseline_columns(motion: MeasuredMotion) -> Array:
    """Return (N, n, d) torques by which a difference may be off, one standard deviation each.

    For each joint that moves: friction that grows with the transmitted torque, the inertia of what
    changed, the delay of efforts, springs, and two of the friction that changes from day to day.
    """
    joints = np.flatnonzero(motion.moves).tolist()
    # Fitted, not the measured difference: noise in a column would explain itself.
    changed = NearbyTorque.fit(motion, motion.residual)
    load = changed.inertial_torque(motion)
    inertia = changed.inertial_torque(motion, np.zeros(3))
    grown = np.abs(motion.expected + load) - np.abs(motion.expected)
    late = mean_slope_by_delay(motion)
    columns = np.zeros((*motion.q.shape, _EACH * len(joints)))
    middle, half = motion.travel
    size = np.sqrt(np.mean(motion.expected**2, axis=0))
    friction = NearbyTorque.fit(motion, motion.expected).friction_torque(motion)
    rubs = np.sqrt(np.mean(friction**2, axis=0))
    for index, joint in enumerate(joints):
        own = columns[:, joint, _EACH * index : _EACH * (index + 1)]
        sign, speed = motion.signs[:, joint], motion.qd[:, joint]
        own[:, 0] = FRICTION_BY_LOAD * grown[:, joint] * sign
        own[:, 1] = _BY_INERTIA * inertia[:, joint]
        own[:, 2] = _BY_CLOCK * late[:, joint]
        if joint not in motion.changed_springs:
            along = (motion.q[:, joint] - middle[joint]) / half[joint]
            own[:, _OF_SPRING] = BY_CABLE * size[joint] * along
        if joint in motion.changed_friction:
            continue
        for column, shape in enumerate((sign, speed), start=_OF_FRICTION):
            scale = rubs[joint] / max(float(np.sqrt(np.mean(shape**2))), 1e-12)
            own[:, column] = _BY_SITTING * scale * shape
    return columns


def changed_friction(motion: MeasuredMotion, moved: Array) -> tuple[int, ...]:
    """Return joints whose friction differs by more than from day to day.

    Args:
        motion: The motion.
        moved: (d,) fitted coefficients of :func:`baseline_columns`, in standard deviations.
    """
    friction = np.abs(moved.reshape(-1, _EACH)[:, _OF_FRICTION:]).max(axis=1, initial=0.0)
    return tuple(np.flatnonzero(motion.moves)[friction > _BEYOND].tolist())


def changed_springs(
    motion: MeasuredMotion, mean: Array, covariance: Array, causes: Mapping[int, Sequence[int]]
) -> tuple[int, ...]:
    """Return joints where a reported constant or spring is partly absorbed by day-to-day springs.

    A spring whose rest position is not the middle of the travel is a constant plus a spring: both
    are reported, or neither.

    Args:
        motion: The motion.
        mean: (d + k,) coefficients of :func:`baseline_columns`, in standard deviations, and the
            parameters of the causes found.
        covariance: (d + k, d + k) of them.
        causes: By joint, which of the parameters are of causes at that joint alone.
    """
    deviation = np.sqrt(np.diag(covariance))
    found = []
    for index, joint in enumerate(np.flatnonzero(motion.moves).tolist()):
        spring, own = _EACH * index + _OF_SPRING, list(causes.get(joint, ()))
        if not own or deviation[spring] == 0.0:
            continue
        significant = abs(mean[spring]) > NORMAL_95 * deviation[spring]
        correlation = covariance[spring, own] / (deviation[spring] * deviation[own])
        if significant or np.abs(correlation).max() > _EXCHANGED:
            found.append(joint)
    return tuple(found)
