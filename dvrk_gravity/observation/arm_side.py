"""The arm's side: does a recording reach where only the other side's arm, or no such arm, can?"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import MISPLACED
from dvrk_gravity.recording import Kind, Note

OTHER_SIDE = {"mtml": "mtmr", "mtmr": "mtml"}
OTHER_ARM: Kind = "other_hand"  # kind of the warnings
# Distance past a joint's limit that no encoder offset explains, rad (35 mm where it slides).
# Chosen: 20 deg; encoder zeros are off by less.
BEYOND = 0.35


def contradiction(warnings: Iterable[Note]) -> str:
    """Return why recordings belong to the other side's arm; ``""`` if nothing says so.

    No figure of such a recording describes this arm, so every verb reports this first.
    """
    return next((str(warning) for warning in warnings if warning.kind == OTHER_ARM), "")


def beyond_limits(q: Array, arm: Arm) -> list[Note]:
    """Return warnings about (N, n) joint positions, rad or m, that the arm cannot reach."""
    beyond = _beyond(q, arm)
    if other := _other_side(q, arm, beyond):
        return [other]
    return [
        Note(
            "arm_limits",
            joint.name,
            {f"beyond_{joint.unit}": float(far)},
            f"goes {joint.shown(far)} beyond the limits of {arm.name}: a recording of "
            "another arm (--arm, --model), or in other coordinates (--coordinates)?",
        )
        for joint, far, scale in zip(arm.joints, beyond.tolist(), arm.scale, strict=True)
        if far > BEYOND * scale
    ]


def _beyond(q: Array, arm: Arm) -> Array:
    """Return (n,) distances past the arm's limits; negative within them."""
    return np.maximum(arm.lower - q.min(axis=0), q.max(axis=0) - arm.upper)


def _other_side(q: Array, arm: Arm, beyond: Array) -> Note | None:
    """Return a warning if positions fit the other side's limits, and not this arm's.

    Encoder offsets of a plausible size (``MISPLACED``) prove nothing.
    """
    if arm.name not in OTHER_SIDE or beyond.max() < MISPLACED:
        return None
    other = _beyond(q, Arm.load(OTHER_SIDE[arm.name]))
    joint = int(np.argmax(beyond - other))
    if beyond[joint] < MISPLACED or max(other.max(), 0.0) > beyond.max() - MISPLACED:
        return None
    low, high = np.degrees([q[:, joint].min(), q[:, joint].max()])
    return Note(
        OTHER_ARM,
        None,
        {"beyond_rad": float(beyond[joint]), "beyond_other_rad": float(other[joint])},
        f"looks like a recording of {OTHER_SIDE[arm.name]}, not {arm.name}: "
        f"{arm.joint_names[joint]} goes from {low:.0f} to {high:.0f} deg, "
        f"{np.degrees(beyond[joint]):.0f} deg beyond the limits of {arm.name} (if so: --arm "
        f"{OTHER_SIDE[arm.name]}, or a --model of {OTHER_SIDE[arm.name]})",
    )
