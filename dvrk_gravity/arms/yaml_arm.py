"""Reading an arm from YAML: a serial chain by its DH table, and links that follow it.

A file with all there may be::

    name: made_up
    convention: standard          # or modified (proximal); standard if left out
    joints:                       # angles in degrees, lengths in m, efforts in N·m or N
      - {name: yaw, alpha: 90, a: 0, d: 0.1, offset: 0, lower: -90, upper: 90, effort_limit: 20}
      - {name: slide, type: prismatic, alpha: 0, a: 0, d: 0.2, offset: 90, lower: 0, upper: 0.3,
         effort_limit: 50}
      - {name: grip, alpha: 90, a: 0, d: 0, offset: 0, lower: 0, upper: 60, effort_limit: 1,
         follows: {yaw: -0.5}}    # its link turns by grip - yaw / 2; by grip alone if left out
    followers:                    # links whose coordinate is a combination of joints'
      - {name: weight, parent: link1, xyz: [0, 0, 0], rpy: [0, 0, 0], type: prismatic,
         follows: {slide: -0.5}}
    actuator_to_joint: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]    # q = M a; the identity if left out
    actuator_effort_limit: [20, 50, 1]        # the joints', if there is no matrix
    base_rpy: [0, 0, 0]                       # roll, pitch, yaw of the base in the world, degrees
    sizes: {link1: [2, 0.2]}                  # kg, m: about how heavy and large links are

The links are ``link1`` to ``linkn``; a follower's axis is the z axis of the frame that ``xyz`` and
``rpy`` (degrees) place on its parent's link frame. An MTM's file has ``parallelogram`` instead of
followers. Identification starts from ``sizes``: what data leave open stays in proportion to them.
A joint may have a ``velocity_limit``, deg/s or m/s, and a ``published_error``, that of careful fits
on motions that they had not seen, as a part of its torque, by which identification judges its own
(an MTM's are known).

An arm may also be a URDF and what that does not say; paths are relative to the file's folder::

    urdf: robot.urdf
    tip: tool0                    # the end of the chain that is the arm; all that moves if left out
    actuator_to_joint, actuator_effort_limit, base_rpy as above

Either may say how its efforts are read, and where it has no friction::

    drive_gains: [14.9, 13.3]     # N·m (or N) of each A, a joint: efforts are motor currents
    drive_gain_error: [0.05, 0.05]  # their relative standard errors, if they are known
    effort_unit: A                # efforts are in another unit than N·m, and what that is in N·m is
                                  # not known
    frictionless: [slide]         # joints without friction of their own
    effort_has_gravity: {read: true, command: false}    # whether efforts that are read hold the
                                  # arm's weight, and those that are sent are to; true if left out
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pinocchio as pin

from dvrk_gravity.arms import urdf_arm
from dvrk_gravity.arms.description import Description, Joint, JointKind, in_newtons
from dvrk_gravity.arms.dh import CONVENTIONS, Convention, DHRow, Follower, chain, link_frames
from dvrk_gravity.arms.limits import LARGEST, MOST_JOINTS, check_travel
from dvrk_gravity.arms.mtm import bodies
from dvrk_gravity.arms.mtm.defaults import PUBLISHED_ERROR, SIZES
from dvrk_gravity.arrays import Array
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import entries, yaml_file

_number = partial(entries.number, least=-LARGEST, most=LARGEST)
_numbers = partial(entries.numbers, least=-LARGEST, most=LARGEST)
_REQUIRED = ("name", "joints")
_READINGS = (
    "drive_gains", "drive_gain_error", "effort_unit", "frictionless", "effort_has_gravity",
)  # fmt: skip
_DRIVES = ("actuator_to_joint", "actuator_effort_limit", "base_rpy", *_READINGS)
_OPTIONAL = ("convention", "followers", "parallelogram", "sizes", *_DRIVES)
_OF_URDF = ("urdf", "name", "tip", *_DRIVES)
_JOINT = ("alpha", "a", "d", "offset", "lower", "upper", "effort_limit")
_POSITIVE = ("velocity_limit", "published_error")  # of a joint, where they are known
_KINDS: tuple[JointKind, ...] = ("revolute", "prismatic")


def read(path: Path, source: str) -> Description:
    """Return the arm in a YAML file.

    Args:
        path: The file.
        source: The argument of :meth:`Arm.load`.

    Raises:
        ConfigError: Naming the file and the field.
    """
    content = yaml_file.load(path)
    if "/**" in content:
        raise ConfigError("arm", "a model's parameters", "an arm's file", path)
    try:
        return _on_urdf(content, path, source) if "urdf" in content else _parse(content, source)
    except ConfigError as error:
        raise error if error.source else error.in_file(path) from None


def _parse(content: dict[str, Any], source: str) -> Description:
    _check_keys(content, (*_REQUIRED, *_OPTIONAL))
    for key in _REQUIRED:
        if key not in content:
            raise ConfigError(key, None, "a value")
    if not isinstance(content["name"], str):
        raise ConfigError("name", content["name"], "a name")
    convention = _choice("convention", content.get("convention", "standard"), CONVENTIONS)
    joints, table = _joints(content["joints"])
    followers = _followers(content, joints, table, convention)
    for joint, row in zip(joints, content["joints"], strict=True):
        unit: Literal["deg", "m"] = "deg" if joint.kind == "revolute" else "m"
        check_travel(f"joints.{joint.name}.", row["lower"], row["upper"], unit)
    rows = _rows(content["joints"], joints)
    if "parallelogram" in content:
        joints = tuple(_with_published_error(joint) for joint in joints)
    bodies = chain(table, [joint.kind for joint in joints], followers, convention, rows)
    matrix, limits = _transmission(content, joints)
    given = content.get("sizes", SIZES if "parallelogram" in content else {})
    sizes = _sizes(given, [body.name for body in bodies])
    described = Description(
        content["name"], joints, bodies, matrix, limits, _base(content), sizes=sizes, source=source
    )
    return _with_readings(described, content)


def _on_urdf(content: dict[str, Any], path: Path, source: str) -> Description:
    """Return the arm of a URDF with what its YAML adds."""
    _check_keys(content, _OF_URDF)
    for key in ("urdf", "tip", "name"):
        if key in content and (not isinstance(content[key], str) or not content[key]):
            raise ConfigError(key, content[key], "a path" if key == "urdf" else "a name")
    try:
        described = urdf_arm.read(path.parent / content["urdf"], content.get("tip"), source)
    except ConfigError as error:  # the mistake may be in either file
        raise error.in_file(f"{path}: {error.source}") from None
    if "actuator_to_joint" in content or "actuator_effort_limit" in content:
        matrix, limits = _transmission(content, described.joints)
        described = replace(
            described,
            joints=_with_actuator_limits(described.joints, matrix, limits),
            actuator_to_joint=matrix,
            actuator_effort_limit=limits,
        )
    name = content.get("name", described.name)
    base, stated = _base(content), "base_rpy" in content
    described = replace(described, name=name, base_rpy=base, base_stated=stated)
    return _with_readings(described, content)


def _with_readings(described: Description, content: dict[str, Any]) -> Description:
    """Return an arm with how its efforts are read, and where it has no friction."""
    n = len(described.joints)
    gains, errors = (
        np.array(_numbers_by_joint(key, content[key], described.joints)) if key in content else None
        for key in ("drive_gains", "drive_gain_error")
    )
    if gains is None and errors is not None:
        raise ConfigError("drive_gain_error", content["drive_gain_error"], "drive_gains beside it")
    unit, frictionless = content.get("effort_unit", ""), content.get("frictionless", [])
    if not isinstance(unit, str):
        raise ConfigError("effort_unit", unit, "a unit such as A or N·m")
    if not isinstance(frictionless, list) or not all(
        isinstance(name, str) for name in frictionless
    ):
        raise ConfigError("frictionless", frictionless, "a list of joints")
    if in_newtons(unit) and gains is None:  # stated, not only assumed
        unit, gains, errors = "", np.ones(n), np.zeros(n)
    read, command = _has_gravity(content.get("effort_has_gravity", {}))
    return replace(
        described,
        joints=tuple(replace(joint, read_in=unit) for joint in described.joints),
        drive_gains=gains,
        drive_gain_error=errors,
        frictionless=tuple(frictionless),
        gravity_in_reading=read,
        gravity_in_command=command,
    )


def _has_gravity(given: Any) -> tuple[bool, bool]:
    """Return whether efforts hold the arm's weight as they are read, and as they are sent."""
    keys, expected = ("read", "command"), "{read: true or false, command: true or false}"
    if not isinstance(given, Mapping) or not set(given) <= set(keys):
        raise ConfigError("effort_has_gravity", given, expected)
    found = [given.get(key, True) for key in keys]
    if not all(isinstance(value, bool) for value in found):
        raise ConfigError("effort_has_gravity", given, expected)
    return found[0], found[1]


