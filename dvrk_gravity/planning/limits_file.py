"""limits.yaml: what a lab allows its arm, strictly read. Angles in degrees, lengths in m.

    joints:                       # any of them, and any of these; the arm's defaults otherwise
      elbow_pitch: {position: [-30, 30], velocity: 60, acceleration: 60, effort: 1.2}
    combinations:                 # beside those that the arm has (an MTM's shoulder and elbow)
      - {of: {shoulder_pitch: 1, elbow_pitch: 1}, position: [-9, 39], velocity: 60}
    boxes:                        # in the base frame; the links' origins stay out
      - {name: panel, lower: [-1, 0.3, -1], upper: [1, 1, 1], links: [link3, link7]}

An ``effort`` is that of the motor with the joint's number, in N·m or N. A combination has the unit
of its first joint; where the arm limits the same sum, the stricter limits hold. A box without
``links`` keeps the last link out.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dvrk_gravity.arms import FASTEST, Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import text_file, yaml_file
from dvrk_gravity.files.entries import check_count, mapping, sequence
from dvrk_gravity.planning.limits import (
    Box,
    Combination,
    LimitSettings,
    PlanLimits,
    stricter_limits,
)
from dvrk_gravity.planning.places import tip

_RATES = ("velocity", "acceleration")
KEYS = ("joints", "combinations", "boxes")
# Of what is divided by: no arm is as slow, stands as short, or is as weak. Chosen.
LEAST = 1e-6
# Of positions and coordinates; what a solver takes for infinite begins at 1e20. Chosen.
MOST = 1e9
# Each combination is compared with the others, each box with every position. Chosen
_MOST = {"combinations": 50, "boxes": 500}
# Times the arm's default speed and acceleration, beyond which a limit is taken for a slip. Chosen:
# 900 deg/s for 90 is ten times, rad/s for deg/s fifty-seven.
MOST_TIMES_DEFAULT = 2.0
_ROUNDING = 1e-9  # of numbers that were written in degrees


def load_limits(path: str | Path, arm: Arm, beyond_defaults: bool = False) -> PlanLimits:
    """Return an arm's limits with those of a file.

    Args:
        path: The file.
        arm: The arm.
        beyond_defaults: Take more than twice the arm's default speeds and accelerations, too.

    Raises:
        ConfigError: Naming the file, the entry, the value and what was expected: an unknown key,
            joint or link, no numbers, or more than the arm's own stops, speeds and efforts, or
            than twice its defaults.
    """
    try:
        return limits_from(yaml_file.load(path), arm, beyond_defaults)
    except ConfigError as error:
        raise error if error.source else error.in_file(path) from None


def limits_from(content: Mapping[str, Any], arm: Arm, beyond_defaults: bool = False) -> PlanLimits:
    """Return an arm's limits with those of the content of such a file; see :func:`load_limits`."""
    limits = PlanLimits.of(arm)
    mapping("", content, KEYS)
    values = {name: getattr(limits, name).copy() for name in ("lower", "upper", *_RATES, "effort")}
    for name, entry in mapping("joints", content.get("joints", {})).items():
        where = f"joints.{name}"
        if name not in arm.joint_names:
            raise ConfigError("joints", name, f"one of {', '.join(arm.joint_names)}")
        mapping(where, entry, ("position", *_RATES, "effort"))
        k = arm.joint_names.index(name)
        _put(values, k, where, entry, arm)
        if not beyond_defaults:
            _require_usual(limits, values, k, where, entry, arm)
    combinations = limits.combinations
    for name, most in _MOST.items():
        check_count(name, len(sequence(name, content.get(name, []))), most)
    for k, entry in enumerate(sequence("combinations", content.get("combinations", []))):
        given = _combination(f"combinations[{k}]", entry, arm)
        for known in combinations:
            both = known.within(given)
            if both and both.lower >= both.upper:
                shown = arm.joints[arm.joint_names.index(known.factors[0][0])].shown
                raise ConfigError(
                    f"combinations[{k}].position", entry["position"],
                    f"some of {shown(known.lower).split()[0]} to {shown(known.upper)} of "
                    f"{known.name}, the limits of the arm or of an entry before",
                )  # fmt: skip
        combinations = stricter_limits((*combinations, given))
    boxes = tuple(
        _box(f"boxes[{k}]", entry, k, arm)
        for k, entry in enumerate(sequence("boxes", content.get("boxes", [])))
    )
    return replace(limits, **values, combinations=combinations, boxes=boxes)


