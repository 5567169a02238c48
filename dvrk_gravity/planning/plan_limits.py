"""What a planned motion keeps: limits of joints, of their combinations, and keep-out boxes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.planning.limits import MotionLimits


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
        combinations: Of joints.
        boxes: To stay out of.
    """

    joints: tuple[str, ...]
    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array
    effort: Array
    combinations: tuple[Combination, ...] = ()
    boxes: tuple[Box, ...] = ()

    @classmethod
    def of(cls, arm: Arm) -> PlanLimits:
        """Return the limits that ``excite`` keeps, and the actuators' efforts.

        Raises:
            ConfigError: As :meth:`MotionLimits.of`.
        """
        known = MotionLimits.of(arm)
        combinations: tuple[Combination, ...] = ()
        if known.pair is not None:
            first, second = known.pair.first, known.pair.second
            both = tuple((arm.joint_names[k], 1.0) for k in (first, second))
            velocity, acceleration = (
                float(limit[second]) for limit in (known.velocity, known.acceleration)
            )
            pair = Combination(both, known.pair.lower, known.pair.upper, velocity, acceleration)
            combinations = (pair,)
        return cls(
            arm.joint_names, known.lower, known.upper, known.velocity, known.acceleration,
            arm.actuator_effort_limit, combinations,
        )  # fmt: skip

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
