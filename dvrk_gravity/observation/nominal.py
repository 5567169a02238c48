"""Efforts that the masses in an arm's file require along a recording, and the mounting they show.

A URDF assumes an upright base; efforts of nominal masses show where gravity really points.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from dvrk_gravity.arms import Arm, rigid_body
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import MAX_TILT
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.observation.absent_joints import held_beyond
from dvrk_gravity.recording import (
    Bands,
    Prepared,
    Recording,
    prepare,
    without_friction,
)

BAND = 8.0  # Hz, of the low-pass of motion and efforts: that of a diagnosis
SAMPLES = 5000  # that are looked at, at most: a bound on time
FEWEST = 10  # samples. Chosen: of two, effort and weight always correlate
_RATE = 4.0  # least samples per period of that band. Chosen
_BANDS = Bands(BAND, BAND, BAND, np.inf, BAND, for_fit=False)

# Directions of gravity on floors, walls, ceilings, and half-way between two or three of them.
_USUAL = np.array([d for d in product((-1.0, 0.0, 1.0), repeat=3) if any(d)])
_USUAL /= np.linalg.norm(_USUAL, axis=1, keepdims=True)
# rad, within which a usual mounting is meant. Chosen: what friction and slightly wrong masses turn
# gravity by.
_NEAR = 0.17
# Part of the variance left by the file's direction that the found one removes. Chosen: masses that
# are wrong turn gravity, too, and then explain little.
_REMOVED = 0.75
_BLOCKS = 10  # of time, by whose means the power of friction is tested
_DEVIATIONS = 3.0  # standard errors that decide its sign. Chosen: one chance in a hundred


@dataclass(frozen=True, eq=False)
class NominalTorque:
    """Samples of a recording beside what the masses in the arm's file require.

    Attributes:
        arm: The arm, without joints that lie beyond all recorded ones.
        q: (N, n) positions.
        qd: (N, n) velocities; zero for static poses.
        qdd: (N, n) accelerations; zero for static poses.
        effort: (N, n) efforts as read.
    """

    arm: Arm
    q: Array
    qd: Array
    qdd: Array
    effort: Array

    @classmethod
    def of(cls, given: Recording, arm: Arm) -> NominalTorque | None:
        """Return it; ``None`` where masses, efforts, or joints are not known, or samples few."""
        recording = recorded(given, arm)
        assert recording.arm is not None
        arm = recording.arm
        if recording.effort is None or recording.joints != arm.joint_names:
            return None
        if arm.inertial_parameters is None or len(recording) < FEWEST:
            return None
        rest = np.zeros_like(recording.position)
        signals = (recording.position, rest, rest, recording.effort)
        if (prepared := _filtered(recording)) is not None:
            own = prepared.filtered
            assert own.velocity is not None
            assert own.effort is not None
            signals = (own.position, own.velocity, prepared.acceleration, own.effort)
        step = max(1, len(signals[0]) // SAMPLES)
        return cls(arm, *(signal[::step] for signal in signals))

    @cached_property
    def weight(self) -> Array:
        """(N, n, 3) efforts of weight for each m/s^2 of gravity along the base's axes."""
        axes = (self._needed(None, None, axis) for axis in np.eye(3))
        return np.stack(tuple(axes), axis=2)

    @cached_property
    def inertia(self) -> Array:
        """(N, n) efforts that accelerate the links; zero where the file's inertia is in doubt."""
        if self.arm.warnings:
            return np.zeros_like(self.q)
        return self._needed(self.qd, self.qdd, np.zeros(3))

    def _needed(self, qd: Array | None, qdd: Array | None, gravity: Array) -> Array:
        assert self.arm.inertial_parameters is not None
        parameters = self.arm.inertial_parameters.ravel()
        return np.asarray(rigid_body.torque(self.arm, parameters, self.q, qd, qdd, gravity))


def recorded(given: Recording, arm: Arm) -> Recording:
    """Return a recording of the arm without joints beyond all recorded ones."""
    held, _ = held_beyond([given], arm, {})
    return given.of(arm.with_held_joints(held))


