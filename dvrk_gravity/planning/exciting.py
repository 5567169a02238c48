"""Drawing a motion that excites all joints and keeps the limits of a real arm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arm import N_JOINTS
from dvrk_gravity.planning.limits import MotionLimits
from dvrk_gravity.planning.multisine import Multisine

Array = NDArray[np.float64]

SHOULDER, ELBOW = 1, 2
COUNT = 5  # sines a joint
LOWEST, HIGHEST = 0.07, 0.6  # Hz; published exciting motions of these arms reach 0.6 Hz
# A single sine at full range meets the limit of acceleration at some frequency. Of five sines each
# has about a third of the range, and may be faster.
FASTER = 1.8
USED_RANGE = np.array([0.9, 0.9, 0.9, 0.9, 0.9, 0.9, 0.3])  # roll turns far more than it need
RAMP = 3.0  # s
GRID = 0.005  # s; a sine of HIGHEST is at most 5e-5 of its amplitude higher between two points


def exciting_motion(limits: MotionLimits, duration: float, seed: int) -> Multisine:
    """Draw a motion from rest to rest that goes as far, fast and hard as the limits allow.

    The elbow's sines drive its motor, q2 + q3, whose range is the narrowest: the elbow then moves
    against the shoulder, and both go further than sines of q3 would let them.

    Args:
        limits: Of positions, velocities and accelerations.
        duration: s, at least two ramps of ``RAMP`` seconds.
        seed: Seed of frequencies, phases, amplitudes and middles.
    """
    random = np.random.default_rng(seed)
    lower, upper = limits.lower.copy(), limits.upper.copy()
    lower[ELBOW], upper[ELBOW] = limits.elbow_motor
    used = USED_RANGE * random.uniform(0.8, 1.0, N_JOINTS)
    reach = 0.5 * used * (upper - lower)
    full = np.sqrt(limits.acceleration / reach) / (2.0 * np.pi)
    frequency = random.uniform(LOWEST, np.clip(FASTER * full, 2.0 * LOWEST, HIGHEST),
                               (COUNT, N_JOINTS))  # fmt: skip
    amplitude = random.uniform(0.3, 1.0, (COUNT, N_JOINTS)) / np.sqrt(frequency)
    phase = random.uniform(0.0, 2.0 * np.pi, (COUNT, N_JOINTS))
    drives = Multisine(np.zeros(N_JOINTS), amplitude, frequency, phase, RAMP, duration)
    time = np.arange(0.0, duration + GRID, GRID)

    ways = _signals(drives, time)
    scale = _most(ways, 2.0 * reach, limits)
    elbow = [way[:, ELBOW] * scale[ELBOW] - way[:, SHOULDER] * scale[SHOULDER] for way in ways]
    span = used[ELBOW] * (limits.upper - limits.lower)[ELBOW]
    both = _most([way[:, None] for way in elbow], span, limits, slice(ELBOW, ELBOW + 1))
    scale[[SHOULDER, ELBOW]] *= min(1.0, both.item())

    drives = replace(drives, amplitude=amplitude * scale)
    motor = drives.at(time)[0][:, ELBOW]
    motion = _of_joints(drives)
    way = motion.at(time)[0]
    return replace(motion, middle=_middle(way, motor, limits, random))


def _signals(motion: Multisine, time: Array) -> tuple[Array, Array, Array]:
    """Return (N, 7) position and velocity, and (N - 1, 7) acceleration between them."""
    position, velocity = motion.at(time)
    return position, velocity, np.diff(velocity, axis=0) / GRID


def _most(
    signals: tuple[Array, ...] | list[Array], span: Array, limits: MotionLimits,
    joints: slice = slice(None),
) -> Array:  # fmt: skip
    """Return the greatest factor with which signals keep a span and the limits of the joints."""
    way, velocity, acceleration = signals
    factors: Array = np.min(
        [
            span / np.ptp(way, axis=0),
            limits.velocity[joints] / np.abs(velocity).max(axis=0),
            limits.acceleration[joints] / np.abs(acceleration).max(axis=0),
        ],
        axis=0,
    )
    return factors


def _of_joints(drives: Multisine) -> Multisine:
    """Return the motion of the joints: q3 is the motor's angle less q2."""
    against = np.zeros_like(drives.amplitude)
    against[:, ELBOW] = -drives.amplitude[:, SHOULDER]
    frequency, phase = drives.frequency.copy(), drives.phase.copy()
    frequency[:, ELBOW], phase[:, ELBOW] = frequency[:, SHOULDER], phase[:, SHOULDER]
    return replace(
        drives,
        amplitude=np.vstack([drives.amplitude, against]),
        frequency=np.vstack([drives.frequency, frequency]),
        phase=np.vstack([drives.phase, phase]),
    )


def _middle(way: Array, motor: Array, limits: MotionLimits, random: np.random.Generator) -> Array:
    """Draw (7,) middles for a way (N, 7) of the joints and one (N,) of the elbow's motor."""
    lowest, highest = limits.lower - way.min(axis=0), limits.upper - way.max(axis=0)
    sum_low = limits.elbow_motor[0] - motor.min()
    sum_high = limits.elbow_motor[1] - motor.max()
    # Only where the elbow finds a middle, too.
    lowest[SHOULDER] = max(lowest[SHOULDER], sum_low - highest[ELBOW])
    highest[SHOULDER] = min(highest[SHOULDER], sum_high - lowest[ELBOW])
    drawn = random.uniform(0.0, 1.0, N_JOINTS)
    middle = lowest + drawn * (highest - lowest)
    low = max(lowest[ELBOW], sum_low - middle[SHOULDER])
    high = min(highest[ELBOW], sum_high - middle[SHOULDER])
    middle[ELBOW] = low + drawn[ELBOW] * (high - low)
    return middle
