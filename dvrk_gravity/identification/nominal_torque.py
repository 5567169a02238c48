"""What efforts the masses in an arm's file need along a recording: of weight, and of inertia."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base import rigid_body
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.identification.beyond import held_beyond
from dvrk_gravity.recording import Recording, RecordingFile, Segment, prepare


@dataclass(frozen=True)
class NominalSettings:
    """What is looked at.

    Attributes:
        band: Hz, of the low-pass that motion and efforts go through: that of a diagnosis.
        rate: Samples a second, of that band, a recording must at least have. Chosen.
        samples: Samples that are looked at, at most: a bound on time.
        fewest: ... and at least: of two, effort and weight always correlate. Chosen.
    """

    band: float = 8.0
    rate: float = 4.0
    samples: int = 5000
    fewest: int = 10


@dataclass(frozen=True, eq=False)
class NominalTorque:
    """Samples of a recording beside what the masses in the arm's file need.

    Attributes:
        arm: The arm, without joints that lie beyond all that was recorded.
        q: (N, n) positions.
        qd: (N, n) velocities; zero for static poses.
        qdd: (N, n) accelerations; zero for static poses.
        effort: (N, n) efforts as read.
        static: Whether these are poses.
    """

    arm: Arm
    q: Array
    qd: Array
    qdd: Array
    effort: Array
    static: bool

    @classmethod
    def of(
        cls, given: Recording | RecordingFile, arm: Arm, settings: NominalSettings | None = None
    ) -> NominalTorque | None:
        """Return it; ``None`` where masses, efforts, or joints are not known, or samples few."""
        settings = settings or NominalSettings()
        held, _ = held_beyond([given], arm, {})
        arm = arm.holding(held)
        recording = given.of(arm).head
        if recording.effort is None or recording.joints != arm.joint_names:
            return None
        if arm.inertial_parameters is None or len(recording) < settings.fewest:
            return None
        static = recording.time is None
        rest = np.zeros_like(recording.position)
        signals = [(recording.position, rest, rest, recording.effort)]
        if not static:
            signals = [_signals(part) for part in _parts(recording, settings)] or signals
        step = max(1, sum(len(each[0]) for each in signals) // settings.samples)
        q, qd, qdd, effort = (
            np.concatenate([signal[::step] for signal in same])
            for same in zip(*signals, strict=True)
        )
        return cls(arm, q, qd, qdd, effort, static)

    @cached_property
    def weight(self) -> Array:
        """(N, n, 3) efforts of weight for each m/s^2 of gravity along the base's axes."""
        axes = (self._needed(None, None, axis) for axis in np.eye(3))
        return np.stack(tuple(axes), axis=2)

    @cached_property
    def inertia(self) -> Array:
        """(N, n) efforts that accelerate the links; zero where the file's inertia is doubted."""
        if self.arm.doubts:
            return np.zeros_like(self.q)
        return self._needed(self.qd, self.qdd, np.zeros(3))

    def _needed(self, qd: Array | None, qdd: Array | None, gravity: Array) -> Array:
        assert self.arm.inertial_parameters is not None
        parameters = self.arm.inertial_parameters.ravel()
        return np.asarray(rigid_body.torque(self.arm, parameters, self.q, qd, qdd, gravity))


def _parts(recording: Recording, settings: NominalSettings) -> tuple[Segment, ...]:
    """Return uniform parts, low-passed; none of what is too short or too slow for that."""
    rate = recording.rate
    if rate is None or rate < settings.rate * settings.band:
        return ()
    try:
        return prepare(recording, settings.band, warnings=()).segments
    except RecordingError:  # whoever reads it next says why
        return ()


def _signals(part: Segment) -> tuple[Array, Array, Array, Array]:
    """Return position, velocity, acceleration and effort that no end transient reaches."""
    velocity, effort = part.recording.velocity, part.recording.effort
    assert velocity is not None
    assert part.acceleration is not None
    assert effort is not None
    every = (part.recording.position, velocity, part.acceleration, effort)
    position, velocity, acceleration, effort = (signal[part.core] for signal in every)
    return position, velocity, acceleration, effort