def _filtered(recording: Recording) -> Prepared | None:
    """Return a low-passed trajectory; ``None`` of poses, and of one too short or too slow."""
    if recording.rate is None or recording.rate < _RATE * BAND:
        return None
    try:
        return prepare(recording, _BANDS, warnings=())
    except RecordingError:  # whoever reads it next says why
        return None


@dataclass(frozen=True)
class Mounting:
    """Apparent mounting of a base.

    Attributes:
        roll: rad.
        pitch: rad.
        signs: Whether efforts of the wrong sign would show the same.
    """

    roll: float
    pitch: float
    signs: bool


def mounting(nominal: NominalTorque) -> Mounting | None:
    """Return the apparent mounting of the base where the efforts show another than the file's.

    The torque of given masses is linear in gravity, and friction in its coefficients. The strength
    of gravity and of inertia is free, so that a wrong unit or a common error of the masses does not
    matter.

    Returns:
        ``None`` where the efforts agree with the arm's file, or do not decide.
    """
    from scipy.optimize import nnls  # slow to load

    gravity = nominal.arm.gravity
    effort, inertia, weight = _without_friction(nominal)
    free = np.column_stack([weight, inertia])
    given = np.column_stack([weight @ gravity, inertia])
    found = np.linalg.lstsq(free, effort, rcond=None)[0]
    shown = found[:3]
    strength = float(np.linalg.norm(shown))
    cosine = shown @ gravity / max(strength * float(np.linalg.norm(gravity)), 1e-300)
    if strength == 0.0 or cosine > np.cos(MAX_TILT):  # less is a tilt, which is an effect
        return None
    # No negative strength, which would be another direction.
    left = effort - given @ nnls(given, effort)[0]
    explained = effort - free @ found
    if explained @ explained > (1.0 - _REMOVED) * (left @ left):
        return None
    # Efforts of the wrong sign weigh as on the ceiling, but friction would drive the joints.
    needed = nominal.weight @ shown + found[3] * nominal.inertia
    bears = (needed**2).sum(axis=0)
    power = ((nominal.effort - needed) * nominal.qd) @ (bears / bears.sum())
    mean = np.array([part.mean() for part in np.array_split(power, _BLOCKS)])
    error = _DEVIATIONS * np.std(mean, ddof=1) / np.sqrt(_BLOCKS)
    if mean.mean() < -error:
        return None
    direction = shown / strength
    usual = _USUAL[np.argmax(_USUAL @ direction)]
    if usual @ direction > np.cos(_NEAR):
        direction = usual
    x, y, z = direction.tolist()
    along_x = y == 0.0 and z == 0.0  # gravity along x: roll has no effect on it
    roll = 0.0 if along_x else float(np.arctan2(0.0 - y, -z))
    opposite = direction @ gravity < -np.cos(_NEAR) * np.linalg.norm(gravity)
    return Mounting(roll, float(np.arcsin(x)), bool(opposite and mean.mean() <= error))


def apparent_gravity(nominal: NominalTorque) -> Array:
    """Return (3,) gravity in the base frame that explains efforts best, m/s^2, of any tilt."""
    effort, inertia, weight = _without_friction(nominal)
    found = np.linalg.lstsq(np.column_stack([weight, inertia]), effort, rcond=None)[0][:3]
    size = np.linalg.norm(nominal.arm.gravity) / max(float(np.linalg.norm(found)), 1e-300)
    return np.asarray(size * found)


def _without_friction(nominal: NominalTorque) -> tuple[Array, Array, Array]:
    """Return all joints' (N n,) efforts, (N n, 1) inertia, (N n, 3) weight without friction."""
    rest = []
    for joint in range(nominal.arm.n):  # what its friction cannot explain
        needed = (nominal.effort[:, joint], nominal.inertia[:, joint], nominal.weight[:, joint])
        rest.append(without_friction(np.column_stack(needed), nominal.qd[:, joint]))
    effort, inertia, weight = np.split(np.concatenate(rest), [1, 2], axis=1)
    return effort[:, 0], inertia, weight
