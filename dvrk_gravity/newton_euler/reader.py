"""Reading a mechanism and its motion from YAML, with errors that name link and field.

The file's keys are ``links``, ``joints``, ``q``, ``qd``, ``qdd`` and optionally ``title``,
``angle_unit`` (``rad`` or ``deg``, of the joints' rotations and of revolute and rigid q),
``g_flag`` (0 or 1), ``gravity_direction``, ``forces`` and ``moments``;
docs/newton_euler.md has an example of each.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import yaml_file
from dvrk_gravity.newton_euler.mechanism import (
    GRAVITY,
    JointType,
    Link,
    LinkJoint,
    Mechanism,
    rotation_matrix,
)

_REQUIRED = ("links", "joints", "q", "qd", "qdd")
_OPTIONAL = ("title", "angle_unit", "g_flag", "gravity_direction", "forces", "moments")
_ANGLE_UNITS = {"rad": 1.0, "deg": np.pi / 180}


@dataclass(frozen=True)
class JointMotion:
    """One sample or a trajectory.

    Attributes:
        q: Positions, (n,) or (N, n), rad or m.
        qd: Velocities, same shape, rad/s or m/s.
        qdd: Accelerations, same shape, rad/s² or m/s².
    """

    q: Array
    qd: Array
    qdd: Array


def read(path: str | Path) -> tuple[Mechanism, JointMotion]:
    """Read a mechanism and its motion.

    Raises:
        ConfigError: Naming the file, and the link and the field where it is about one.
    """
    document = yaml_file.load(path)
    try:
        return parse(document)
    except ConfigError as error:
        raise error.in_file(path) from None


def parse(document: object) -> tuple[Mechanism, JointMotion]:
    """Return the mechanism and the motion that a parsed YAML document describes.

    Raises:
        ConfigError: Naming the link and the field.
    """
    whole = _mapping("", document, _REQUIRED, _OPTIONAL)
    unit = whole.get("angle_unit", "rad")
    if not isinstance(unit, str) or unit not in _ANGLE_UNITS:
        raise ConfigError("angle_unit", unit, "rad or deg")
    to_rad = _ANGLE_UNITS[unit]
    links = tuple(
        _link(f"link {number}", entry)
        for number, entry in enumerate(_list("links", whole["links"]), start=1)
    )
    joints = tuple(
        _joint(f"joint {number}", entry, to_rad)
        for number, entry in enumerate(_list("joints", whole["joints"]), start=1)
    )
    mechanism = Mechanism(
        links=links,
        joints=joints,
        gravity=_gravity(whole),
        forces=_rows("forces", whole.get("forces"), 7),
        moments=_rows("moments", whole.get("moments"), 4),
        title=str(whole.get("title", "")),
    )
    return mechanism, _motion(whole, joints, to_rad)


def _link(name: str, entry: object) -> Link:
    keys = _mapping(
        name, entry, ("length", "mass", "com", "inertia"), ("accept_impossible_inertia",)
    )
    accept = keys.get("accept_impossible_inertia", False)
    if not isinstance(accept, bool):
        raise ConfigError(f"{name}: accept_impossible_inertia", accept, "true or false")
    return Link(
        length=_number(f"{name}: length", keys["length"]),
        mass=_number(f"{name}: mass", keys["mass"]),
        com=_vector(f"{name}: com", keys["com"], 3),
        inertia=_matrix(f"{name}: inertia", keys["inertia"]),
        accept_impossible_inertia=accept,
    )


def _joint(name: str, entry: object, to_rad: float) -> LinkJoint:
    keys = _mapping(name, entry, ("type",), ("rotation",))
    kind = keys["type"]
    if isinstance(kind, bool) or not isinstance(kind, int) or kind not in tuple(JointType):
        raise ConfigError(f"{name}: type", kind, "0 (revolute), 1 (prismatic) or 2 (rigid)")
    angles = _vector(f"{name}: rotation", keys.get("rotation", [0, 0, 0]), 3) * to_rad
    return LinkJoint(JointType(kind), rotation_matrix(angles))


def _gravity(whole: Mapping[str, Any]) -> Array:
    flag = whole.get("g_flag", 1)
    if flag not in (0, 1):
        raise ConfigError("g_flag", flag, "0 or 1")
    direction = _vector("gravity_direction", whole.get("gravity_direction", [0, -1, 0]), 3)
    direction = direction / max(float(np.abs(direction).max()), np.finfo(float).tiny)  # no overflow
    norm = float(np.linalg.norm(direction))
    if not norm > 0:
        raise ConfigError("gravity_direction", direction.tolist(), "a direction that is not zero")
    return direction * (GRAVITY * flag / norm) + 0.0  # no -0.0 when switched off


def _motion(whole: Mapping[str, Any], joints: tuple[LinkJoint, ...], to_rad: float) -> JointMotion:
    n = len(joints)
    arrays = {}
    for key in ("q", "qd", "qdd"):
        value = _list(key, whole[key])
        if value and isinstance(value[0], list):
            arrays[key] = _rows(key, value, n)
        else:
            arrays[key] = _vector(key, value, n)
        if arrays[key].shape != arrays["q"].shape:
            raise ConfigError(
                key,
                f"shape {arrays[key].shape}",
                f"as many samples as q has: shape {arrays['q'].shape}",
            )
    angular = np.array([joint.type is not JointType.PRISMATIC for joint in joints])
    return JointMotion(arrays["q"] * np.where(angular, to_rad, 1.0), arrays["qd"], arrays["qdd"])


def _mapping(
    name: str, value: object, required: tuple[str, ...], optional: tuple[str, ...]
) -> dict[str, Any]:
    """Return ``value`` if it is a mapping with these keys."""
    known = ", ".join(required + optional)
    if not isinstance(value, dict):
        raise ConfigError(name, value, f"a mapping with the keys {known}")
    prefix = f"{name}: " if name else ""
    for key in value:
        if key not in required + optional:
            raise ConfigError(f"{prefix}{key}", value[key], f"one of the keys {known}")
    for key in required:
        if key not in value:
            raise ConfigError(f"{prefix}{key}", None, "a value, but the key is missing")
    return value


def _list(name: str, value: object) -> list[Any]:
    if not isinstance(value, list):
        raise ConfigError(name, value, "a list")
    return value


def _number(name: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        hint = " (in YAML 1.0e-3, not 1e-3)" if isinstance(value, str) else ""
        raise ConfigError(name, value, f"a number{hint}")
    try:
        number = float(value)
    except OverflowError:
        number = np.inf
    if not np.isfinite(number):
        raise ConfigError(name, value, "a finite number")
    return number


def _vector(name: str, value: object, size: int) -> Array:
    entries = _list(name, value)
    if len(entries) != size:
        raise ConfigError(name, value, f"{size} numbers")
    return np.array([_number(f"{name}[{k}]", entry) for k, entry in enumerate(entries)])


def _rows(name: str, value: object, columns: int) -> Array:
    rows = [] if value is None else _list(name, value)
    filled = [_vector(f"{name} row {k}", row, columns) for k, row in enumerate(rows, start=1)]
    return np.array(filled).reshape(len(filled), columns)


def _matrix(name: str, value: object) -> Array:
    if len(_list(name, value)) != 3:
        raise ConfigError(name, value, "3 rows of 3 numbers")
    return _rows(name, value, 3)
