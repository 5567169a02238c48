"""Recordings made ready for diagnosis: a motion with everything hypotheses are built from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arm import JOINT_NAMES, N_JOINTS, Arm
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import DataWarning, LowPass, Recording, prepare
from dvrk_gravity.terms import Gravity, State, rigid_body

Array = NDArray[np.float64]

KINEMATIC_BAND = 20.0  # Hz: what non-linear columns are computed from
RATE = 200.0  # Hz; faster recordings are thinned to about this
SHORTEST = 8.0  # s of motion, below which no choice among hypotheses can be judged
FEWEST = 40  # static poses, likewise
_SIGN_SPEED = 0.03  # of a joint's RMS speed: below, the direction of motion is uncertain
_SLOWEST = 0.005  # rad/s
_SHIFT = 0.01  # rad
_STANDING = 0.1  # s: slow for longer is standing still, not turning back
_RANK = 3e-3  # pivots below this part of the first are not told apart by the motion
_STILL = 0.06  # of a joint's RMS speed


@dataclass(frozen=True, eq=False)
class Motion:
    """N samples of an arm with the model that is on trial; all in joint space.

    Attributes:
        model: The model on trial.
        q: (N, 7) positions, rad; zero for joints that were not recorded.
        qd: (N, 7) velocities, rad/s; zero for static poses.
        qdd: (N, 7) accelerations, rad/s^2; zero for static poses.
        effort: (N, 7) measured torques, N·m.
        direction: (N, 7) +1/-1 for static poses whose approach is known.
        time: (N,) s since the first recording's beginning; the index for static poses.
        parts: Contiguous parts, uniformly sampled.
        rate: Hz; ``None`` for static poses.
        present: (7,) which joints were recorded.
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
    present: NDArray[np.bool_] = field(default_factory=lambda: np.ones(N_JOINTS, dtype=bool))

    @property
    def arm(self) -> Arm:
        """The arm."""
        return self.model.arm

    @property
    def static(self) -> bool:
        """Whether these are static poses."""
        return self.rate is None

    @cached_property
    def modelled(self) -> Array:
        """(N, 7) torque of the model, N·m."""
        return self.torque_at(self.q)

    @cached_property
    def residual(self) -> Array:
        """(N, 7) measured minus modelled torque, N·m."""
        return self.effort - self.modelled

    def torque_at(self, q: Array, model: TorqueModel | None = None) -> Array:
        """Return (N, 7) torques of a model at other positions in the same motion, N·m."""
        direction = self.direction
        if self.static:
            # Half of friction is undone at rest: without a direction it is not modelled.
            state = State(q, None, None, direction)
        else:
            state = State(q, self.qd, self.qdd, None)
        return (model or self.model).torque_at(state)

    @cached_property
    def slope(self) -> Array:
        """(N, 7, 7) change of the modelled torque [:, joint, by position of], N·m/rad."""
        slopes = []
        for shift in _SHIFT * np.eye(N_JOINTS):
            there, back = self.torque_at(self.q + shift), self.torque_at(self.q - shift)
            slopes.append((there - back) / (2.0 * _SHIFT))
        return np.stack(slopes, axis=2)

    @cached_property
    def travel(self) -> tuple[Array, Array]:
        """(7,) middle and half of the way that each joint goes, rad."""
        low, high = np.percentile(self.q, [0.5, 99.5], axis=0)
        return 0.5 * (low + high), np.maximum(0.5 * (high - low), 1e-3)

    @cached_property
    def moves(self) -> NDArray[np.bool_]:
        """(7,) which joints move enough to tell anything by."""
        return self.present & (self.travel[1] > 0.01)

    @cached_property
    def speed(self) -> Array:
        """(7,) RMS speed, rad/s."""
        return np.sqrt(np.mean(self.qd**2, axis=0))

    @cached_property
    def stuck(self) -> NDArray[np.bool_]:
        """(N, 7) samples in which a joint that else moves stands still for a while."""
        result = np.zeros(self.q.shape, dtype=bool)
        if self.rate is None:
            return result
        length = max(2, round(_STANDING * self.rate))
        for joint in np.flatnonzero(self.moves).tolist():
            slow = np.abs(self.qd[:, joint]) < max(_STILL * self.speed[joint], 2 * _SLOWEST)
            edges = np.flatnonzero(np.diff(slow.astype(np.int8), prepend=0, append=0))
            for start, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
                result[start:end, joint] = end - start >= length
        return result

    def slowest(self, row: Array) -> float:
        """Return the speed of a row of the joints below which its direction is uncertain, rad/s."""
        return max(_SIGN_SPEED * float(np.sqrt(np.mean((self.qd @ row) ** 2))), _SLOWEST)

    def sign(self, row: Array, transition: float | None = None) -> Array:
        """Return (N,) direction of motion of a row of the joints, linear through a slow zero.

        Args:
            row: (7,) joint velocities -> its velocity.
            transition: Speed from which on it is whole, rad/s; by default :meth:`slowest`.
        """
        if self.direction is not None:
            return np.sign(self.direction @ row)
        slow = self.slowest(row) if transition is None else transition
        return np.clip(self.qd @ row / slow, -1.0, 1.0)

    @cached_property
    def links_regressor(self) -> Array:
        """(N, 7, 90) regressor of the links' inertial parameters, gravity included."""
        return rigid_body.regressor(self.arm, self.q, self.qd, self.qdd, self.gravity)

    @cached_property
    def inertial(self) -> tuple[NDArray[np.int_], Array]:
        """Columns of the links' inertial parameters that this motion tells apart, gravity off.

        Returns:
            Their indices (k,) among the 90, and the (N, 7, k) columns themselves.
        """
        from scipy.linalg import qr

        columns = rigid_body.regressor(self.arm, self.q, self.qd, self.qdd, np.zeros(3))
        few = columns[:: max(1, len(columns) // 600)].reshape(-1, columns.shape[2])
        size = np.sqrt(np.mean(few**2, axis=0))
        scaled = few / np.where(size > 1e-9, size, 1.0) * (size > 1e-9)
        triangle, pivots = qr(scaled, mode="r", pivoting=True)
        diagonal = np.abs(np.diag(triangle))
        chosen = np.sort(pivots[: int(np.sum(diagonal > _RANK * diagonal[0]))])
        return chosen, columns[:, :, chosen]

    @property
    def gravity(self) -> Array:
        """(3,) gravity in the base as the model has it, m/s^2."""
        term = self.model.term(Gravity.NAME)
        return term.vector if isinstance(term, Gravity) else self.arm.gravity


@dataclass(frozen=True, eq=False)
class Loaded:
    """A motion, and what was found on the way to it.

    Attributes:
        motion: The motion.
        warnings: What the recordings' checks found.
        handling: What was done to them.
        floor: (7,) noise of the effort as high frequencies show it, density in N·m/sqrt(Hz);
            NaN where it cannot be told.
    """

    motion: Motion
    warnings: tuple[DataWarning, ...]
    handling: tuple[str, ...]
    floor: Array


def load(recordings: Sequence[Recording], model: TorqueModel) -> Loaded:
    """Prepare recordings for diagnosis.

    Args:
        recordings: Trajectories, or static poses, not both; joint or actuator coordinates.
        model: The model on trial.

    Raises:
        RecordingError: Naming what is missing: effort, samples, motion.
    """
    if not recordings:
        raise RecordingError("recordings", "there are none, expected at least one")
    kinds = {recording.time is None for recording in recordings}
    if len(kinds) > 1:
        raise RecordingError(
            recordings[0].source, "static poses and trajectories cannot be diagnosed together"
        )
    static = kinds.pop()
    for recording in recordings:
        if recording.effort is None:
            raise RecordingError(recording.source, "has no effort, which is to be explained")
    if {recording.joints for recording in recordings} != {recordings[0].joints}:
        raise RecordingError(recordings[0].source, "the recordings hold different joints")
    pieces: list[Motion] = []
    warnings: list[DataWarning] = []
    handling: list[str] = []
    floors = []
    start = 0.0
    rates = [recording.rate for recording in recordings]
    for recording, rate in zip(recordings, rates, strict=True):
        band = KINEMATIC_BAND if rate is None else min(KINEMATIC_BAND, rate / 5.0)
        if not static and recording.time is not None:
            duration = float(recording.time[-1] - recording.time[0])
            if len(recordings) == 1 and duration < SHORTEST:
                raise RecordingError(
                    recording.source,
                    f"lasts {duration:.3g} s, a diagnosis needs at least {SHORTEST:g} s of motion",
                )
            start = recording.start_ns * 1e-9 - recordings[0].start_ns * 1e-9
        prepared = prepare(recording, band)
        warnings += [w for w in prepared.warnings if w not in warnings]
        handling += [h for h in prepared.handling if h not in handling]
        thin = 1 if rate is None else max(1, round(rate / RATE))
        for segment in prepared.segments:
            rows = segment.core
            pieces.append(_piece(segment.recording, segment.acceleration, rows, thin, model, start))
        floors.append(_noise_density(recording, model.arm))
    motion = _join(pieces)
    if static and len(motion.q) < FEWEST:
        raise RecordingError(
            recordings[0].source,
            f"holds {len(motion.q)} static poses, a diagnosis needs at least {FEWEST}",
        )
    if not static:
        total = len(motion.q) / (motion.rate or 1.0)
        if total < SHORTEST:
            raise RecordingError(
                recordings[0].source,
                f"holds {total:.3g} s of usable motion, a diagnosis needs at least {SHORTEST:g} s",
            )
    floor = np.sqrt(np.nanmean(np.square(floors), axis=0)) if not static else np.full(7, np.nan)
    return Loaded(motion, tuple(warnings), tuple(handling), floor)


def _piece(
    recording: Recording,
    acceleration: Array | None,
    rows: slice,
    thin: int,
    model: TorqueModel,
    start: float,
) -> Motion:
    def full(values: Array | None, fill: float = 0.0) -> Array:
        result = np.full((len(recording), N_JOINTS), fill)
        if values is not None:
            result[:, columns] = values
        return result[rows][::thin]

    columns = [JOINT_NAMES.index(joint) for joint in recording.joints]
    present = np.isin(np.arange(N_JOINTS), columns)
    q, qd, qdd = full(recording.position), full(recording.velocity), full(acceleration)
    effort = full(recording.effort)
    direction = None if recording.direction is None else full(recording.direction, 1.0)
    if recording.coordinates == "actuator":
        arm = model.arm
        q, qd, qdd = (arm.joint_position(array) for array in (q, qd, qdd))
        effort = arm.joint_effort(effort)
        if direction is not None:
            direction = np.sign(arm.joint_position(direction))
    if recording.time is None:
        qd, qdd = np.zeros_like(q), np.zeros_like(q)
        time, rate = np.arange(len(q), dtype=float), None
    else:
        time = recording.time[rows][::thin] + start
        rate = (recording.rate or 1.0) / thin
    return Motion(model, q, qd, qdd, effort, direction, time, (slice(0, len(q)),), rate, present)


def _join(pieces: Sequence[Motion]) -> Motion:
    edges = np.concatenate([[0], np.cumsum([len(piece.q) for piece in pieces])]).tolist()
    first = pieces[0]
    directions = [piece.direction for piece in pieces]
    known = [direction for direction in directions if direction is not None]
    return replace(
        first,
        q=np.vstack([piece.q for piece in pieces]),
        qd=np.vstack([piece.qd for piece in pieces]),
        qdd=np.vstack([piece.qdd for piece in pieces]),
        effort=np.vstack([piece.effort for piece in pieces]),
        direction=np.vstack(known) if len(known) == len(pieces) else None,
        time=np.concatenate([piece.time for piece in pieces]),
        parts=tuple(slice(a, b) for a, b in pairwise(edges)),
    )


def _noise_density(recording: Recording, arm: Arm) -> Array:
    """Return (7,) effort noise in N·m/sqrt(Hz) from what lies above the kinematic band."""
    density = np.full(N_JOINTS, np.nan)
    rate = recording.rate
    if rate is None or recording.effort is None or rate < 4.0 * KINEMATIC_BAND:
        return density
    cutoff = min(1.5 * KINEMATIC_BAND, 0.3 * rate)
    low = LowPass(cutoff, rate)
    if len(recording) <= 4 * low.edge:
        return density
    high = recording.effort - low(recording.effort)
    frequency = np.linspace(0.0, rate / 2.0, 2000)
    # Two runs of a second-order Butterworth: amplitude 1 / (1 + (f / fc)^4).
    left = np.mean((1.0 - 1.0 / (1.0 + (frequency / cutoff) ** 4)) ** 2)
    variance = np.mean(high[low.edge : -low.edge] ** 2, axis=0) / left
    columns = [JOINT_NAMES.index(joint) for joint in recording.joints]
    density[columns] = np.sqrt(variance / (rate / 2.0))
    if recording.coordinates == "actuator":
        known = np.nan_to_num(density)
        density = np.sqrt((known**2) @ (arm.joint_to_actuator**2))
    return density