def limits_content(limits: PlanLimits, arm: Arm) -> dict[str, Any]:
    """Return the content of a file from which :func:`limits_from` makes the limits again."""
    joints = {}
    for k, joint in enumerate(arm.joints):
        size = _size(arm, k)
        joints[joint.name] = {
            "position": [float(limits.lower[k] / size), float(limits.upper[k] / size)],
            "velocity": float(limits.velocity[k] / size),
            "acceleration": float(limits.acceleration[k] / size),
            "effort": float(limits.effort[k]),
        }
    combinations = [_combination_entry(each, arm) for each in limits.combinations]
    boxes = [
        {"name": box.name, "lower": list(box.lower), "upper": list(box.upper),
         "links": list(box.links)}
        for box in limits.boxes
    ]  # fmt: skip
    return dict(zip(KEYS, (joints, combinations, boxes), strict=True))


def save_limits(path: str | Path, limits: PlanLimits, arm: Arm, comment: str) -> None:
    """Write limits to a file that :func:`load_limits` reads, whole or not at all.

    Raises:
        OSError: The file cannot be written.
    """
    text_file.write(path, f"# {comment}\n{yaml_file.dump(limits_content(limits, arm))}")


def _combination_entry(combination: Combination, arm: Arm) -> dict[str, Any]:
    size = _size(arm, arm.joint_names.index(combination.factors[0][0]))
    entry: dict[str, Any] = {"of": dict(combination.factors)}
    ends = (combination.lower, combination.upper)
    if any(map(math.isfinite, ends)):
        entry["position"] = [end / size for end in ends]
    for name in _RATES:
        value = getattr(combination, name)
        if math.isfinite(value):
            entry[name] = value / size
    return entry


def _put(values: dict[str, Array], k: int, where: str, entry: Mapping[str, Any], arm: Arm) -> None:
    """Put a joint's entry in its place."""
    joint, size = arm.joints[k], _size(arm, k)
    slack, known = 1.0 + _ROUNDING, values["velocity"][k]
    if "position" in entry:
        low, high = _pair(f"{where}.position", entry["position"])
        if low * size < arm.lower[k] - _ROUNDING or high * size > arm.upper[k] + _ROUNDING:
            stops = f"{joint.shown(arm.lower[k])} to {joint.shown(arm.upper[k])}"
            raise ConfigError(f"{where}.position", [low, high], f"within the arm's stops, {stops}")
        values["lower"][k], values["upper"][k] = low * size, high * size
    for name in _RATES:
        if name in entry:
            values[name][k] = _positive(f"{where}.{name}", entry[name]) * size
    most = float(min(arm.velocity_limit[k], FASTEST * arm.scale[k]))
    if values["velocity"][k] > most * slack:
        raise ConfigError(
            f"{where}.velocity", entry.get("velocity"), f"at most the arm's, {joint.shown(most)}/s"
        )
    most = max(known, values["velocity"][k]) / LimitSettings().quickest
    if values["acceleration"][k] > most * slack:
        raise ConfigError(
            f"{where}.acceleration", entry.get("acceleration"),
            f"at most {joint.shown(most)}/s^2, which a servo can follow",
        )  # fmt: skip
    if "effort" in entry:
        effort, most = _positive(f"{where}.effort", entry["effort"]), arm.actuator_effort_limit[k]
        if effort > most * slack:
            expected = f"at most the motor's, {most:g} {joint.effort_unit}"
            raise ConfigError(f"{where}.effort", effort, expected)
        values["effort"][k] = effort


