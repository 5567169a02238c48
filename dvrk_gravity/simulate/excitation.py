"""Exciting motions: band-limited sums of sines within the joints' limits, and static poses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arm import N_JOINTS, Arm
from dvrk_gravity.recording import Recording
from dvrk_gravity.simulate.run import simulate
from dvrk_gravity.simulate.simulated_arm import Measurement, SimulatedArm

Array = NDArray[np.float64]

_CREEP = 0.1  # of the speed of approach
# The part of a joint's range that a motion uses: joint 7 turns far more than it need.
_USED_RANGE = np.array([0.7, 0.8, 0.7, 0.7, 0.6, 0.7, 0.25])
_RAMP = 1.0  # s, from rest into the motion


@dataclass(frozen=True, eq=False)
class Multisine:
    """q(t) = middle + sum_k a_k sin(2 pi f_k t + phi_k), eased in from rest at its beginning.

    Attributes:
        middle: (7,) rad.
        amplitude: (k, 7) rad.
        frequency: (k, 7) Hz.
        phase: (k, 7) rad.
    """

    middle: Array
    amplitude: Array
    frequency: Array
    phase: Array

    @classmethod
    def draw(
        cls,
        arm: Arm,
        seed: int,
        lowest: float = 0.07,
        highest: float = 0.6,
        count: int = 5,
    ) -> Multisine:
        """Draw a motion that stays within the arm's limits.

        Args:
            arm: The arm.
            seed: Seed of frequencies, phases, amplitudes and middles.
            lowest: Lowest frequency, Hz.
            highest: Highest frequency, Hz.
            count: Sines a joint.
        """
        random = np.random.default_rng(seed)
        frequency = random.uniform(lowest, highest, (count, N_JOINTS))
        amplitude = random.uniform(0.3, 1.0, (count, N_JOINTS)) / np.sqrt(frequency)
        phase = random.uniform(0.0, 2.0 * np.pi, (count, N_JOINTS))
        used = 0.5 * (arm.upper - arm.lower) * _USED_RANGE
        amplitude *= used * random.uniform(0.7, 1.0, N_JOINTS) / amplitude.sum(axis=0)
        slack = 0.5 * (arm.upper - arm.lower) - amplitude.sum(axis=0)
        middle = 0.5 * (arm.lower + arm.upper) + random.uniform(-0.5, 0.5, N_JOINTS) * slack
        return cls(middle, amplitude, frequency, phase)

    def at(self, time: float) -> tuple[Array, Array]:
        """Return (7,) position, rad, and (7,) velocity, rad/s."""
        angle = 2.0 * np.pi * self.frequency * time + self.phase
        way = (self.amplitude * np.sin(angle)).sum(axis=0)
        speed = (2.0 * np.pi * self.frequency * self.amplitude * np.cos(angle)).sum(axis=0)
        if time < _RAMP:
            s = time / _RAMP
            ease, slope = s * s * (3.0 - 2.0 * s), 6.0 * s * (1.0 - s) / _RAMP
            way, speed = way * ease, way * slope + speed * ease
        return self.middle + way, speed


def record_motion(
    arm: SimulatedArm, motion: Multisine, duration: float = 30.0, rate: float = 200.0
) -> Recording:
    """Let the arm's servo follow a motion and record it from the end of the ramp on.

    Args:
        arm: The arm; it is put at the motion's beginning.
        motion: What to follow.
        duration: Of the recording, s.
        rate: Samples recorded, Hz.
    """
    arm.plant.reset(motion.at(0.0)[0])
    start = arm.plant.time

    def follow(simulated: SimulatedArm, _: Measurement) -> None:
        simulated.servo_jp(*motion.at(simulated.plant.time + simulated.dt - start))

    simulate(arm, follow, _RAMP, rate)
    return simulate(arm, follow, duration, rate)


def record_poses(
    arm: SimulatedArm, seed: int, count: int = 150, approach: float = 0.06, samples: int = 8
) -> Recording:
    """Record static poses, each approached from one side, as a calibration does.

    Args:
        arm: The arm.
        seed: Seed of poses and directions.
        count: Number of poses.
        approach: Way that every joint goes to a pose in the direction of approach, rad.
        samples: Readings averaged at every pose.

    Returns:
        Static poses with direction; position and effort are means of the readings.
    """
    random = np.random.default_rng(seed)
    geometry = arm.plant.model.arm
    used = 0.5 * (geometry.upper - geometry.lower) * _USED_RANGE - 2.0 * approach
    middle = 0.5 * (geometry.lower + geometry.upper)
    time, settled = round(0.3 / arm.dt), round(0.15 / arm.dt)
    position = np.empty((count, N_JOINTS))
    effort, direction = np.empty_like(position), np.empty_like(position)
    for pose in range(count):
        # All joints one way: then the motors that move several joints go that way too.
        sign = np.full(N_JOINTS, -1.0 if random.random() < 0.5 else 1.0)
        goal = middle + used * random.uniform(-1.0, 1.0, N_JOINTS)
        speed = approach * sign / 0.3
        arm.plant.reset(goal - approach * sign)
        for step in range(time):
            arm.servo_jp(goal - approach * sign + speed * step * arm.dt, speed)
            arm.step()
        readings = []
        # Still creeping: dry friction is whole, as where a position loop has just arrived, and
        # viscous friction is all but gone.
        creep = speed * _CREEP
        for step in range(settled + samples):
            arm.servo_jp(arm.target + creep * arm.dt if arm.target is not None else goal, creep)
            arm.step()
            if step >= settled:
                measured = arm.measure()
                readings.append((measured.position, measured.effort))
        position[pose], effort[pose] = np.mean(readings, axis=0)
        direction[pose] = sign
    return Recording(
        geometry.joint_names,
        None,
        position,
        effort=effort,
        direction=direction,
        source="simulated poses",
    )
