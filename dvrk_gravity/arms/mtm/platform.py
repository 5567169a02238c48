"""What an MTM's platform weighs: it shows which side an arm is of, and efforts in another unit."""

from __future__ import annotations

from typing import Literal

# The platform's moment across the arm, N·m, on right arms, and about its opposite on left ones
# (sixteen console files of real arms; all but one, which carries the other side's sign).
PLATFORM = {"mtmr": 0.196, "mtml": -0.196}
PLATFORM_BETA = 5
"""Index of that moment in beta."""
_CLEAR = 0.5  # part of it from which on the other sign is no accident. Chosen
# Factor by which it is off where efforts are in another unit. Chosen as ``effort_unit.OFF``; of the
# sixteen files it is off by a twentieth.
_OFF = 4.0


def platform_fault(arm: str, value: float, low: float, high: float) -> Literal["", "unit", "side"]:
    """Return what a fitted moment of the platform shows: another unit, the other side's arm.

    Args:
        arm: Name of the arm.
        value: The moment, N·m.
        low: Lower end of its 95 % interval.
        high: Upper end.
    """
    expected = PLATFORM.get(arm)
    if expected is None:
        return ""
    size, one_sign = sorted(abs(end) / abs(expected) for end in (low, high)), low * high > 0.0
    if size[1] < 1.0 / _OFF or (one_sign and size[0] > _OFF):
        return "unit"
    if value * expected > 0.0 or abs(value) < _CLEAR * abs(expected) or low * high < 0.0:
        return ""
    return "side"