def _require_usual(
    defaults: PlanLimits, values: Mapping[str, Array], k: int, where: str,
    entry: Mapping[str, Any], arm: Arm,
) -> None:  # fmt: skip
    """Refuse a speed or an acceleration of a joint far beyond the arm's defaults."""
    joint = arm.joints[k]
    for name, unit in zip(_RATES, ("/s", "/s^2"), strict=True):
        usual = float(getattr(defaults, name)[k])
        if values[name][k] > MOST_TIMES_DEFAULT * usual * (1.0 + _ROUNDING):
            most, known = (
                f"{joint.shown(each)}{unit}" for each in (MOST_TIMES_DEFAULT * usual, usual)
            )
            raise ConfigError(
                f"{where}.{name}", entry.get(name),
                f"at most {most}, twice the arm's default of {known}; or --beyond-defaults, if it "
                "is meant",
            )  # fmt: skip


def _combination(where: str, entry: Any, arm: Arm) -> Combination:
    mapping(where, entry, ("of", "position", *_RATES))
    of = mapping(f"{where}.of", entry.get("of"))
    for name, factor in of.items():
        if name not in arm.joint_names:
            raise ConfigError(f"{where}.of", name, f"joints of {', '.join(arm.joint_names)}")
        if not LEAST <= abs(_number(f"{where}.of.{name}", factor)) <= 1.0 / LEAST:
            expected = f"a factor that is not zero, of {LEAST:g} to {1.0 / LEAST:g}"
            raise ConfigError(f"{where}.of.{name}", factor, expected)
    if len(of) < 2:
        raise ConfigError(f"{where}.of", dict(of), "at least two joints; one alone is in `joints`")
    if len(entry) < 2:
        raise ConfigError(where, dict(entry), "position, velocity or acceleration beside `of`")
    order = [name for name in arm.joint_names if name in of]
    size = _size(arm, arm.joint_names.index(order[0]))
    low, high = -np.inf, np.inf
    if "position" in entry:
        low, high = _pair(f"{where}.position", entry["position"])
    rates = {
        name: _positive(f"{where}.{name}", entry[name]) * size for name in _RATES if name in entry
    }
    factors = tuple((name, float(of[name])) for name in order)
    return Combination(factors, low * size, high * size, **rates)


def _box(where: str, entry: Any, number: int, arm: Arm) -> Box:
    mapping(where, entry, ("name", "lower", "upper", "links"))
    lower, upper = (_corner(f"{where}.{side}", entry.get(side)) for side in ("lower", "upper"))
    for axis, (low, high) in zip("xyz", zip(lower, upper, strict=True), strict=True):
        if not low < high:
            raise ConfigError(where, [low, high], f"lower below upper along {axis}")
    links = sequence(f"{where}.links", entry.get("links", [tip(arm)]))
    for link in links:
        if link not in arm.body_names:
            raise ConfigError(f"{where}.links", link, f"some of {', '.join(arm.body_names)}")
    if not links or len(set(links)) < len(links):
        raise ConfigError(f"{where}.links", links, "at least one link, each once")
    name = entry.get("name", f"box {number + 1}")
    if not isinstance(name, str) or not name:
        raise ConfigError(f"{where}.name", name, "a text")
    return Box(name, lower, upper, tuple(links))


def _corner(where: str, value: Any) -> tuple[float, float, float]:
    if not isinstance(value, list) or len(value) != 3:
        raise ConfigError(where, value, "three coordinates, m")
    x, y, z = (_number(where, each, MOST) for each in value)
    return x, y, z


def _pair(where: str, value: Any) -> tuple[float, float]:
    if not isinstance(value, list) or len(value) != 2:
        raise ConfigError(where, value, "two numbers, the lower one first")
    low, high = (_number(where, each, MOST) for each in value)
    if not low < high:
        raise ConfigError(where, value, "the lower one first")
    return low, high


def _positive(where: str, value: Any) -> float:
    number = _number(where, value)
    if number < LEAST:
        raise ConfigError(where, value, f"a number above 0, at least {LEAST:g}")
    return number


def _number(where: str, value: Any, most: float = sys.float_info.max) -> float:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not number or not abs(value) <= sys.float_info.max:  # an integer may be longer
        raise ConfigError(where, value, "a finite number")
    if abs(value) / (1.0 + _ROUNDING) > most:
        raise ConfigError(where, value, f"numbers up to {most:g}")
    return float(value)


def _size(arm: Arm, k: int) -> float:
    """Return what a number of a joint's in the file is in rad or m."""
    return math.radians(1.0) if arm.joints[k].kind == "revolute" else 1.0
