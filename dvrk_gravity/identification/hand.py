"""Is a recording that of the other hand's arm, in N·m? Joint limits and a weight tell."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.gravity import BETA_NAMES
from dvrk_gravity.identification.kinematic_calibration import KinematicSettings
from dvrk_gravity.identification.result import FittedParameter
from dvrk_gravity.recording import DataWarning, Kind

OTHER = {"mtml": "mtmr", "mtmr": "mtml"}
# The platform's moment across the arm, N·m: about so on right arms, and less that on left ones
# (sixteen console files of real arms; all but one, which carries the other hand's sign).
PLATFORM = {"mtmr": 0.196, "mtml": -0.196}
PLATFORM_NAME = "pitch_y"


_OTHER_HAND: Kind = "other_hand"


def contradiction(warnings: Iterable[DataWarning]) -> str:
    """Return why recordings are of another arm than they are said to be of; ``""`` if they may be.

    No figure of such a recording says anything of this arm: whoever answers says this first.
    """
    return next((str(warning) for warning in warnings if warning.kind == _OTHER_HAND), "")


@dataclass(frozen=True)
class HandSettings:
    """When a recording counts as that of another arm.

    Attributes:
        beyond: Way past a joint's limit that no error of its zero explains, rad (35 mm where it
            slides). Chosen: 20 deg; zeros of encoders are off by less.
        clear: Part of ``PLATFORM`` from which on the other sign is no accident. Chosen.
        off: Factor by which that moment is off where efforts are in another unit. Chosen as in
            ``effort_unit.UnitSettings``; of the sixteen files it is off by a twentieth.
    """

    beyond: float = 0.35
    clear: float = 0.5
    off: float = 4.0


def beyond_limits(q: Array, arm: Arm) -> list[DataWarning]:
    """Return warnings about joints that go where the arm cannot.

    Args:
        q: (N, n) joint positions, rad or m.
        arm: The arm that they are said to be of.
    """
    beyond = _beyond(q, arm)
    hand = _by_limits(q, arm, beyond)
    if hand is not None:
        return [hand]
    return [
        DataWarning(
            "arm_limits",
            joint.name,
            {f"beyond_{joint.unit}": float(far)},
            f"goes {joint.shown(far)} beyond the limits of {arm.name}: a recording of "
            "another arm, or in other coordinates?",
        )
        for joint, far, scale in zip(arm.joints, beyond.tolist(), arm.scale, strict=True)
        if far > HandSettings().beyond * scale
    ]


def _beyond(q: Array, arm: Arm) -> Array:
    """Return (n,) how far (N, n) positions go beyond an arm's limits; negative: within."""
    return np.maximum(arm.lower - q.min(axis=0), q.max(axis=0) - arm.upper)


def _by_limits(q: Array, arm: Arm, beyond: Array) -> DataWarning | None:
    """Return a warning if the other hand's limits hold these positions, and this arm's do not.

    A zero that is off as far as is plausible (:class:`KinematicSettings`) proves nothing.
    """
    misplaced = KinematicSettings().misplaced
    if arm.name not in OTHER or beyond.max() < misplaced:
        return None
    other = _beyond(q, Arm.load(OTHER[arm.name]))
    joint = int(np.argmax(beyond - other))
    if beyond[joint] < misplaced or max(other.max(), 0.0) > beyond.max() - misplaced:
        return None
    name = arm.joint_names[joint]
    low, high = np.degrees([q[:, joint].min(), q[:, joint].max()])
    return DataWarning(
        _OTHER_HAND,
        None,
        {"beyond_rad": float(beyond[joint]), "beyond_other_rad": float(other[joint])},
        f"looks like a recording of {OTHER[arm.name]}, not {arm.name}: {name} goes from {low:.0f} "
        f"to {high:.0f} deg, {np.degrees(beyond[joint]):.0f} deg beyond the limits of {arm.name}",
    )


def by_weight(parameters: tuple[FittedParameter, ...], arm: Arm) -> list[DataWarning]:
    """Return a warning if the platform's moment surely has another size or the other sign."""
    expected = PLATFORM.get(arm.name)
    found = [
        parameter
        for parameter in parameters
        if parameter.name.startswith("beta") and PLATFORM_NAME in parameter.name
    ]
    if expected is None or not found:
        return []
    value, (low, high) = found[0].value, found[0].ci95
    name = f"beta{1 + BETA_NAMES.index(PLATFORM_NAME)}"
    least = HandSettings().clear * abs(expected)
    size, off = np.abs([low, high]) / abs(expected), HandSettings().off
    if size.max() < 1.0 / off or (low * high > 0.0 and size.min() > off):
        return [
            DataWarning(
                "effort_unit",
                None,
                {"beta6_Nm": value},
                f"{name} is {value:+.2g} N·m, about {expected:+.2g} on any {arm.name}: efforts in "
                "another unit than N·m?",
            )
        ]
    if value * expected > 0.0 or abs(value) < least or low * high < 0.0:
        return []
    return [
        DataWarning(
            _OTHER_HAND,
            None,
            {"beta6_Nm": value},
            f"looks like a recording of {OTHER[arm.name]}, not {arm.name}: {name} is "
            f"{value:+.2f} N·m, about {expected:+.2f} on {arm.name}",
        )
    ]
