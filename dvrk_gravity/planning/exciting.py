"""Drawing a motion that excites all joints and keeps the limits of a real arm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.planning.fourier import FourierMotion
from dvrk_gravity.planning.keeping import slacks
from dvrk_gravity.planning.limits import PairLimit, PlanLimits
from dvrk_gravity.planning.motions import Multisine
from dvrk_gravity.planning.plan import Plan
from dvrk_gravity.planning.pose_path import PosePath

ROUNDING = 1e-6  # of a limit
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


@dataclass(frozen=True)
class SweepSettings:
    """How a motion covers the range beside its sines, which their accelerations keep small.

    Attributes:
        share: Part of the amplitudes that the sines have without it: the rest of velocities and
            accelerations is the sweep's. Chosen.
        lowest: Least cycles in a motion: every joint goes through its range in both directions.
        highest: Most cycles. Chosen: so slow that a sweep takes a tenth of the acceleration.
        steps: Halvings of the sweep's interval: to a thousandth of it.
        draws: So many sweeps are drawn; the one that leaves out least of a joint is taken. Chosen.
    """

    share: float = 0.85
    lowest: float = 1.2
    highest: float = 1.8
    steps: int = 10
    draws: int = 12


def exciting_motion(limits: PlanLimits, duration: float, seed: int) -> Multisine:
    """Draw a motion from rest to rest that goes as far, fast and hard as the limits allow.

    The sines of a pair's second joint (an MTM's elbow) drive the sum, whose range is the narrowest:
    it then moves against the first, and both go further than its own sines would let them.

    Args:
        limits: Of positions, velocities and accelerations.
        duration: s, at least two ramps.
        seed: Seed of frequencies, phases, amplitudes and middles.
    """
    random = np.random.default_rng(seed)
    drives = _sines(limits, duration, random)
    return _place_motion(drives, limits, random.uniform(0.0, 1.0, len(limits.lower)))


def covering_motion(limits: PlanLimits, duration: float, seed: int) -> Multisine:
    """Draw a motion like :func:`exciting_motion` that also goes through the whole of the range.

    Accelerations keep the sines to about half of it; a slow sine of every joint, which takes hardly
    any, carries them through the rest. Motions of all seeds are in the same middle, so that one
    judges a model of another.

    Args:
        limits: Of positions, velocities and accelerations.
        duration: s, at least two ramps.
        seed: Seed of frequencies, phases and amplitudes.
    """
    random = np.random.default_rng(seed)
    sines = _sines(limits, duration, random)
    settings = SweepSettings()
    sines = replace(sines, amplitude=settings.share * sines.amplitude)
    drawn = [_with_sweep(sines, limits, random) for _ in range(settings.draws)]
    return max(drawn, key=lambda motion: float(coverage([motion], limits).min()))


def covering_plan(arm: Arm, duration: float, seed: int) -> Plan:
    """Return the plan of a :func:`covering_motion`: the same sines, eased in and out as a plan's.

    Args:
        arm: The arm, whose own limits are kept.
        duration: s, at least two ramps.
        seed: Seed of frequencies, phases and amplitudes.
    """
    limits = PlanLimits.of(arm)
    drawn = covering_motion(limits, duration, seed)
    motion = FourierMotion.of_sines(
        drawn.middle, drawn.amplitude, drawn.frequency, drawn.phase, drawn.ramp, duration
    )
    while (most := max(slack.used for slack in slacks(motion, limits, arm))) > 1.0:
        # Velocities and accelerations are in proportion, positions nearly.
        motion = replace(motion, coefficients=motion.coefficients * (1.0 - ROUNDING) / most)
    return Plan(arm, motion, limits)


def _with_sweep(sines: Multisine, limits: PlanLimits, random: np.random.Generator) -> Multisine:
    """Return a motion of the joints with a slow sine of each beside its own."""
    settings = SweepSettings()
    lower, upper = _drive_limits(limits)
    span, n = limits.used * (upper - lower), len(lower)
    cycles = random.uniform(settings.lowest, settings.highest, (1, n))
    phase = random.uniform(0.0, 2.0 * np.pi, (1, n))
    sweep = replace(
        sines, amplitude=0.5 * span[None], frequency=cycles / sines.duration, phase=phase
    )
    time = np.arange(0.0, sines.duration + GRID, GRID)
    fast, slow = _signals(sines, time), _signals(sweep, time)
    part = _largest(fast, slow, span, limits, slice(None))
    if limits.pair is not None:
        i, j = limits.pair.first, limits.pair.second
        second, swept = (
            [way[:, j : j + 1] * of[j] - way[:, i : i + 1] * of[i] for way in ways]
            for ways, of in ((fast, np.ones(n)), (slow, part))
        )
        own = limits.used[j] * (limits.upper - limits.lower)[j]
        part[[i, j]] *= _largest(second, swept, own, limits, slice(j, j + 1)).item()
    motion = replace(
        sines,
        amplitude=np.vstack([sines.amplitude, part * sweep.amplitude]),
        frequency=np.vstack([sines.frequency, sweep.frequency]),
        phase=np.vstack([sines.phase, sweep.phase]),
    )
    return _place_motion(motion, limits, np.full(n, 0.5))


def coverage(motions: Sequence[Multisine | FourierMotion | PosePath], limits: PlanLimits) -> Array:
    """Return the (n,) parts of what motions may use of each joint's range that they go through.

    Args:
        motions: One or more.
        limits: What they keep; the range is that within its margins.
    """
    ways = [motion.at(np.arange(0.0, motion.duration, 20 * GRID))[0] for motion in motions]
    part: Array = np.ptp(np.vstack(ways), axis=0) / (limits.used * (limits.upper - limits.lower))
    return part


def _drive_limits(limits: PlanLimits) -> tuple[Array, Array]:
    """Return (n,) lowest and highest positions of what drives the joints.

    A pair's second drive is the sum of the two joints.
    """
    lower, upper, pair = limits.lower.copy(), limits.upper.copy(), limits.pair
    if pair is not None:
        lower[pair.second], upper[pair.second] = pair.lower, pair.upper
    return lower, upper


def _sines(limits: PlanLimits, duration: float, random: np.random.Generator) -> Multisine:
    """Draw the sines of what drives the joints."""
    (lower, upper), pair = _drive_limits(limits), limits.pair
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
    return replace(drives, amplitude=amplitude * scale)


def _place_motion(drives: Multisine, limits: PlanLimits, place: Array) -> Multisine:
    """Return the motion of the joints around middles at (n,) places, 0 to 1, of where they fit."""
    time = np.arange(0.0, drives.duration + GRID, GRID)
    if limits.pair is None:
        way = drives.at(time)[0]
        lowest, highest = limits.lower - way.min(axis=0), limits.upper - way.max(axis=0)
        return replace(drives, middle=lowest + place * (highest - lowest))
    motor = drives.at(time)[0][:, limits.pair.second]
    motion = _of_joints(drives, limits.pair)
    way = motion.at(time)[0]
    return replace(motion, middle=_middle(way, motor, limits, limits.pair, place))


def _largest(
    fast: Sequence[Array], slow: Sequence[Array], span: Array | float, limits: PlanLimits,
    joints: slice,
) -> Array:  # fmt: skip
    """Return the largest part, 0 to 1, of slow signals that fits beside fast ones."""
    part = np.zeros(fast[0].shape[1])
    for step in range(1, SweepSettings().steps + 1):
        more = part + 0.5**step
        both = [a + more * b for a, b in zip(fast, slow, strict=True)]
        part = np.where(_most(both, span, limits, joints) >= 1.0, more, part)
    return part


def _signals(motion: Multisine, time: Array) -> tuple[Array, Array, Array]:
    """Return (N, n) position and velocity, and (N - 1, n) acceleration between them."""
    position, velocity = motion.at(time)
    return position, velocity, np.diff(velocity, axis=0) / GRID


def _most(
    signals: Sequence[Array], span: Array | float, limits: PlanLimits,
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


def _middle(way: Array, motor: Array, limits: PlanLimits, pair: PairLimit, place: Array) -> Array:
    """Return (n,) middles for a way (N, n) of the joints and one (N,) of the pair's sum."""
    i, j = pair.first, pair.second
    lowest, highest = limits.lower - way.min(axis=0), limits.upper - way.max(axis=0)
    sum_low = pair.lower - motor.min()
    sum_high = pair.upper - motor.max()
    # Only where the second one finds a middle, too.
    lowest[i] = max(lowest[i], sum_low - highest[j])
    highest[i] = min(highest[i], sum_high - lowest[j])
    middle = lowest + place * (highest - lowest)
    low = max(lowest[j], sum_low - middle[i])
    high = min(highest[j], sum_high - middle[i])
    middle[j] = low + place[j] * (high - low)
    return middle
