"""What a planned motion keeps: limits of joints, of their combinations, and keep-out boxes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dvrk_gravity.arms import Arm, mtm, require_drivable
from dvrk_gravity.arrays import Array

_ROUNDING = 1e-9  # of factors that were written in decimals


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
        quickest: Least time in which a limit of acceleration may reach the greatest velocity, s:
            servos lag by 0.05 to 0.1 s, and follow nothing quicker. What a file has beyond that is
            a mistaken unit.
    """

    velocity: float = float(np.radians(60.0))
    acceleration: float = float(np.radians(80.0))
    margin: float = float(np.radians(5.0))
    most_margin: float = 0.05
    used: float = 0.9
    quickest: float = 0.1


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


@dataclass(frozen=True)
class Combination:
    """A sum of joints, each times a factor, that is limited like a joint: q2 + q3 of an MTM.

    Attributes:
        factors: By joint name, in the joints' order.
        lower: Lowest value; ``-inf``: none.
        upper: Highest; ``inf``: none.
        velocity: Greatest speed; ``inf``: none.
        acceleration: Greatest acceleration; ``inf``: none.
    """

    factors: tuple[tuple[str, float], ...]
    lower: float = -np.inf
    upper: float = np.inf
    velocity: float = np.inf
    acceleration: float = np.inf

    @property
    def name(self) -> str:
        """As a sum: ``shoulder_pitch + elbow_pitch``."""
        text = ""
        for joint, factor in self.factors:
            size = "" if abs(factor) == 1.0 else f"{abs(factor):g} "
            sign = "-" if factor < 0.0 else "+" if text else ""
            text += f" {sign} {size}{joint}" if text else f"{sign}{size}{joint}"
        return text

    def within(self, other: Combination) -> Combination | None:
        """Return the stricter limits of both; ``None`` if other is no multiple of this sum."""
        own, given = dict(self.factors), dict(other.factors)
        if own.keys() != given.keys():
            return None
        ratios = np.array([given[joint] / factor for joint, factor in own.items()])
        if not np.allclose(ratios, ratios[0], rtol=_ROUNDING, atol=0.0):
            return None
        ratio = float(ratios[0])
        low, high = sorted((other.lower / ratio, other.upper / ratio))
        return replace(
            self,
            lower=max(self.lower, low),
            upper=min(self.upper, high),
            velocity=min(self.velocity, other.velocity / abs(ratio)),
            acceleration=min(self.acceleration, other.acceleration / abs(ratio)),
        )


