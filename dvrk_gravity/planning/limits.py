"""How far, how fast and how hard an arm may be driven by a program."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arms import Arm, mtm, require_drivable
from dvrk_gravity.arrays import Array


@dataclass(frozen=True)
class LimitSettings:
    """Limits of an arm of which nothing more is known; as much at a lever of 0.1 m where it slides.

    A velocity limit that the arm's file states binds where it is lower.

    Attributes:
        velocity: rad/s: what Universal Robots' controllers take for a motion of the joints that
            names none (MoveJ, 60 deg/s).
        acceleration: rad/s^2, likewise (80 deg/s^2).
        margin: Distance to the stops, rad. Chosen: 5 deg.
        most_margin: ... but no more than this part of the range. Chosen.
        used: Part of what is left, and at most a turn. Chosen.
    """

    velocity: float = float(np.radians(60.0))
    acceleration: float = float(np.radians(80.0))
    margin: float = float(np.radians(5.0))
    most_margin: float = 0.05
    used: float = 0.9


@dataclass(frozen=True)
class PairLimit:
    """Two joints whose sum has a range of its own, as a motor's that both of them turn.

    Attributes:
        first: Index of the joint that moves first.
        second: Index of the one whose range the sum narrows.
        lower: Lowest sum, rad.
        upper: Highest sum, rad.
    """

    first: int
    second: int
    lower: float
    upper: float


@dataclass(frozen=True, eq=False)
class MotionLimits:
    """Limits of a planned motion.

    Attributes:
        lower: (n,) lowest joint positions, rad or m.
        upper: (n,) highest joint positions, rad or m.
        velocity: (n,) of the joints, per s; that of a pair's second one holds for its sum, too.
        acceleration: (n,) likewise, per s^2.
        used: (n,) part of the range that a motion goes through.
        pair: Two joints whose sum is limited, too; ``None``: there are none.
    """

    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array
    used: Array
    pair: PairLimit | None = None

    @classmethod
    def of(cls, arm: Arm) -> MotionLimits:
        """Return the limits of an arm.

        Raises:
            ConfigError: Limits in its file that no joint has, or none where a joint stops.
        """
        require_drivable(arm)
        if mtm.is_mtm(arm):
            known = mtm.defaults
            lower, upper = arm.lower + known.MARGIN, arm.upper - known.MARGIN
            lower[2], upper[2] = max(lower[2], known.ELBOW[0]), min(upper[2], known.ELBOW[1])
            pair = PairLimit(1, 2, *known.ELBOW_MOTOR.tolist())
            used = np.array(known.EXCITED_RANGE)
            velocity = np.minimum(known.VELOCITY, arm.velocity_limit)
            return cls(lower, upper, velocity, known.ACCELERATION, used, pair)
        lower, upper = arm.range
        settings = LimitSettings()
        margin = np.minimum(settings.margin * arm.scale, settings.most_margin * (upper - lower))
        lower, upper = lower + margin, upper - margin
        used = settings.used * np.minimum(1.0, 2.0 * np.pi / (upper - lower))
        velocity = np.minimum(settings.velocity * arm.scale, arm.velocity_limit)
        acceleration = settings.acceleration * arm.scale
        return cls(lower, upper, velocity, acceleration, used)


def careful(arm: Arm) -> tuple[Array, Array]:
    """Return (n,) velocities and (n,) accelerations of a simulated arm's own motions."""
    if mtm.is_mtm(arm):
        known = mtm.defaults
        return np.array(known.SIMULATED_VELOCITY), np.array(known.SIMULATED_ACCELERATION)
    settings = LimitSettings()
    velocity = np.minimum(settings.velocity * arm.scale, arm.velocity_limit)
    return velocity, settings.acceleration * arm.scale
