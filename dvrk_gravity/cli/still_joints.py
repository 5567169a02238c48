"""The flag that says where joints stood that a recording does not hold."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from dvrk_gravity.errors import ConfigError

if TYPE_CHECKING:
    from dvrk_gravity.arms import Arm
    from dvrk_gravity.recording import RecordingFile

# By kind of joint; the longer names first, of which the shorter are endings.
_UNITS = {
    "revolute": {"deg": math.pi / 180.0, "rad": 1.0},
    "prismatic": {"mm": 1e-3, "m": 1.0},
}
_FARTHEST = {"revolute": (4.0 * math.pi, "two turns"), "prismatic": (10.0, "10 m")}


def add_at(parser: argparse.ArgumentParser) -> None:
    """Declare ``--at``."""
    parser.add_argument(
        "--at", metavar="JOINT=POSITION,...", action="append", default=[],
        help="where joints stood that a recording does not hold, joint coordinates: "
        "shoulder_pitch=2.5deg,others=0deg; or in mm or m where a joint slides",
    )  # fmt: skip


def require_unrecorded(texts: Sequence[str], recordings: Sequence[RecordingFile]) -> None:
    """Refuse to be told where a joint stood that every recording holds.

    Raises:
        ConfigError: Naming it.
        RecordingError: A recording that cannot be read.
    """
    for entry, name, _ in _entries(texts):
        if all(name in recording.head.joints for recording in recordings):
            raise ConfigError("--at", entry, f"no joint that is recorded, as {name} is")


def _entries(texts: Sequence[str]) -> Iterator[tuple[str, str, str]]:
    """Yield each entry, the joint that it names, and the position."""
    for entry in ",".join(texts).split(",") if texts else ():
        name, _, position = entry.strip().partition("=")
        yield entry, name, position


def _require_within_reach(entry: str, arm: Arm, name: str, position: float) -> None:
    """Refuse a position that is as far beyond the arm's limits as no zero is off."""
    from dvrk_gravity.intake import BEYOND

    index = arm.joint_names.index(name)
    joint, lower, upper = arm.joints[index], float(arm.lower[index]), float(arm.upper[index])
    beyond = BEYOND * float(arm.scale[index])
    if not lower - beyond <= position <= upper + beyond:
        limits = f"{joint.shown(lower)} to {joint.shown(upper)}, the limits of {arm.name}"
        raise ConfigError("--at", entry, f"a position of {name} at {limits}")


def still_joints(texts: Sequence[str], arm: Arm) -> dict[str, float]:
    """Return joint positions, rad or m, from ``JOINT=POSITION,...``; ``others``: all not named."""
    joints = {joint.name: joint for joint in arm.joints}
    named: dict[str, float] = {}
    for entry, name, position in _entries(texts):
        if name not in (*joints, "others"):
            raise ConfigError("--at", entry, f"JOINT=ANGLE of {', '.join(joints)} or others")
        if name in named:
            raise ConfigError("--at", entry, f"{name} once")
        kind = joints[name].kind if name in joints else "revolute"
        units, (farthest, words) = _UNITS[kind], _FARTHEST[kind]
        unit = next((unit for unit in units if position.endswith(unit)), "")
        try:
            value = float(position.removesuffix(unit))
        except ValueError:
            value = math.nan
        if not math.isfinite(value) or (not unit and value != 0.0):
            example = "an angle with its unit, like 2.5deg or 0.04rad"
            if kind == "prismatic":
                example = "a length with its unit, like 20mm or 0.02m"
            raise ConfigError("--at", entry, example)
        named[name] = value * units.get(unit, 0.0)
        if abs(named[name]) > farthest:
            what = "an angle" if kind == "revolute" else "a length"
            raise ConfigError("--at", entry, f"{what} within {words}")
        if name in joints:
            _require_within_reach(entry, arm, name, named[name])
    if "others" in named:
        rest = named.pop("others")
        if rest:
            sliding = [joint.name for joint in arm.joints if joint.kind == "prismatic"]
            for name in sliding:
                if name not in named:
                    raise ConfigError("--at", f"others={rest:g}rad", f"a position of {name}, too")
        named = dict.fromkeys(joints, rest) | named
    return named