@dataclass(frozen=True)
class Box:
    """A box, its sides along the base frame's axes, which the origins of links stay out of.

    Attributes:
        name: Its name.
        lower: Corner with the least coordinates in the base frame, m.
        upper: The opposite one.
        links: Names of the links that stay out.
    """

    name: str
    lower: tuple[float, float, float]
    upper: tuple[float, float, float]
    links: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class PlanLimits:
    """Limits of a planned motion, of the n joints and then of the combinations.

    Attributes:
        joints: Their names.
        lower: (n,) lowest positions, rad or m.
        upper: (n,) highest ones.
        velocity: (n,) greatest speeds.
        acceleration: (n,) greatest accelerations.
        effort: (n,) greatest *actuator* efforts, N·m or N.
        used: (n,) part of the range that an exciting motion goes through.
        combinations: Of joints.
        boxes: To stay out of.
    """

    joints: tuple[str, ...]
    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array
    effort: Array
    used: Array
    combinations: tuple[Combination, ...] = ()
    boxes: tuple[Box, ...] = ()

    @classmethod
    def of(cls, arm: Arm) -> PlanLimits:
        """Return the limits of an arm of which no file says more.

        Raises:
            ConfigError: Limits in its file that no joint has, or none where a joint stops.
        """
        require_drivable(arm)
        return _limits_of_mtm(arm) if mtm.is_mtm(arm) else _limits_by_settings(arm)

    @property
    def pair(self) -> PairLimit | None:
        """The first two joints whose sum has a range; ``None``: there are none."""
        for each in self.combinations:
            plain = [factor for _, factor in each.factors] == [1.0, 1.0]
            if plain and np.isfinite([each.lower, each.upper]).all():
                first, second = (self.joints.index(name) for name, _ in each.factors)
                return PairLimit(first, second, each.lower, each.upper)
        return None

    def and_those(self, others: PlanLimits) -> PlanLimits:
        """Return the stricter of these limits and others, of each joint; all sums and boxes."""
        return replace(
            self,
            lower=np.maximum(self.lower, others.lower),
            upper=np.minimum(self.upper, others.upper),
            velocity=np.minimum(self.velocity, others.velocity),
            acceleration=np.minimum(self.acceleration, others.acceleration),
            effort=np.minimum(self.effort, others.effort),
            combinations=stricter_limits((*self.combinations, *others.combinations)),
            boxes=tuple(dict.fromkeys((*self.boxes, *others.boxes))),
        )

    def turns(self, arm: Arm, position: Array) -> Array:
        """Return (n,) whole turns, rad, by which endless joints are away from their limits.

        A joint within its limits is by none, also where they are wider than a turn.
        """
        endless = ~np.isfinite(arm.upper - arm.lower)
        outside = (position < self.lower) | (position > self.upper)
        away = np.round((position - 0.5 * (self.lower + self.upper)) / (2.0 * np.pi))
        return np.where(endless & outside, 2.0 * np.pi * away, 0.0)

    @property
    def names(self) -> tuple[str, ...]:
        """(r,) names of joints and combinations."""
        return (*self.joints, *(each.name for each in self.combinations))

    @cached_property
    def rows(self) -> Array:
        """(r, n) factors of the joints: of each joint, then of each combination."""
        found = [dict(each.factors) for each in self.combinations]
        return np.vstack(
            [np.eye(len(self.joints))]
            + [[[factors.get(joint, 0.0) for joint in self.joints]] for factors in found]
        )

    @cached_property
    def range(self) -> tuple[Array, Array]:
        """(r,) lowest and (r,) highest positions of joints and combinations."""
        return (
            np.array([*self.lower, *(each.lower for each in self.combinations)]),
            np.array([*self.upper, *(each.upper for each in self.combinations)]),
        )

    @cached_property
    def rates(self) -> tuple[Array, Array]:
        """(r,) greatest speeds and (r,) accelerations of joints and combinations."""
        return (
            np.array([*self.velocity, *(each.velocity for each in self.combinations)]),
            np.array([*self.acceleration, *(each.acceleration for each in self.combinations)]),
        )


def _limits_by_settings(arm: Arm) -> PlanLimits:
    settings, (lower, upper) = LimitSettings(), arm.range
    margin = np.minimum(settings.margin * arm.scale, settings.most_margin * (upper - lower))
    lower, upper = lower + margin, upper - margin
    used = settings.used * np.minimum(1.0, 2.0 * np.pi / (upper - lower))
    velocity = np.minimum(settings.velocity * arm.scale, arm.velocity_limit)
    return PlanLimits(
        arm.joint_names, lower, upper, velocity, settings.acceleration * arm.scale,
        arm.actuator_effort_limit, used,
    )  # fmt: skip


def _limits_of_mtm(arm: Arm) -> PlanLimits:
    """Return the published limits of a master arm, of its elbow's motor, too."""
    known, (lower, upper) = mtm.defaults, arm.range
    lower, upper = lower + known.MARGIN, upper - known.MARGIN
    lower[2], upper[2] = max(lower[2], known.ELBOW[0]), min(upper[2], known.ELBOW[1])
    velocity, acceleration = np.minimum(known.VELOCITY, arm.velocity_limit), known.ACCELERATION
    low, high = known.ELBOW_MOTOR.tolist()
    motor = Combination(
        tuple((name, 1.0) for name in arm.joint_names[1:3]), low, high, float(velocity[2]),
        float(acceleration[2]),
    )  # fmt: skip
    return PlanLimits(
        arm.joint_names, lower, upper, velocity, acceleration, arm.actuator_effort_limit,
        np.array(known.EXCITED_RANGE), (motor,),
    )  # fmt: skip


def stricter_limits(combinations: Iterable[Combination]) -> tuple[Combination, ...]:
    """Return combinations, those that are multiples of one sum as one with the stricter limits."""
    found: list[Combination] = []
    for each in combinations:
        for k, known in enumerate(found):
            if both := known.within(each):
                found[k] = both
                break
        else:
            found.append(each)
    return tuple(found)


def careful_limits(arm: Arm) -> tuple[Array, Array]:
    """Return (n,) velocities and (n,) accelerations of a simulated arm's own motions."""
    if mtm.is_mtm(arm):
        known = mtm.defaults
        return np.array(known.SIMULATED_VELOCITY), np.array(known.SIMULATED_ACCELERATION)
    settings = LimitSettings()
    velocity = np.minimum(settings.velocity * arm.scale, arm.velocity_limit)
    return velocity, settings.acceleration * arm.scale
