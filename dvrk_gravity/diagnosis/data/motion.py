"""A measured motion: states, efforts, and what its samples can show."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arms import Arm, rigid_body
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import State, delay_signal
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.observation import SMEARED, Observation
from dvrk_gravity.recording import LowPass

_SHIFT = 0.01  # rad, of a central difference quotient
_PIECE = 5000  # samples; all columns of all links are 25 MB then
BAND = 8.0
"""Hz: torques are compared below this, and so is the speed that shows where a joint reverses.

Chosen; see `make sensitivity`.
"""
# All chosen.
_SIGN = 0.03  # of a joint's RMS speed: slower, its direction of motion is uncertain
_SLOWEST = 0.005  # rad/s, likewise at least; of what slides and of travel a tenth in m
_MOVES = 0.01  # rad, half of a joint's travel: less shows nothing
_RANK = 3e-3  # of the first pivot: torques are known to some per cent, so this counts as zero
_STILL = 0.06  # of a joint's RMS speed: slower, it may be stuck
_SLOW = 0.4  # of it: faster, friction counts however coarse the encoder
_FINE = 0.3  # of it: slower encoder steps show where a joint stops
_STEP_RATE = 20.0  # encoder steps a second: fewer appear as pulses in a velocity below 20 Hz
_WHOLE = 0.9  # of a motor's torque that a joint must feel to be held by it: all but weak couplings


@dataclass(frozen=True, eq=False, kw_only=True)
class MeasuredMotion(Observation):
    """What an arm did, beside the model under test.

    Attributes:
        model: The model under test.
        reference: (N, n) torques of a baseline recording at the same phase, N·m, expected in place
            of the model's; ``None``: the model's are expected.
        changed_friction: Joints whose friction differs from the reference's by more than from day
            to day: all of the difference is reported.
        changed_springs: Joints whose springs do.
        known_torque: (N, n) torque of known causes that the model lacks, N·m.
        payload_at: Body that is known to carry a load, and (3,) its place in the link frame, m.
    """

    model: TorqueModel
    reference: Array | None = None
    changed_friction: tuple[int, ...] = ()
    changed_springs: tuple[int, ...] = ()
    known_torque: Array | None = None
    payload_at: tuple[int, Array] | None = None

    PER_SAMPLE = (*Observation.PER_SAMPLE, "reference", "known_torque")

    @classmethod
    def beside_model(cls, model: TorqueModel, observed: Observation) -> MeasuredMotion:
        """Return what was observed beside a model."""
        return cls(model=model, **{f.name: getattr(observed, f.name) for f in fields(observed)})

    @property
    def arm(self) -> Arm:
        """The arm."""
        return self.model.arm

    @property
    def static(self) -> bool:
        """Whether these are static poses."""
        return self.rate is None

    @cached_property
    def true_q(self) -> Array:
        """(N, n) positions as the model has them, its encoder offsets taken off, rad."""
        return self.q - self.model.joint_offset

    @cached_property
    def modelled(self) -> Array:
        """(N, n) torque of the model, N·m."""
        return self.model.prediction(self.state_at(self.q))

    @property
    def measured_twice(self) -> bool:
        """Whether the expected torque was measured in the same motion, and not modelled."""
        return self.reference is not None

    @property
    def expected(self) -> Array:
        """(N, n) torque of the baseline recording, or else of the model, N·m."""
        return self.modelled if self.reference is None else self.reference

    @cached_property
    def friction(self) -> Array:
        """(N, n) torque of the model's friction, N·m."""
        state = State(self.true_q, self.qd, self.qdd)
        torques = (term.torque(state) for term in self.model.terms if term.FRICTION)
        return sum(torques, np.zeros(self.q.shape))

    @cached_property
    def applied_torque(self) -> Array:
        """(N, n) torque that acts, as wrong readings scale or delay it, N·m.

        Of two measurements it is the mean: a column with one's own noise would make that one seem
        to read too low.
        """
        if self.measured_twice:
            return 0.5 * (self.effort + self.expected)
        return self.modelled if self.known_torque is None else self.modelled + self.known_torque

    @cached_property
    def residual(self) -> Array:
        """(N, n) measured minus expected torque, N·m."""
        return self.effort - self.expected

    def torque_at(self, q: Array, model: TorqueModel | None = None) -> Array:
        """Return (N, n) torques of a model at other positions in the same motion, N·m."""
        return (model or self.model).torque_at(self.state_at(q))

    def read_by(self, model: TorqueModel) -> Array:
        """Return (N, n) efforts that a model predicts to be read, its errors of readings included.

        The samples are taken as read.
        """
        errors = model.reading_errors
        true = np.linalg.inv(errors.position).T
        state = self.state_at(self.q @ true)
        if not self.static:
            state = replace(state, qd=self.qd @ true, qdd=self.qdd @ true)
        torque = model.torque_at(state) @ errors.effort.T
        torque = np.clip(torque, -errors.limit, errors.limit)
        return delay_signal(self, torque, errors.delay) if errors.delay else torque

    def state_at(self, q: Array) -> State:
        """Return the states with other (N, n) positions in the same motion."""
        if self.static:
            # At rest friction has no sign, unless the direction of approach is known.
            return State(q, None, None, self.direction)
        return State(q, self.qd, self.qdd, None)

    @cached_property
    def slope(self) -> Array:
        """(N, n, n) change of the modelled torque [:, joint, by position of], N·m/rad."""
        state, shifts = self.state_at(self.q), _SHIFT * np.diag(self.arm.scale)
        slopes = []
        together = max(1, _PIECE // len(self.q))  # of few samples all joints at once
        for first in range(0, len(shifts), together):
            some = shifts[first : first + together]
            moved = self.model.positional_torques(state, np.concatenate([some, -some]))
            there, back = np.split(moved, 2)
            slopes.append((there - back) / (2.0 * some.sum(axis=1)[:, None, None]))
        return np.ascontiguousarray(np.concatenate(slopes).transpose(1, 2, 0))

    @cached_property
    def travel(self) -> tuple[Array, Array]:
        """(n,) middle and half of each joint's travel, rad."""
        low, high = np.percentile(self.q, [0.5, 99.5], axis=0)
        return 0.5 * (low + high), np.maximum(0.5 * (high - low), 1e-3 * self.arm.scale)

    @cached_property
    def moves(self) -> NDArray[np.bool_]:
        """(n,) joints that move enough to show anything."""
        return self.present & (self.travel[1] > _MOVES * self.arm.scale)

    @cached_property
    def silent(self) -> NDArray[np.bool_]:
        """(N, n) samples whose effort carries no information: not read, or the joint is stuck."""
        return self.stuck | self.invalid_effort

    @cached_property
    def stands(self) -> NDArray[np.bool_]:
        """(n,) joints that never move and that friction may hold; none in static poses."""
        if self.static:
            return np.zeros(self.arm.n, dtype=bool)
        return self.present & ~self.moves & self.arm.has_friction

    @cached_property
    def speed(self) -> Array:
        """(n,) RMS speed, rad/s."""
        return np.sqrt(np.mean(self.qd**2, axis=0))

    @cached_property
    def stuck(self) -> NDArray[np.bool_]:
        """(N, n) samples in which a joint stands still, if only to reverse.

        While friction sticks, effort passes from one level to the other without motion, and the
        filtered velocity starts before the joint does: that much is left out on either side. So
        it is for motors that move more than their own joint.
        """
        result = np.zeros(self.q.shape, dtype=bool)
        if self.rate is None:
            return result
        result[:, self.stands] = True
        for joint in np.flatnonzero(self.moves).tolist():
            result[:, joint] = self._turning(np.eye(self.arm.n)[joint], joint)
        if self.present.all():
            to_motor = self.arm.joint_to_actuator
            for motor in np.flatnonzero(np.abs(to_motor).sum(axis=1) > 1.0).tolist():
                felt = (np.abs(to_motor[motor]) > _WHOLE) & self.moves
                result[:, felt] |= self._turning(to_motor[motor], motor)[:, None]
        return result

    def _turning(self, row: Array, index: int) -> NDArray[np.bool_]:
        """Return (N,) samples in which a joint or motor stops or reverses; row as in `sign`."""
        assert self.rate is not None
        # Encoder steps are not reversals.
        low = LowPass(min(BAND, self.rate / 6.0), self.rate)
        speed = self.qd @ row
        typical = float(np.sqrt(np.mean(speed**2)))
        slow = max(_STILL * typical, 2 * _SLOWEST * self._scale(row))
        # Direction is unknown where the encoder steps too rarely, and friction is uncertain where
        # the model's own smoothing has not reached its full value.
        stepwise = _STEP_RATE * float(self.step @ np.abs(row))
        unseen = stepwise
        for term in self.model.terms:
            if term.full_speed is not None:
                unseen = max(unseen, float(term.full_speed[index]))
        slow = max(slow, min(unseen, _SLOW * typical))
        # Stick-slip stops and rings; coarse encoder steps would look the same.
        stops_seen = stepwise < _FINE * typical
        half = math.ceil(SMEARED * self.rate)
        wide = np.ones(1 + 2 * half)
        result = np.zeros(len(speed), dtype=bool)
        for part in self.parts:
            smooth = low(speed[part]) if part.stop - part.start > low.edge else speed[part]
            still = np.abs(smooth) < slow
            still |= np.diff(np.sign(smooth), prepend=np.sign(smooth[0])) != 0.0
            if stops_seen:
                still |= np.sign(speed[part]) != np.sign(smooth)
            # Not `same`, which is as long as the window where that is the longer one.
            near = np.convolve(still.astype(float), wide)[half : half + len(still)]
            result[part] = near > 0.5
        return result

    def slowest(self, row: Array) -> float:
        """Return the speed below which the direction of a row of joints is uncertain, rad/s."""
        least = _SLOWEST * self._scale(row)
        return max(_SIGN * float(np.sqrt(np.mean((self.qd @ row) ** 2))), least)

    def _scale(self, row: Array) -> float:
        """Return the length in m, or 1 rad, that counts as a rad for a row of joints."""
        part = np.abs(row)
        return float(part @ self.arm.scale) / float(part.sum())

    def sign(self, row: Array, transition: float | None = None) -> Array:
        """Return (N,) direction of motion of a row of the joints, linear through a slow zero.

        Args:
            row: (n,) joint velocities -> its velocity.
            transition: Speed at which it saturates, rad/s; by default :meth:`slowest`.
        """
        if self.direction is not None:
            return np.sign(self.direction @ row)
        slow = self.slowest(row) if transition is None else transition
        return np.clip(self.qd @ row / slow, -1.0, 1.0)

    @cached_property
    def signs(self) -> Array:
        """(N, n) directions in which the joints move, see :meth:`sign`."""
        return np.column_stack([self.sign(row) for row in np.eye(self.arm.n)])

    def link_torque(self, link: int, directions: Array) -> Array:
        """Return (N, n, k) torques of changes of a link's inertial parameters, gravity included.

        Args:
            link: Index of the link among the arm's bodies.
            directions: (10, k) changes, in the order of ``rigid_body.regressor``.
        """
        joints = list(rigid_body.bodies(self.arm)[link].joints)
        torque = np.zeros((len(self.q), self.arm.n, directions.shape[1]))
        torque[:, joints] = self._links[link] @ directions
        return torque

    @cached_property
    def _links(self) -> list[Array]:
        """For each link, (N, m, 10) regressor columns at the joints that move it."""
        moved = [list(body.joints) for body in rigid_body.bodies(self.arm)]
        links = [np.empty((len(self.q), len(joints), rigid_body.PER_LINK)) for joints in moved]
        for rows in self.pieces():
            whole = self.regressor(rows, self.gravity)
            for link, (columns, joints) in enumerate(zip(links, moved, strict=True)):
                parameters = slice(rigid_body.PER_LINK * link, rigid_body.PER_LINK * (link + 1))
                columns[rows] = whole[:, joints, parameters]
        return links

    def release(self) -> None:
        """Free the memory of the links' columns; they are recomputed on demand."""
        self.__dict__.pop("_links", None)

    @cached_property
    def inertial(self) -> NDArray[np.int_]:
        """(k,) inertial parameters that this motion identifies without gravity."""
        from scipy.linalg import qr

        thinned = slice(None, None, max(1, len(self.q) // 600))
        columns = self.regressor(thinned, np.zeros(3))
        few = columns.reshape(-1, columns.shape[-1])
        size = np.sqrt(np.mean(few**2, axis=0))
        scaled = few / np.where(size > 1e-9, size, 1.0) * (size > 1e-9)
        triangle, pivots = qr(scaled, mode="r", pivoting=True)
        diagonal = np.abs(np.diag(triangle))
        return np.sort(pivots[: int(np.sum(diagonal > _RANK * diagonal[0]))])

    def inertial_torque(self) -> Array:
        """Return (N, n, k) columns of :attr:`inertial`, without gravity."""
        torque = np.empty((len(self.q), self.arm.n, len(self.inertial)))
        for rows in self.pieces():
            torque[rows] = self.regressor(rows, np.zeros(3))[:, :, self.inertial]
        return torque

    def pieces(self) -> list[slice]:
        """Return slices of samples whose columns fit into memory together."""
        return [slice(first, first + _PIECE) for first in range(0, len(self.q), _PIECE)]

    def regressor(self, rows: slice, gravity: Array) -> Array:
        """Return (rows, n, 10 bodies) columns of the links' inertial parameters at some samples."""
        return rigid_body.regressor(
            self.arm, self.true_q[rows], self.qd[rows], self.qdd[rows], gravity
        )

    @property
    def gravity(self) -> Array:
        """(3,) the model's gravity in the base frame, m/s^2."""
        return self.model.gravity
