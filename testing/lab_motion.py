"""Motions that a laboratory records: drawn exciting ones, and Fourier series that repeat."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.planning import PlanLimits, exciting_motion

Random = np.random.Generator

HARMONICS = 6  # of a series, as published exciting motions have them
BASE = (0.06, 0.1)  # Hz; published ones of master arms have 0.0857 and 0.1
NEAR, BEYOND = 0.75, 0.05  # of other motions; of the way of a calibration
LONGEST = 120.0  # s, of a drawn motion
_RAMP = 3.0  # s, in which a drawn motion is eased in


@dataclass(frozen=True, eq=False)
class Sines:
    """q(t) = middle + sum_k a_k sin(2 pi f_k t + phi_k), with all its derivatives.

    Attributes:
        middle: (n,) rad or m.
        amplitude: (k, n) rad or m.
        frequency: (k, n) Hz.
        phase: (k, n) rad.
    """

    middle: Array
    amplitude: Array
    frequency: Array
    phase: Array

    def at(self, time: Array) -> tuple[Array, Array, Array]:
        """Return (N, n) positions, velocities and accelerations at (N,) times, s."""
        omega = 2.0 * np.pi * self.frequency
        angle = omega * np.asarray(time)[:, None, None] + self.phase
        sine, cosine = self.amplitude * np.sin(angle), self.amplitude * np.cos(angle)
        position = self.middle + sine.sum(axis=1)
        return position, (omega * cosine).sum(axis=1), -(omega**2 * sine).sum(axis=1)


def draw_calibration(arm: Arm, seed: int) -> Sines:
    """Return a motion to identify from: all of the range that a program may use, and brisk."""
    random = np.random.default_rng([seed, 1])
    return _draw(arm, random, random.uniform(0.8, 1.0), random.uniform(1.0, 1.5))


def draw_other(
    arm: Arm, seed: int, calibration: Sines | None = None, duration: float = LONGEST,
    near: float = NEAR,
) -> Sines:  # fmt: skip
    """Return a motion to diagnose from: less far or slower in some, faster in others.

    Three of four, by default, stay about where the calibration went; the others go anywhere, and
    where that is another place than the calibration's, no model can know what cables do there.

    Args:
        arm: The arm.
        seed: Of the motion.
        calibration: The motion that was identified from; ``None``: anywhere.
        duration: For which it keeps the limits, s.
        near: Part of the motions that stay about where the calibration went.
    """
    random = np.random.default_rng([seed, 2])
    part = float(random.choice([1.0, 0.9, 0.6]))
    speed = float(random.choice([1.2, 1.0, 1.6, 0.7]))
    about = calibration if random.random() < near else None
    return _draw(arm, random, part, speed, about, duration)


def _draw(
    arm: Arm, random: Random, part: float, speed: float, about: Sines | None = None,
    duration: float = LONGEST,
) -> Sines:  # fmt: skip
    limits = PlanLimits.of(arm)
    limits = replace(
        limits if about is None else _around(limits, about),
        velocity=speed * limits.velocity,
        acceleration=speed * limits.acceleration,
    )
    limits = replace(limits, used=part * limits.used)
    if random.random() < 0.4:
        return fourier(limits, min(speed, 1.0) * float(random.uniform(*BASE)), random)
    drawn = exciting_motion(limits, duration, int(random.integers(1 << 30)))
    phase = drawn.phase + 2.0 * np.pi * drawn.frequency * _RAMP
    return Sines(drawn.middle, drawn.amplitude, drawn.frequency, phase)


def _around(limits: PlanLimits, about: Sines) -> PlanLimits:
    """Return limits within which another motion went, and a little beyond.

    Those of a pair's joints are as they were: they are narrow.
    """
    way = about.at(np.arange(0.0, 30.0, 0.02))[0]
    lowest, highest = way.min(axis=0), way.max(axis=0)
    more = BEYOND * (highest - lowest)
    lower, upper = np.maximum(limits.lower, lowest - more), np.minimum(limits.upper, highest + more)
    used = np.ones(len(lower))
    if limits.pair is not None:
        both = [limits.pair.first, limits.pair.second]
        lower[both], upper[both] = limits.lower[both], limits.upper[both]
        used[both] = limits.used[both]
    return replace(limits, lower=lower, upper=upper, used=used)


def fourier(limits: PlanLimits, base: float, random: Random) -> Sines:
    """Draw a series of six harmonics that keeps the limits.

    Args:
        limits: Of positions, velocities and accelerations.
        base: Frequency with which it repeats, Hz.
        random: Where amplitudes, phases and middles come from.
    """
    n, pair = len(limits.lower), limits.pair
    lower, upper = limits.lower.copy(), limits.upper.copy()
    if pair is not None:  # the second's series drives the sum
        lower[pair.second], upper[pair.second] = pair.lower, pair.upper
    harmonic = np.arange(1.0, HARMONICS + 1.0)[:, None]
    frequency = np.tile(base * harmonic, (1, n))
    amplitude = random.uniform(0.2, 1.0, (HARMONICS, n)) / harmonic**2
    phase = random.uniform(0.0, 2.0 * np.pi, (HARMONICS, n))
    series = Sines(np.zeros(n), amplitude, frequency, phase)
    time = np.linspace(0.0, 1.0 / base, 2000)
    way, velocity, acceleration = series.at(time)
    factor = np.min(
        [
            limits.used * (upper - lower) / np.ptp(way, axis=0),
            limits.velocity / np.abs(velocity).max(axis=0),
            limits.acceleration / np.abs(acceleration).max(axis=0),
        ],
        axis=0,
    )
    if pair is None:
        series = replace(series, amplitude=factor * amplitude)
        way = series.at(time)[0]
        low, high = lower - way.min(axis=0), upper - way.max(axis=0)
        drawn = random.uniform(0.0, 1.0, n)  # what uses all of its range leaves no room at all
        return replace(series, middle=low + drawn * (high - low))
    i, j = pair.first, pair.second
    while True:
        joints = _of_joints(replace(series, amplitude=factor * amplitude), i, j)
        way, velocity, _ = joints.at(time)
        total = way[:, i] + way[:, j]
        low, high = limits.lower - way.min(axis=0), limits.upper - way.max(axis=0)
        fast = np.abs(velocity[:, j]).max() > limits.velocity[j]
        middle = low + random.uniform(0.0, 1.0, n) * (high - low)
        least = max(low[j], pair.lower - total.min() - middle[i])
        most = min(high[j], pair.upper - total.max() - middle[i])
        if least < most and not fast:
            middle[j] = random.uniform(least, most)
            return replace(joints, middle=middle)
        factor[[i, j]] *= 0.95


def _of_joints(drives: Sines, i: int, j: int) -> Sines:
    """Return the motion of the joints where a motor drives the sum of two."""
    against = np.zeros_like(drives.amplitude)
    against[:, j] = -drives.amplitude[:, i]
    phase = drives.phase.copy()
    phase[:, j] = phase[:, i]
    return replace(
        drives,
        amplitude=np.vstack([drives.amplitude, against]),
        frequency=np.vstack([drives.frequency, drives.frequency]),
        phase=np.vstack([drives.phase, phase]),
    )
