"""Plausibility of the numbers in an arm's file: size, position limits, velocity limits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

from dvrk_gravity.arms.description import FASTEST, SCALES, Description
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.parameters import is_finite

# rad, that a joint with stops turns to. Of 69 files of example-robot-data the largest is 10 rad, an
# MTM's wrist_roll reaches 8.4; of a joint that turns by more than 13 deg, degrees are beyond.
FARTHEST_TURN = 4.0 * math.pi
# m, that one slides to. Chosen: arms slide by less than 1 m, rails that carry a whole arm seldom
# reach farther; of a joint that slides by more than 10 mm, mm are beyond.
FARTHEST_SLIDE = 10.0
# By unit: the farthest, the unit that is mistaken for it, and how much that is.
_LIMITS = {
    "rad": (FARTHEST_TURN, "deg", math.radians(1.0)),
    "deg": (math.degrees(FARTHEST_TURN), "", 1.0),
    "m": (FARTHEST_SLIDE, "mm", 1e-3),
}


def check_travel(
    where: str, lower: float, upper: float, unit: Literal["rad", "deg", "m"], endless: str = ""
) -> None:
    """Check that position limits are some that a joint can have.

    Args:
        where: What the names ``lower`` and ``upper`` follow in the message.
        lower: Lower limit.
        upper: Upper limit.
        unit: What they should be in.
        endless: What to write instead of a joint without stops.

    Raises:
        ConfigError: One that no joint reaches, or no way between them.
    """
    farthest, mistaken, factor = _LIMITS[unit]
    for key, value in (("lower", lower), ("upper", upper)):
        if abs(value) > farthest:
            found = f" ({value:g} {mistaken} is {factor * value:.4g} {unit})" if mistaken else ""
            expected = f"{unit}, at most {farthest:.4g} as of any joint{found}{endless}"
            raise ConfigError(f"{where}{key}", value, expected)
    if lower >= upper:
        raise ConfigError(f"{where}lower", lower, f"less than upper ({upper:g}){endless}")


def require_drivable(arm: Description) -> None:
    """Check that an arm's limits are good for planning a motion.

    Raises:
        ConfigError: A joint that turns, and of which the file says neither where it stops nor that
            it does not; a velocity limit that no joint of an arm reaches.
    """
    for joint in arm.joints:
        if not joint.range_stated:
            expected = 'limit lower="…" upper="…" in rad, or type continuous if it has no stops'
            raise ConfigError(f"joint {joint.name}: limit", None, expected, arm.source)
        fastest = FASTEST * SCALES[joint.kind]
        if fastest < joint.velocity_limit < math.inf:
            expected = f"{joint.unit}/s, at most {fastest:g} as of any arm's joint (0: not known)"
            found = joint.velocity_limit
            raise ConfigError(f"joint {joint.name}: limit velocity", found, expected, arm.source)


# Chosen: no arm's length (m), mass (kg), effort (N·m, N), angle (deg) or ratio is as large, and the
# products of some of them that a fit makes are far from overflow.
LARGEST = 1e6
# Joints that move, of an arm. Chosen: a humanoid with its hands has eighty; matrices have as many
# rows and columns.
MOST_JOINTS = 200


def check_range(field: str, values: Sequence[float]) -> None:
    """Check that every number is at most :data:`LARGEST` in size.

    Raises:
        ConfigError: One is larger, or not finite.
    """
    for value in values:
        if not is_finite(value):
            raise ConfigError(field, value, "a finite number")
        if abs(value) > LARGEST:
            raise ConfigError(field, value, f"a number from -{LARGEST:g} to {LARGEST:g}")
