"""What the arm's sensors make of the truth: counts, noise, and stamps that do not quite agree."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array

# Readings for which random numbers are drawn at a time: one call costs as much as many numbers.
_DRAWN = 256


@dataclass(frozen=True, eq=False)
class Sensors:
    """Encoders and current sensors sit at the motors, so all of it is in actuator space.

    Attributes:
        position_step: (n,) encoder step, rad or m; 0, or ``None``: continuous.
        velocity_noise: (n,) standard deviation of the velocity, rad/s or m/s; ``None``: none.
        effort_step: (n,) step of the effort measurement, N·m or N; 0, or ``None``: continuous.
        effort_noise: (n,) standard deviation of the effort, N·m or N; ``None``: none.
        effort_delay: How much older than the position the effort in one message is, s.
    """

    position_step: Array | None = None
    velocity_noise: Array | None = None
    effort_step: Array | None = None
    effort_noise: Array | None = None
    effort_delay: float = 0.0


class SensorReader:
    """Reads one arm through its sensors, with random numbers from a seed.

    The random numbers of a sample are drawn whether or not they are used, so that two runs
    with one seed stay comparable when a noise is switched off.
    """

    def __init__(self, sensors: Sensors, arm: Arm, seed: int, dt: float) -> None:
        """Start reading.

        Args:
            sensors: The sensors.
            arm: The arm, for its transmission.
            seed: Seed of the random numbers.
            dt: Time between two readings, s.
        """
        self._to_motor = arm.joint_to_actuator
        self._to_joint = arm.actuator_to_joint
        self._effort_to_motor = np.ascontiguousarray(arm.actuator_to_joint.T)
        self._effort_to_joint = np.ascontiguousarray(arm.joint_to_actuator.T)
        steps, noises = (
            [np.zeros(arm.n) if array is None else array for array in pair]
            for pair in (
                (sensors.position_step, sensors.effort_step),
                (sensors.velocity_noise, sensors.effort_noise),
            )
        )
        self._position, self._effort = (_Counter(step) for step in steps)
        self._noise_levels = np.stack(noises)
        self._random = np.random.default_rng(seed)
        self._noise: Iterator[Array] = iter(())
        self._late: deque[Array] = deque(maxlen=1 + round(sensors.effort_delay / dt))

    def read(self, q: Array, v: Array, effort: Array) -> tuple[Array, Array, Array]:
        """Return measured position, velocity and effort, (n,) each, in joint space.

        Args:
            q: (n,) true position, rad.
            v: (n,) true velocity, rad/s.
            effort: (n,) torque of the actuators in joint space, N·m.
        """
        noise = next(self._noise, None)
        if noise is None:
            self._noise = self._draw()
            noise = next(self._noise)
        position = self._to_joint.dot(self._position.count(self._to_motor.dot(q)))
        motor = self._effort_to_motor.dot(effort) + noise[1]
        self._late.append(self._effort_to_joint.dot(self._effort.count(motor)))
        return position, v + noise[0], self._late[0]

    def _draw(self) -> Iterator[Array]:
        """Return the noise of the next readings, (2, n): joint velocity and actuator effort."""
        noise = (
            self._random.standard_normal((_DRAWN, *self._noise_levels.shape)) * self._noise_levels
        )
        noise[:, 0] = noise[:, 0] @ self._to_joint.T
        return iter(noise)


class _Counter:
    """Rounds (n,) values to whole steps; where the step is 0, they stay as they are."""

    def __init__(self, step: Array) -> None:
        self._step = step
        self._continuous = (step == 0.0).astype(float)
        self._some_continuous = bool(self._continuous.any())
        self._per_unit = (1.0 - self._continuous) / (step + self._continuous)

    def count(self, value: Array) -> Array:
        counted = value * self._per_unit
        np.rint(counted, out=counted)
        counted *= self._step
        if self._some_continuous:
            counted += value * self._continuous
        return counted
