"""A motion with everything that hypotheses are built from."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import State
from dvrk_gravity.effects.base import rigid_body
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import LowPass

_SHIFT = 0.01  # rad, of a central difference quotient
_PIECE = 5000  # samples; all columns of all links are 25 MB then


@dataclass(frozen=True)
class MotionSettings:
    """When a joint moves, and which way.

    Attributes:
        sign: Part of a joint's RMS speed below which the direction of motion is uncertain. Chosen.
        slowest: rad/s, likewise, at least; of what slides and of ways a tenth in m. Chosen.
        moves: rad, of half its way, from which on a joint shows anything. Chosen.
        smeared: s, by which the kinematics' low-pass is early or late: half a period at its
            cutoff, 20 Hz.
        turning_band: Hz, of the speed that shows where a joint turns back. Chosen: that of the
            torques that are compared (``FilterSettings.band``).
        rank: Part of the first pivot below which inertial parameters are not told apart by the
            motion. Chosen: of a torque that is known to some per cent, 3e-3 is nothing.
        still: Part of a joint's RMS speed below which it may be stuck. Chosen.
        slow: Likewise, from which on friction is taken at its word though the encoder is coarse.
        fine: Part of the typical speed: steps that are slower than that show where a joint stops.
            Chosen.
        step_rate: Encoder steps a second: fewer show in a velocity of the kinematics' band, 20 Hz,
            as pulses.
        whole: Part of a motor's torque that a joint must feel to be held by it. Chosen: all but a
            weak coupling.
    """

    sign: float = 0.03
    slowest: float = 0.005
    moves: float = 0.01
    smeared: float = 0.025
    turning_band: float = 8.0
    rank: float = 3e-3
    still: float = 0.06
    slow: float = 0.4
    fine: float = 0.3
    step_rate: float = 20.0
    whole: float = 0.9


@dataclass(frozen=True, eq=False)
class MeasuredMotion:
    """N samples of an arm with the model that is on trial; all in joint space.

    Attributes:
        model: The model on trial.
        q: (N, n) positions, rad; zero for joints that were not recorded.
        qd: (N, n) velocities, rad/s; zero for static poses.
        qdd: (N, n) accelerations, rad/s^2; zero for static poses.
        effort: (N, n) measured torques, N·m.
        direction: (N, n) +1/-1 for static poses whose approach is known.
        time: (N,) s since the first recording's beginning; the index for static poses.
        parts: Contiguous parts, uniformly sampled.
        rate: Hz; ``None`` for static poses.
        present: (n,) which joints were recorded.
        step: (n,) steps of the positions, rad.
        thinned: Of so many samples that were recorded one was kept.
        clock: By part, number of the recording whose time it is in; default: all of one.
        rounding: (n,) density of the noise that the steps of the efforts leave, N·m/sqrt(Hz).
        reference: (N, n) torques that were measured in the same motion when all was well, N·m;
            they stand for the model's then. ``None``: the model's do.
        unread: (N, n) samples whose effort is no reading, see ``recording.frozen``.
        rubs_otherwise: Joints whose friction differs from the reference's by more than that of
            another day does: all of it is to be told.
        pulls_otherwise: Joints whose springs pull otherwise than the reference's, likewise.
        timed: Velocities were measured, and with them the clock: they are what positions show.
        beside: (N, n) torque of causes that act beside the model's, N·m, where some are known.
        settings: When a joint moves.
    """

    model: TorqueModel
    q: Array
    qd: Array
    qdd: Array
    effort: Array
    direction: Array | None
    time: Array
    parts: tuple[slice, ...]
    rate: float | None
    present: NDArray[np.bool_]
    step: Array
    thinned: int = 1
    clock: tuple[int, ...] = ()
    rounding: Array = field(default_factory=lambda: np.zeros(()))
    reference: Array | None = None
    unread: NDArray[np.bool_] = field(default_factory=lambda: np.zeros((), dtype=bool))
    rubs_otherwise: tuple[int, ...] = ()
    pulls_otherwise: tuple[int, ...] = ()
    timed: bool = True
    beside: Array | None = None
    settings: MotionSettings = field(default_factory=MotionSettings)

    @property
    def clocks(self) -> tuple[int, ...]:
        """By part, number of the recording whose time it is in."""
        return self.clock or (0,) * len(self.parts)

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
        return self.model.prediction(self._state(self.q))

    @cached_property
    def friction(self) -> Array:
        """(N, n) torque of the model's friction, N·m."""
        state = State(self.true_q, self.qd, self.qdd)
        torques = (term.torque(state) for term in self.model.terms if term.FRICTION)
        return sum(torques, np.zeros(self.q.shape))

    @cached_property
    def acting(self) -> Array:
        """(N, n) torque that acts, to suppose a wrong reading of, N·m.

        The model's, and that of other causes. Of two measured ones their mean, whose noise is not
        that of their difference: a column with the reference's own noise would find that it reads
        too low.
        """
        if self.reference is not None:
            return 0.5 * (self.effort + self.reference)
        return self.modelled if self.beside is None else self.modelled + self.beside

    @cached_property
    def residual(self) -> Array:
        """(N, n) measured minus modelled torque, or minus the reference's, N·m."""
        return self.effort - (self.modelled if self.reference is None else self.reference)

    def torque_at(self, q: Array, model: TorqueModel | None = None) -> Array:
        """Return (N, n) torques of a model at other positions in the same motion, N·m."""
        return (model or self.model).torque_at(self._state(q))

    def _state(self, q: Array) -> State:
        if self.static:
            # Half of friction is undone at rest: without a direction it is not modelled.
            return State(q, None, None, self.direction)
        return State(q, self.qd, self.qdd, None)

    @cached_property
    def slope(self) -> Array:
        """(N, n, n) change of the modelled torque [:, joint, by position of], N·m/rad."""
        slopes = []
        for shift in _SHIFT * np.diag(self.arm.scale):
            there, back = self.torque_at(self.q + shift), self.torque_at(self.q - shift)
            slopes.append((there - back) / (2.0 * shift.sum()))
        return np.stack(slopes, axis=2)

    @cached_property
    def travel(self) -> tuple[Array, Array]:
        """(n,) middle and half of the way that each joint goes, rad."""
        low, high = np.percentile(self.q, [0.5, 99.5], axis=0)
        return 0.5 * (low + high), np.maximum(0.5 * (high - low), 1e-3 * self.arm.scale)

    @cached_property
    def moves(self) -> NDArray[np.bool_]:
        """(n,) which joints move enough to tell anything by."""
        return self.present & (self.travel[1] > self.settings.moves * self.arm.scale)

    @cached_property
    def silent(self) -> NDArray[np.bool_]:
        """(N, n) samples whose effort says nothing: no reading, or of a joint that stands still."""
        return self.stuck | self.unread

    @cached_property
    def stands(self) -> NDArray[np.bool_]:
        """(n,) which joints friction may hold all the time; no poses, which are about that."""
        if self.static:
            return np.zeros(self.arm.n, dtype=bool)
        return self.present & ~self.moves & self.arm.rubs

    @cached_property
    def speed(self) -> Array:
        """(n,) RMS speed, rad/s."""
        return np.sqrt(np.mean(self.qd**2, axis=0))

    @cached_property
    def stuck(self) -> NDArray[np.bool_]:
        """(N, n) samples in which a joint stands still, if only to turn back.

        Where friction sticks, the effort goes from one level to the other while nothing moves,
        and the filtered velocity begins before the joint does: that long is left out on either
        side. The same holds of a motor that moves more than its own joint. Where nothing rubs,
        a joint that never moves bears what there is to bear.
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
                felt = (np.abs(to_motor[motor]) > self.settings.whole) & self.moves
                result[:, felt] |= self._turning(to_motor[motor], motor)[:, None]
        return result

    def _turning(self, row: Array, index: int) -> NDArray[np.bool_]:
        """Return (N,) samples in which a joint or motor stands still or turns back.

        Args:
            row: (n,) joint velocities -> its velocity.
            index: Its number.
        """
        assert self.rate is not None
        # An encoder's steps are no turning back.
        low = LowPass(min(self.settings.turning_band, self.rate / 6.0), self.rate)
        speed = self.qd @ row
        typical = float(np.sqrt(np.mean(speed**2)))
        slow = max(self.settings.still * typical, 2 * self.settings.slowest * self._scale(row))
        # Where the encoder steps too rarely for its direction to be seen all the time, and where
        # the model's friction is but on its way, for smoothness' sake, neither can say.
        stepwise = self.settings.step_rate * float(self.step @ np.abs(row))
        unseen = stepwise
        for term in self.model.terms:
            if term.full_speed is not None:
                unseen = max(unseen, float(term.full_speed[index]))
        slow = max(slow, min(unseen, self.settings.slow * typical))
        # Stick and slip: on the way it stops, and rings beyond; noise of steps would look alike.
        stops_seen = stepwise < self.settings.fine * typical
        wide = np.ones(1 + 2 * math.ceil(self.settings.smeared * self.rate))
        result = np.zeros(len(speed), dtype=bool)
        for part in self.parts:
            smooth = low(speed[part]) if part.stop - part.start > low.edge else speed[part]
            still = np.abs(smooth) < slow
            still |= np.diff(np.sign(smooth), prepend=np.sign(smooth[0])) != 0.0
            if stops_seen:
                still |= np.sign(speed[part]) != np.sign(smooth)
            result[part] = np.convolve(still.astype(float), wide, mode="same") > 0.5
        return result

    def slowest(self, row: Array) -> float:
        """Return the speed of a row of the joints below which its direction is uncertain, rad/s."""
        least = self.settings.slowest * self._scale(row)
        return max(self.settings.sign * float(np.sqrt(np.mean((self.qd @ row) ** 2))), least)

    def _scale(self, row: Array) -> float:
        """Return what counts as a rad of a row of the joints."""
        part = np.abs(row)
        return float(part @ self.arm.scale) / float(part.sum())

    def sign(self, row: Array, transition: float | None = None) -> Array:
        """Return (N,) direction of motion of a row of the joints, linear through a slow zero.

        Args:
            row: (n,) joint velocities -> its velocity.
            transition: Speed from which on it is whole, rad/s; by default :meth:`slowest`.
        """
        if self.direction is not None:
            return np.sign(self.direction @ row)
        slow = self.slowest(row) if transition is None else transition
        return np.clip(self.qd @ row / slow, -1.0, 1.0)

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
        """Of each link (N, m, 10) its columns of the regressor at the joints that move it."""
        moved = [list(body.joints) for body in rigid_body.bodies(self.arm)]
        links = [np.empty((len(self.q), len(joints), rigid_body.PER_LINK)) for joints in moved]
        for rows in self.pieces():
            whole = self.regressor(rows, self.gravity)
            for link, (columns, joints) in enumerate(zip(links, moved, strict=True)):
                parameters = slice(rigid_body.PER_LINK * link, rigid_body.PER_LINK * (link + 1))
                columns[rows] = whole[:, joints, parameters]
        return links

    def release(self) -> None:
        """Drop the links' columns; they are computed again if need be."""
        self.__dict__.pop("_links", None)

    @cached_property
    def inertial(self) -> NDArray[np.int_]:
        """(k,) which of the links' inertial parameters this motion tells apart, gravity off."""
        from scipy.linalg import qr

        thinned = slice(None, None, max(1, len(self.q) // 600))
        columns = self.regressor(thinned, np.zeros(3))
        few = columns.reshape(-1, columns.shape[-1])
        size = np.sqrt(np.mean(few**2, axis=0))
        scaled = few / np.where(size > 1e-9, size, 1.0) * (size > 1e-9)
        triangle, pivots = qr(scaled, mode="r", pivoting=True)
        diagonal = np.abs(np.diag(triangle))
        return np.sort(pivots[: int(np.sum(diagonal > self.settings.rank * diagonal[0]))])

    def inertial_torque(self, chosen: NDArray[np.int_]) -> Array:
        """Return (N, n, k) columns of some of the links' inertial parameters, gravity off."""
        torque = np.empty((len(self.q), self.arm.n, len(chosen)))
        for rows in self.pieces():
            torque[rows] = self.regressor(rows, np.zeros(3))[:, :, chosen]
        return torque

    def pieces(self) -> list[slice]:
        """Return slices of the samples of which all columns of all links are held at a time."""
        return [slice(first, first + _PIECE) for first in range(0, len(self.q), _PIECE)]

    def regressor(self, rows: slice, gravity: Array) -> Array:
        """Return (rows, n, 10 bodies) columns of the links' inertial parameters at some samples."""
        return rigid_body.regressor(
            self.arm, self.true_q[rows], self.qd[rows], self.qdd[rows], gravity
        )

    @property
    def gravity(self) -> Array:
        """(3,) gravity in the base as the model has it, m/s^2."""
        return self.model.gravity