def _base(content: dict[str, Any]) -> tuple[float, float, float]:
    roll, pitch, yaw = np.radians(_numbers("base_rpy", content.get("base_rpy", [0, 0, 0]), 3))
    return float(roll), float(pitch), float(yaw)


def _check_keys(content: dict[str, Any], known: Sequence[str]) -> None:
    for key in content:
        if key not in known:
            raise ConfigError(str(key), key, f"one of {', '.join(sorted(known))}")


def _sizes(given: Any, bodies: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Return mass, kg, and extent, m, of the links that they are given of."""
    if not isinstance(given, Mapping):
        raise ConfigError("sizes", given, "LINK: [kg, m]")
    found = {}
    for name, row in given.items():
        _choice("sizes", name, tuple(bodies))
        mass, extent = _numbers(f"sizes.{name}", row, 2)
        if mass <= 0 or extent <= 0:
            raise ConfigError(f"sizes.{name}", row, "a mass and an extent of more than 0")
        found[str(name)] = (mass, extent)
    return found


def _joints(rows: Any) -> tuple[tuple[Joint, ...], tuple[DHRow, ...]]:
    if not isinstance(rows, list) or not rows:
        raise ConfigError("joints", rows, "a list of joints")
    entries.check_count("joints", len(rows), MOST_JOINTS)
    parsed = [_joint(f"joints[{i}]", row) for i, row in enumerate(rows)]
    names = [joint.name for joint, _ in parsed]
    for i, name in enumerate(names):
        if name in names[:i]:
            raise ConfigError(f"joints[{i}].name", name, "a name that no joint before it has")
    return tuple(joint for joint, _ in parsed), tuple(row for _, row in parsed)


def _joint(where: str, row: Any) -> tuple[Joint, DHRow]:
    name = row.get("name") if isinstance(row, dict) else None
    if not isinstance(name, str) or not name:
        raise ConfigError(where, row, f"a joint with a name, {', '.join(_JOINT)}")
    where = f"joints.{name}"
    odd = (set(row) - {"type", "follows", *_POSITIVE}) ^ {"name", *_JOINT}
    if odd:
        raise ConfigError(
            where,
            sorted(map(str, odd)),
            f"just {', '.join(_JOINT)}, type if it is prismatic, follows if its link moves by "
            f"other joints too, and {', '.join(_POSITIVE)} if they are known",
        )
    kind = _choice(f"{where}.type", row.get("type", "revolute"), _KINDS)
    value = {key: _number(f"{where}.{key}", row[key]) for key in _JOINT}
    degrees = ("alpha", "offset", "lower", "upper") if kind == "revolute" else ("alpha", "offset")
    for key in degrees:
        value[key] = math.radians(value[key])
    known = {key: _number(f"{where}.{key}", row[key]) for key in _POSITIVE if key in row}
    for key, number in known.items():
        if number <= 0.0:
            raise ConfigError(f"{where}.{key}", number, "more than 0")
    limits = value["lower"], value["upper"], value["effort_limit"]
    velocity = known.get("velocity_limit", math.inf)
    joint = Joint(
        name, *limits, kind, published_error=known.get("published_error"),
        velocity_limit=math.radians(velocity) if kind == "revolute" else velocity,
    )  # fmt: skip
    if joint.effort_limit <= 0:
        raise ConfigError(
            f"{where}.effort_limit", row["effort_limit"], f"more than 0 {joint.effort_unit}"
        )
    return joint, DHRow(value["alpha"], value["a"], value["d"], value["offset"])


def _with_published_error(joint: Joint) -> Joint:
    """Return an MTM's joint with the error of its published models, unless the file has one."""
    known = joint.published_error
    return replace(joint, published_error=known or PUBLISHED_ERROR.get(joint.name))


def _rows(rows: Sequence[Any], joints: Sequence[Joint]) -> Array:
    """Return (n, n) coefficients of the joints in the coordinate of each joint's link."""
    names = tuple(joint.name for joint in joints)
    found = np.eye(len(joints))
    for i, (row, joint) in enumerate(zip(rows, joints, strict=True)):
        if "follows" in row:
            field = f"joints.{joint.name}.follows"
            factors = _follows(field, row["follows"], names)
            if factors[i]:
                raise ConfigError(field, joint.name, "other joints than its own")
            found[i] += factors
    return found


def _transmission(content: dict[str, Any], joints: Sequence[Joint]) -> tuple[Array, Array]:
    """Return the matrix from actuators to joints and the actuators' limits."""
    n = len(joints)
    given = content.get("actuator_to_joint")
    if given is None:
        matrix = np.eye(n)
    else:
        rows = entries.sequence("actuator_to_joint", given, n)
        matrix = np.array(
            [_numbers(f"actuator_to_joint[{i}]", row, n) for i, row in enumerate(rows)]
        )
        if abs(np.linalg.det(matrix)) < 1e-6:
            raise ConfigError("actuator_to_joint", given, "an invertible matrix")
    if given is None and "actuator_effort_limit" not in content:
        return matrix, np.array([joint.effort_limit for joint in joints])
    limits = _numbers_by_joint(
        "actuator_effort_limit", content.get("actuator_effort_limit"), joints
    )
    for joint, limit in zip(joints, limits, strict=True):
        if limit <= 0:
            raise ConfigError(
                f"actuator_effort_limit of {joint.name}", limit, f"more than 0 {joint.effort_unit}"
            )
    return matrix, np.array(limits)


def _with_actuator_limits(
    joints: Sequence[Joint], matrix: Array, limits: Array
) -> tuple[Joint, ...]:
    """Return joints with what their actuators exert at most, where the URDF states no limit."""
    most = (limits @ np.abs(np.linalg.inv(matrix))).tolist()
    return tuple(
        joint if joint.effort_stated else replace(joint, effort_limit=effort, effort_stated=True)
        for joint, effort in zip(joints, most, strict=True)
    )


def _followers(
    content: dict[str, Any], joints: Sequence[Joint], table: Sequence[DHRow], convention: Convention
) -> tuple[Follower, ...]:
    names = tuple(joint.name for joint in joints)
    if "parallelogram" in content or bodies.has_mtm_names(names):
        return _parallelogram(content, joints, table, convention)
    rows = content.get("followers", [])
    if not isinstance(rows, list):
        raise ConfigError("followers", rows, "a list of links")
    entries.check_count("followers", len(rows), MOST_JOINTS)
    links = link_frames(table, convention)
    frames = {"base": pin.SE3.Identity()} | {
        f"link{i}": frame for i, frame in enumerate(links, start=1)
    }
    found = []
    for i, row in enumerate(rows):
        follower = _follower(f"followers[{i}]", row, names, frames)
        frames[follower.name] = follower.frame
        found.append(follower)
    return tuple(found)


def _follower(
    where: str, row: Any, joints: tuple[str, ...], frames: dict[str, pin.SE3]
) -> Follower:
    known = {"name", "parent", "type", "xyz", "rpy", "follows"}
    if not isinstance(row, dict) or not {"name", "parent", "follows"} <= set(row) <= known:
        raise ConfigError(where, row, f"a link with {', '.join(sorted(known))}")
    name = row["name"]
    if not isinstance(name, str) or not name or name in frames:
        raise ConfigError(f"{where}.name", name, "a name that no other link has")
    where = f"followers.{name}"
    parent = _choice(f"{where}.parent", row["parent"], tuple(frames))
    kind = _choice(f"{where}.type", row.get("type", "revolute"), _KINDS)
    factors = _follows(f"{where}.follows", row["follows"], joints)
    xyz = np.array(_numbers(f"{where}.xyz", row.get("xyz", [0, 0, 0]), 3))
    rpy = np.radians(_numbers(f"{where}.rpy", row.get("rpy", [0, 0, 0]), 3))
    placement = frames[parent] * pin.SE3(pin.rpy.rpyToMatrix(*rpy), xyz)
    return Follower(name, parent, placement, kind, factors, pin.SE3.Identity())


def _follows(field: str, follows: Any, joints: tuple[str, ...]) -> Array:
    """Return (n,) coefficients of the joints that a link follows."""
    if not isinstance(follows, dict) or not follows:
        raise ConfigError(field, follows, "JOINT: factor, of at least one joint")
    factors = np.zeros(len(joints))
    for joint, factor in follows.items():
        index = joints.index(_choice(field, joint, joints))
        factors[index] = _number(f"{field}.{joint}", factor)
    return factors


def _parallelogram(
    content: dict[str, Any], joints: Sequence[Joint], table: Sequence[DHRow], convention: Convention
) -> tuple[Follower, ...]:
    """Return an MTM's crank and bar, after making sure that it is one: gY(q) beta counts on it."""
    for key in ("followers", "convention"):
        if key in content and content[key] not in ([], "standard"):
            raise ConfigError(key, content[key], "nothing beside parallelogram, as an MTM's file")
    side = _number("parallelogram", content.get("parallelogram"))
    if side <= 0:
        raise ConfigError("parallelogram", side, "a positive length")
    bodies.check(joints, table)
    return bodies.followers(table, side)


def _choice(field: str, value: Any, known: Sequence[Any]) -> Any:
    if value not in known:
        raise ConfigError(field, value, f"one of {', '.join(known)}")
    return value


def _numbers_by_joint(field: str, value: Any, joints: Sequence[Joint]) -> list[float]:
    """Return a number of each joint."""
    items = entries.sequence(field, value, len(joints))
    return [
        _number(f"{field} of {joint.name}", item) for joint, item in zip(joints, items, strict=True)
    ]
