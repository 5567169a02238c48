"""Drawing a motion that excites all joints and keeps the limits of a real arm."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.planning.limits import MotionLimits, PairLimit
from dvrk_gravity.planning.multisine import Multisine

Array = NDArray[np.float64]

GRID = 0.005  # s; a sine of 0.6 Hz is at most 5e-5 of its amplitude higher between two points


@dataclass(frozen=True)
class ExcitingSettings:
    """What an exciting motion is made of.

    Attributes:
        count: Sines a joint. Chosen.
        lowest: Their least frequency, Hz. Chosen.
        highest: Their greatest, Hz; published exciting motions of these arms reach 0.6 Hz.
        faster: Times the frequency at which a single sine at full range meets the limit of
            acceleration: of five sines each has about a third of the range, and may be faster
            (sqrt(3)).
        ramp: From rest into the motion, and out of it, s. Chosen.
    """

    count: int = 5
    lowest: float = 0.07
    highest: float = 0.6
    faster: float = 1.8
    ramp: float = 3.0


def exciting_motion(limits: MotionLimits, duration: float, seed: int) -> Multisine:
    """Draw a motion from rest to rest that goes as far, fast and hard as the limits allow.

    The sines of a pair's second joint (an MTM's elbow) drive the sum, whose range is the narrowest:
    it then moves against the first, and both go further than its own sines would let them.

    Args:
        limits: Of positions, velocities and accelerations.
        duration: s, at least two ramps.
        seed: Seed of frequencies, phases, amplitudes and middles.
    """
    random = np.random.default_rng(seed)
    lower, upper, pair = limits.lower.copy(), limits.upper.copy(), limits.pair
    if pair is not None:
        lower[pair.second], upper[pair.second] = pair.lower, pair.upper
    n = len(lower)
    used = limits.used * random.uniform(0.8, 1.0, n)
    reach = 0.5 * used * (upper - lower)
    full = np.sqrt(limits.acceleration / reach) / (2.0 * np.pi)
    sines = ExcitingSettings()
    fastest = np.clip(sines.faster * full, 2.0 * sines.lowest, sines.highest)
    frequency = random.uniform(sines.lowest, fastest, (sines.count, n))
    amplitude = random.uniform(0.3, 1.0, (sines.count, n)) / np.sqrt(frequency)
    phase = random.uniform(0.0, 2.0 * np.pi, (sines.count, n))
    drives = Multisine(np.zeros(n), amplitude, frequency, phase, sines.ramp, duration)
    time = np.arange(0.0, duration + GRID, GRID)

    ways = _signals(drives, time)
    scale = _most(ways, 2.0 * reach, limits)
    if pair is not None:
        i, j = pair.first, pair.second
        second = [way[:, j] * scale[j] - way[:, i] * scale[i] for way in ways]
        span = used[j] * (limits.upper - limits.lower)[j]
        both = _most([way[:, None] for way in second], span, limits, slice(j, j + 1))
        scale[[i, j]] *= min(1.0, both.item())

    drives = replace(drives, amplitude=amplitude * scale)
    if pair is None:
        way = drives.at(time)[0]
        lowest, highest = limits.lower - way.min(axis=0), limits.upper - way.max(axis=0)
        return replace(drives, middle=random.uniform(lowest, highest))
    motor = drives.at(time)[0][:, pair.second]
    motion = _of_joints(drives, pair)
    way = motion.at(time)[0]
    return replace(motion, middle=_middle(way, motor, limits, pair, random))


def _signals(motion: Multisine, time: Array) -> tuple[Array, Array, Array]:
    """Return (N, n) position and velocity, and (N - 1, n) acceleration between them."""
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


def _of_joints(drives: Multisine, pair: PairLimit) -> Multisine:
    """Return the motion of the joints: a pair's second one is its sum less the first."""
    i, j = pair.first, pair.second
    against = np.zeros_like(drives.amplitude)
    against[:, j] = -drives.amplitude[:, i]
    frequency, phase = drives.frequency.copy(), drives.phase.copy()
    frequency[:, j], phase[:, j] = frequency[:, i], phase[:, i]
    return replace(
        drives,
        amplitude=np.vstack([drives.amplitude, against]),
        frequency=np.vstack([drives.frequency, frequency]),
        phase=np.vstack([drives.phase, phase]),
    )


def _middle(
    way: Array, motor: Array, limits: MotionLimits, pair: PairLimit, random: np.random.Generator
) -> Array:
    """Draw (n,) middles for a way (N, n) of the joints and one (N,) of the pair's sum."""
    i, j = pair.first, pair.second
    lowest, highest = limits.lower - way.min(axis=0), limits.upper - way.max(axis=0)
    sum_low = pair.lower - motor.min()
    sum_high = pair.upper - motor.max()
    # Only where the second one finds a middle, too.
    lowest[i] = max(lowest[i], sum_low - highest[j])
    highest[i] = min(highest[i], sum_high - lowest[j])
    drawn = random.uniform(0.0, 1.0, len(lowest))
    middle = lowest + drawn * (highest - lowest)
    low = max(lowest[j], sum_low - middle[i])
    high = min(highest[j], sum_high - middle[i])
    middle[j] = low + drawn[j] * (high - low)
    return middle
