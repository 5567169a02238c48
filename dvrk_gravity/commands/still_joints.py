"""The flag that says where joints stood that a recording does not hold."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence

from dvrk_gravity.arm import JOINT_NAMES
from dvrk_gravity.errors import ConfigError

_UNITS = {"deg": math.pi / 180.0, "rad": 1.0}


def add_at(parser: argparse.ArgumentParser) -> None:
    """Declare ``--at``."""
    parser.add_argument(
        "--at", metavar="JOINT=ANGLE,...", action="append", default=[],
        help="where joints stood that a recording does not hold, joint coordinates: "
        "shoulder_pitch=2.5deg,others=0deg",
    )  # fmt: skip


def still_joints(texts: Sequence[str]) -> dict[str, float]:
    """Return joint positions, rad, from ``JOINT=ANGLE,...``; ``others`` is for those not named."""
    named: dict[str, float] = {}
    for entry in ",".join(texts).split(",") if texts else ():
        joint, _, angle = entry.strip().partition("=")
        if joint not in (*JOINT_NAMES, "others"):
            raise ConfigError("--at", entry, f"JOINT=ANGLE of {', '.join(JOINT_NAMES)} or others")
        if joint in named:
            raise ConfigError("--at", entry, f"{joint} once")
        unit = next((unit for unit in _UNITS if angle.endswith(unit)), "")
        try:
            value = float(angle.removesuffix(unit))
        except ValueError:
            value = math.nan
        if not math.isfinite(value) or (not unit and value != 0.0):
            raise ConfigError("--at", entry, "an angle with its unit, like 2.5deg or 0.04rad")
        named[joint] = value * _UNITS.get(unit, 0.0)
        if abs(named[joint]) > 4.0 * math.pi:
            raise ConfigError("--at", entry, "an angle within two turns")
    if "others" in named:
        rest = named.pop("others")
        named = dict.fromkeys(JOINT_NAMES, rest) | named
    return named
