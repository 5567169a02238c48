"""Friction, cables, springs and sensors as laboratories have them, and no effect of the package.

Friction is LuGre's (Canudas de Wit et al. 1995) with a Stribeck curve that differs by direction and
damping that falls off with speed; cables bend like tanh, ripple over the range, and lag behind.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.recording import Recording

Random = np.random.Generator

AFTER = 0.1  # s, that a truth goes on after what is recorded of it


@dataclass(frozen=True, eq=False)
class Truth:
    """A motion and its efforts without sensors, on any grid of times.

    Attributes:
        arm: Whose joints.
        time: (T,) s.
        q: (T, n) positions as encoders without steps read them, rad or m.
        qd: (T, n) velocities.
        qdd: (T, n) accelerations.
        effort: (T, n) in joint space, N·m or N.
    """

    arm: Arm
    time: Array
    q: Array
    qd: Array
    qdd: Array
    effort: Array

    @property
    def motion(self) -> tuple[Array, Array, Array]:
        """Positions, velocities and accelerations."""
        return self.q, self.qd, self.qdd


def lagging(way: Array, goal: Array, length: Array) -> Array:
    """Return (T, n) what follows a goal as a joint goes on: dF = (goal - F) |dq| / length.

    With a goal that has the sign of the motion it is a bristle's force (Dahl 1968, LuGre's z).

    Args:
        way: (T, n) positions.
        goal: (T, n) what it would be after a long way.
        length: (n,) way that leaves 1/e of what is between them.
    """
    steps = np.abs(np.diff(way, axis=0, prepend=way[:1]))
    decay = np.exp(-steps / length)
    come = (1.0 - decay) * goal
    result = np.zeros_like(way)
    force = np.zeros(way.shape[1])
    for row in range(len(way)):
        force = decay[row] * force + come[row]
        result[row] = force
    return result


@dataclass(frozen=True, eq=False)
class Friction:
    """Friction at n sites, joints or motors; arrays are (n,).

    Attributes:
        level: Coulomb's, N·m or N.
        uneven: Part by which it is more one way and less the other.
        rise: Part of it by which it is more near rest.
        velocity: At which 1/e of the rise is left, rad/s or m/s.
        length: Way in which it builds up after a reversal, rad or m.
        damping: Its growth with speed, N·m at ``fast``.
        fast: A speed of the site, rad/s or m/s.
        bend: Power of speed with which damping grows, at most 1.
        load: Part of the site's load that is added to the level, as gears have it.
    """

    level: Array
    uneven: Array
    rise: Array
    velocity: Array
    length: Array
    damping: Array
    fast: Array
    bend: Array
    load: Array

    @classmethod
    def draw(cls, level: Array, fast: Array, scale: Array, random: Random) -> Friction:
        """Draw friction around (n,) levels; speeds and the scale of positions are (n,), too."""
        n = len(level)
        bristles = random.random(n) < 0.5  # else it turns round at once
        return cls(
            level=level * random.uniform(0.5, 1.5, n),
            uneven=random.uniform(-0.2, 0.2, n),
            rise=random.uniform(0.0, 0.4, n),
            velocity=fast * random.uniform(0.03, 0.12, n),
            length=scale * np.where(bristles, random.uniform(0.005, 0.02, n), 0.0005),
            damping=level * random.uniform(0.2, 1.0, n),
            fast=fast,
            bend=random.uniform(0.75, 1.0, n),
            load=random.uniform(0.0, 0.02, n) * (random.random(n) < 0.5),
        )

    def middle(self, load: Array) -> Array:
        """Return (T, n) torque halfway between both ways of slow motion, N·m or N."""
        return (self.level + self.load * np.abs(load)) * self.uneven

    def torque(self, q: Array, qd: Array, load: Array) -> Array:
        """Return (T, n) friction for positions, velocities and loads (T, n), N·m or N."""
        way = np.sign(qd)
        curve = 1.0 + self.rise * np.exp(-((qd / self.velocity) ** 2))
        level = (self.level + self.load * np.abs(load)) * (1.0 + self.uneven * way) * curve
        damping = self.damping * way * (np.abs(qd) / self.fast) ** self.bend
        return lagging(q, level * way, self.length) + damping


@dataclass(frozen=True, eq=False)
class Cable:
    """A cable bundle at every joint; arrays are (n,) but for the ripples'.

    Attributes:
        middle: Of the range, rad or m.
        span: Half the range.
        pull: Linear part at the end of the range, N·m or N.
        bend: Height of the tanh.
        centre: Where it bends.
        width: Within which it bends.
        ripple: (k, n) heights of the sines over the range.
        phase: (k, n) of them, rad.
        lag: Height of its hysteresis.
        length: Way within which that turns round.
    """

    middle: Array
    span: Array
    pull: Array
    bend: Array
    centre: Array
    width: Array
    ripple: Array
    phase: Array
    lag: Array
    length: Array

    @classmethod
    def draw(cls, level: Array, lower: Array, upper: Array, random: Random) -> Cable:
        """Draw cables around (n,) levels over a range."""
        n, span = len(level), 0.5 * (upper - lower)
        sign = random.choice([-1.0, 1.0], (2, n))
        middle = 0.5 * (lower + upper)
        return cls(
            middle=middle,
            span=span,
            pull=level * random.uniform(0.5, 1.5, n),
            bend=level * random.uniform(0.2, 1.0, n) * sign[0],
            centre=middle + span * random.uniform(-0.5, 0.5, n),
            width=span * random.uniform(0.2, 0.6, n),
            ripple=level * random.uniform(0.0, 0.2, (3, n)) / np.arange(1, 4)[:, None],
            phase=random.uniform(0.0, 2.0 * np.pi, (3, n)),
            lag=level * random.uniform(0.0, 0.15, n),
            length=span * random.uniform(0.1, 0.3, n),
        )

    def torque(self, q: Array, qd: Array) -> Array:
        """Return (T, n) efforts at positions and velocities (T, n), N·m or N."""
        relative = (q - self.middle) / self.span
        smooth = self.pull * relative + self.bend * np.tanh((q - self.centre) / self.width)
        for k, (height, phase) in enumerate(zip(self.ripple, self.phase, strict=True), start=1):
            smooth = smooth + height * np.sin(k * np.pi * relative + phase)
        return smooth + lagging(q, self.lag * np.sign(qd), self.length)


@dataclass(frozen=True)
class Spring:
    """A spring between a fixed point and a lever on a joint.

    Attributes:
        joint: Index of the joint.
        torque: About the greatest it has, N·m.
        zero: Where lever and point are in line, rad.
        ratio: Of the lever to the point's distance.
    """

    joint: int
    torque: float
    zero: float
    ratio: float

    def at(self, q: Array) -> Array:
        """Return (T, n) efforts at positions (T, n)."""
        angle = q[:, self.joint] - self.zero
        length = np.sqrt(1.0 + self.ratio**2 - 2.0 * self.ratio * np.cos(angle))
        result = np.zeros_like(q)
        result[:, self.joint] = self.torque * np.sin(angle) / length
        return result


@dataclass(frozen=True, eq=False)
class LabSensors:
    """What an arm's electronics make of the truth; arrays are (n,), at the motors.

    Attributes:
        rate: Samples a second, Hz.
        position_step: Of the encoders, rad or m.
        cutoff: Of the filter on the difference of counts that is the velocity, Hz; ``None``: no
            velocity is recorded.
        effort_step: Of the current's measurement, N·m or N.
        effort_noise: White noise of it, standard deviation.
        hum: Standard deviation of its noise that goes on for ``hum_time``.
        hum_time: s.
        delay: How much older than the position the effort of a sample is, s.
        jitter: Standard deviation of the moment of reading about its stamp, s.
        repeated: Part of samples that only repeat the one before.
    """

    rate: float
    position_step: Array
    cutoff: float | None
    effort_step: Array
    effort_noise: Array
    hum: Array
    hum_time: float
    delay: float
    jitter: float
    repeated: float

    @classmethod
    def draw(cls, position_step: Array, effort_noise: Array, random: Random) -> LabSensors:
        """Draw sensors around (n,) encoder steps and noises of the effort."""
        n = len(position_step)
        noise = effort_noise * random.uniform(0.7, 1.4, n)
        coloured = random.uniform(0.2, 0.8, n)
        return cls(
            rate=float(random.choice([200.0, 200.0, 250.0, 500.0])),
            position_step=position_step,
            cutoff=(20.0, 40.0, 80.0, None)[int(random.integers(4))],
            effort_step=0.05 * effort_noise,
            effort_noise=noise * np.sqrt(1.0 - coloured**2),
            hum=noise * coloured,
            hum_time=float(random.uniform(0.004, 0.02)),
            delay=float(random.uniform(0.0, 0.004)),
            jitter=float(random.choice([0.0, 0.0002, 0.001])),
            repeated=float(random.choice([0.0, 0.0, 0.03])),
        )

    def read(self, truth: Truth, seed: int, source: str) -> Recording:
        """Return the recording from time 0 on; the truth begins before that, and ends after it.

        Args:
            truth: On an even grid.
            seed: Of the noise.
            source: What the recording says that it is.
        """
        random, arm = np.random.default_rng([seed, 3]), truth.arm
        step = float(truth.time[1] - truth.time[0])
        time = np.arange(0.0, truth.time[-1] - AFTER, 1.0 / self.rate)
        read = time + np.clip(self.jitter * random.standard_normal(len(time)), -0.4 / self.rate,
                              0.4 / self.rate)  # fmt: skip
        counted = _whole(arm.actuator_position(truth.q), self.position_step)
        position = arm.joint_position(_held(read, truth.time, counted))
        velocity = None
        if self.cutoff is not None:
            share = 1.0 - np.exp(-2.0 * np.pi * self.cutoff * step)
            change = np.diff(counted, axis=0, prepend=counted[:1]) / step
            change[0] = arm.actuator_position(truth.qd[0])
            velocity = arm.joint_position(_held(read, truth.time, _low_pass(change, share)))
        motor = arm.actuator_effort(_between(read - self.delay, truth.time, truth.effort))
        decay = np.exp(-1.0 / (self.rate * self.hum_time))
        white = np.sqrt(1.0 - decay**2) * random.standard_normal(motor.shape)
        motor = motor + self.hum * _low_pass(white, 1.0 - decay) / (1.0 - decay)
        motor += self.effort_noise * random.standard_normal(motor.shape)
        effort = arm.joint_effort(_whole(motor, self.effort_step))
        rows = np.arange(len(time))
        stale = random.random(len(time)) < self.repeated
        stale[0] = False
        rows = np.maximum.accumulate(np.where(stale, 0, rows))
        return Recording(
            arm.joint_names, time, position[rows], None if velocity is None else velocity[rows],
            effort[rows], source=source,
        )  # fmt: skip


def _whole(values: Array, step: Array) -> Array:
    result: Array = np.rint(values / step) * step
    return result


def _between(at: Array, time: Array, values: Array) -> Array:
    return np.stack([np.interp(at, time, column) for column in values.T], axis=1)


def _held(at: Array, time: Array, values: Array) -> Array:
    """Return the last of some values before each moment, as a register holds it."""
    rows = np.floor((at - time[0]) / (time[1] - time[0]) + 1e-6).astype(int)
    return values[rows]


def _low_pass(values: Array, share: float) -> Array:
    start = (1.0 - share) * values[:1]
    result, _ = lfilter([share], [1.0, share - 1.0], values, axis=0, zi=start)
    return np.asarray(result)
