"""By how much a baseline recording may be off without a cause worth reporting."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arms import rigid_body
from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.diagnosis.data.model_error import BY_CABLE, FRICTION_BY_LOAD
from dvrk_gravity.diagnosis.data.motion import BAND, MeasuredMotion
from dvrk_gravity.effects import mean_slope_by_delay
from dvrk_gravity.estimation import solve

_EACH, _OF_SPRING, _OF_FRICTION = 6, 3, 4  # columns of a joint, the last two of its friction
# Beside a reference, standard deviations. All are chosen.
_BY_INERTIA = 0.1  # by which the inertia of a change reads larger or smaller: flexible drives swing
# further than their motors (f / f0 squared, f0 their natural frequency). A PSM's weight, of which
# only inertia shows the mass, reads a tenth light against a recording of a day before (docs/psm.md)
_BY_CLOCK = 0.0005  # s, between the sampling of positions and efforts: half the interval at 1 kHz
_BY_SITTING = 0.1  # of all friction, which falls with warmth, between two recordings of one
# sitting; a third of what it changes by from day to day: with that, doubled friction would go
# unreported
_BEYOND = 2.0  # standard deviations from which on changed friction is reported; a convention
_BEYOND_SPRING = 1.64  # ... a changed spring: 95 % of a normal one. Chosen: at two, a spring of 1.9
# was reported as the constant that its rest position leaves (benchmark/reference_trials.py, seed 3)
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
        sign_and_speed = _sign_and_speed(motion)

        def design(rows: slice) -> Array:
            friction = [values[rows, :, None] * np.eye(n) for values in sign_and_speed]
            return np.concatenate([motion.regressor(rows, motion.gravity), *friction], axis=2)

        weight = np.broadcast_to(weight, target.shape)
        found = solve(*_normal_equations(motion, target, weight, design), _RIDGE)
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


def _normal_equations(
    motion: MeasuredMotion, target: Array, weight: Array, design: Callable[[slice], Array]
) -> tuple[Array, Array]:
    """Return (k, k) and (k,) of the (rows, n, k) columns of a design, fitted to (N, n) torques.

    Args:
        motion: N samples.
        target: (N, n) torques, N·m.
        weight: (N, n) one over their error, 1/(N·m); zero where they do not count.
        design: Returns the columns of some samples; all of them would not fit into memory.
    """
    gram, right = np.zeros(()), np.zeros(())
    for rows in motion.pieces():
        columns = design(rows) * weight[rows, :, None]
        columns = columns.reshape(-1, columns.shape[2])
        gram = gram + columns.T @ columns
        right = right + columns.T @ (target[rows] * weight[rows]).ravel()
    return gram, right


def _sign_and_speed(motion: MeasuredMotion) -> tuple[Array, Array]:
    return motion.signs, motion.qd


def baseline_columns(motion: MeasuredMotion) -> Array:
    """Return (N, n, d) torques by which a difference may be off, one standard deviation each.

    For each joint that moves: friction that grows with the transmitted torque, the inertia of what
    changed, the delay of efforts, springs, and two of the friction that changes from day to day.
    Springs and friction are zero at joints where they changed by more: all of the difference is
    reported there.
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
    spring = BY_CABLE * np.sqrt(np.mean(motion.expected**2, axis=0))
    friction = NearbyTorque.fit(motion, motion.expected).friction_torque(motion)
    rubs = np.sqrt(np.mean(friction**2, axis=0))
    for index, joint in enumerate(joints):
        own = columns[:, joint, _EACH * index : _EACH * (index + 1)]
        sign, speed = motion.signs[:, joint], motion.qd[:, joint]
        own[:, 0] = FRICTION_BY_LOAD * grown[:, joint] * sign
        own[:, 1] = _BY_INERTIA * inertia[:, joint]
        own[:, 2] = _BY_CLOCK * late[:, joint]
        own[:, _OF_SPRING] = spring[joint] * (motion.q[:, joint] - middle[joint]) / half[joint]
        for column, shape in enumerate((sign, speed), start=_OF_FRICTION):
            scale = rubs[joint] / max(float(np.sqrt(np.mean(shape**2))), 1e-12)
            own[:, column] = _BY_SITTING * scale * shape
    left = motion.residual - load - changed.friction_torque(motion)
    return columns * ~_changed(motion, columns, left, late, spring)


def _changed(
    motion: MeasuredMotion, columns: Array, left: Array, late: Array, spring: Array
) -> Mask:
    """Return (d,) columns of springs and friction that changed by more than from day to day.

    The difference is fitted by all columns beside what else may have changed: a load at the end of
    the arm, the delay and the scale of efforts, and a constant at each joint. A spring whose rest
    position is not the middle of the travel is a constant plus a spring: where the constant
    changed, the spring did. The scale is one for all joints, since friction is most of what some
    feel; a spring must have changed also beside a scale of each joint, which clipped efforts
    resemble.

    Args:
        motion: The motion.
        columns: (N, n, d) torques, one standard deviation each, N·m.
        left: (N, n) difference that no load and no friction explains, N·m.
        late: (N, n) change of the efforts with their delay, N·m/s.
        spring: (n,) standard deviation of a constant, N·m.
    """
    usable, n, count = ~motion.silent & motion.present, motion.arm.n, columns.shape[2]
    rms = np.sqrt((left**2 * usable).sum(axis=0) / np.maximum(usable.sum(axis=0), 1))
    assert motion.rate is not None
    common = np.stack([late, motion.expected], axis=2)

    def design(rows: slice) -> Array:
        load = motion.regressor(rows, motion.gravity)[:, :, -rigid_body.PER_LINK :]
        scales = motion.expected[rows, :, None] * np.eye(n)
        constants = np.broadcast_to(np.diag(spring), (len(load), n, n))
        return np.concatenate([load, common[rows], scales, constants, columns[rows]], axis=2)

    weight = usable / np.maximum(rms, 1e-9)
    gram, right = _normal_equations(motion, motion.residual, weight, design)
    free = len(right) - count
    # Of torques below the band two samples per hertz and second are independent.
    gram.flat[free * (len(right) + 1) :: len(right) + 1] += motion.rate / (2.0 * BAND)
    scale = rigid_body.PER_LINK + 1
    scales = slice(scale + 1, scale + 1 + n)

    def deviations(without: int | slice) -> Array:
        kept = np.delete(np.arange(len(right)), without)
        found = np.zeros(len(right))
        found[kept] = np.abs(solve(gram[np.ix_(kept, kept)], right[kept], _RIDGE))
        return found

    beside_one = deviations(without=scales)
    friction = beside_one[free:].reshape(-1, _EACH)[:, _OF_FRICTION:]
    least = np.minimum(beside_one, deviations(without=scale))
    springs = least[free:].reshape(-1, _EACH)[:, _OF_SPRING]
    constants = least[free - n : free][motion.moves]
    result = np.zeros((len(springs), _EACH), dtype=bool)
    result[:, _OF_SPRING] = np.maximum(springs, constants) > _BEYOND_SPRING
    result[:, _OF_FRICTION:] = (friction > _BEYOND).any(axis=1, keepdims=True)
    return result.ravel()
