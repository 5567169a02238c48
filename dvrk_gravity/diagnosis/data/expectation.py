"""What should have been measured, and by how much that may be off without a cause to report.

Of an identified model: its parameters' posterior, extrapolation, friction by load. Of a baseline
recording: what two sittings, or two days, differ by.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.arms import rigid_body
from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.motion import MeasuredMotion
from dvrk_gravity.effects import State, mean_slope_by_delay
from dvrk_gravity.estimation import NORMAL_95, solve
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
class Expectation:
    """The torque that a model or a baseline recording leads to expect in a motion of N samples.

    Attributes:
        torque: (N, n) its mean, N·m.
        columns: (N, n, d) torques by which that may be off in d independent directions, one
            standard deviation each, N·m.
        known_error: (n,) RMS error that is known to remain, N·m; zero if unknown.
        friction: (N, n) torque of friction that may have changed since calibration, N·m; zero for a
            model without uncertainty, for friction stated in an arm's file, and for poses.
        friction_variation: (n,) RMS torque by which that varies from day to day, N·m.
        predicts: Whether it is known in other motions as well, and for an arm without wrong
            readings. Else it was measured in this motion: wrong readings are in it, too, and of an
            effect only the change is known.
        identified: Whether it was measured or fitted, so that what it lacks are single causes; an
            arm's own file lacks several at every joint.
    """

    torque: Array
    columns: Array
    known_error: Array
    friction: Array
    friction_variation: Array
    predicts: bool
    identified: bool

    @property
    def day_to_day_error(self) -> Array:
        """(n,) known error together with day-to-day friction variation, N·m RMS."""
        return np.hypot(self.known_error, self.friction_variation)

    def filtered(self, low_pass: Callable[[Array], Array]) -> Expectation:
        """Return it at T filtered samples."""
        torque, columns, friction = map(low_pass, (self.torque, self.columns, self.friction))
        return replace(self, torque=torque, columns=columns, friction=friction)


def expect(motion: MeasuredMotion) -> Expectation:
    """Return what a motion's baseline recording leads to expect, or else its model."""
    return _of_model(motion) if motion.reference is None else _of_baseline(motion, motion.reference)


def _of_model(motion: MeasuredMotion) -> Expectation:
    known, friction = motion.model.uncertainty, np.zeros(motion.q.shape)
    if known is not None and not (motion.model.of_file or motion.static):
        friction = motion.friction
    varies = FRICTION_PART * np.sqrt(np.mean(friction**2, axis=0))
    error = np.zeros(motion.arm.n) if known is None else np.nan_to_num(known.error)
    return Expectation(
        motion.modelled, model_columns(motion), error, friction, varies, predicts=True,
        identified=known is not None and not motion.model.of_file,
    )  # fmt: skip


def _of_baseline(motion: MeasuredMotion, measured: Array) -> Expectation:
    """Return what one of two recordings leads to expect: its columns have friction's changes."""
    nothing, none = np.zeros(motion.q.shape), np.zeros(motion.arm.n)
    columns = baseline_columns(motion)
    return Expectation(measured, columns, none, nothing, none, predicts=False, identified=True)


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
