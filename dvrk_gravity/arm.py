"""The arm: joint names, DH table, limits, actuator coupling, parallelogram, base orientation."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity import yaml_file
from dvrk_gravity.arguments import PATH
from dvrk_gravity.errors import ArgumentError, ConfigError
from dvrk_gravity.parameter import is_finite
from dvrk_gravity.resources import config_path

Array = NDArray[np.float64]

JOINT_NAMES = (
    "outer_yaw",
    "shoulder_pitch",
    "elbow_pitch",
    "wrist_platform",
    "wrist_pitch",
    "wrist_yaw",
    "wrist_roll",
)
N_JOINTS = len(JOINT_NAMES)
GRAVITY = 9.81  # m/s^2
SUPPORTED = (
    "mtml, mtmr, or the path of an MTM's .yaml file, written like config/arms/mtmr.yaml (a URDF or "
    "another kind of arm is not supported)"
)


@dataclass(frozen=True)
class Joint:
    """One joint of the serial chain, standard (distal) DH.

    Attributes:
        name: Name as in ``measured_js``.
        alpha: Twist about x, rad.
        a: Length along x, m.
        d: Offset along z, m.
        offset: Added to the joint position, rad.
        lower: Lower position limit, rad.
        upper: Upper position limit, rad.
        effort_limit: Largest torque in joint space, N·m.
    """

    name: str
    alpha: float
    a: float
    d: float
    offset: float
    lower: float
    upper: float
    effort_limit: float


@dataclass(frozen=True, eq=False)
class Arm:
    """Geometry and limits of one MTM; torques' causes are the terms' business.

    Attributes:
        name: ``mtml``, ``mtmr`` or the name in a file of one's own.
        joints: The seven joints.
        actuator_to_joint: (7, 7) matrix M of ``q_joint = M q_actuator``.
        actuator_effort_limit: (7,) largest actuator torques, N·m.
        parallelogram: Length of the parallelogram's short sides, m.
        base_rpy: Roll, pitch, yaw of the base frame in a world with z up, rad.
        source: What :meth:`load` loads it from: a name or a path; ``""`` if not from there.
    """

    name: str
    joints: tuple[Joint, ...]
    actuator_to_joint: Array
    actuator_effort_limit: Array
    parallelogram: float
    base_rpy: tuple[float, float, float]
    source: str = ""
    joint_names: tuple[str, ...] = field(init=False)

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        object.__setattr__(self, "joint_names", tuple(joint.name for joint in self.joints))
        for array in (self.actuator_to_joint, self.actuator_effort_limit):
            array.setflags(write=False)

    @classmethod
    def load(cls, name_or_path: str | Path) -> Arm:
        """Load an arm by name (``mtml``, ``mtmr``) or from a YAML file of an MTM.

        Raises:
            ConfigError: Unknown name, another kind of file, or a file with a wrong, missing or
                unknown field.
        """
        path = cls.file(name_or_path)
        try:
            return replace(_parse(yaml_file.load(path)), source=str(name_or_path))
        except ConfigError as error:
            raise error if error.source else error.in_file(path) from None

    @classmethod
    def of(cls, given: Arm | str | Path) -> Arm:
        """Return an arm, or the one that a name or a path stands for; see :meth:`load`."""
        return given if isinstance(given, Arm) else cls.load(given)

    def __repr__(self) -> str:
        """Return its name."""
        return f"<Arm {self.source or self.name}>"

    @staticmethod
    def file(name_or_path: str | Path) -> Path:
        """Return the file that :meth:`load` reads, which need not exist if it is given as a path.

        Raises:
            ArgumentError: Neither a name nor a path.
            ConfigError: Unknown name.
        """
        if not isinstance(name_or_path, PATH):
            raise ArgumentError("arm", name_or_path, SUPPORTED)
        text = str(name_or_path)
        if text.endswith((".yaml", ".yml")):
            return Path(text)
        try:
            return config_path(f"arms/{text}.yaml")
        except (OSError, ValueError) as error:  # not there, or nothing a path can be
            raise ConfigError("arm", text, SUPPORTED) from error

    @cached_property
    def effort_limit(self) -> Array:
        """(7,) largest joint torques, N·m."""
        return np.array([joint.effort_limit for joint in self.joints])

    @cached_property
    def lower(self) -> Array:
        """(7,) lower position limits, rad."""
        return np.array([joint.lower for joint in self.joints])

    @cached_property
    def upper(self) -> Array:
        """(7,) upper position limits, rad."""
        return np.array([joint.upper for joint in self.joints])

    @cached_property
    def joint_to_actuator(self) -> Array:
        """(7, 7) inverse of :attr:`actuator_to_joint`."""
        return np.asarray(np.linalg.inv(self.actuator_to_joint), dtype=float)

    @cached_property
    def gravity(self) -> Array:
        """(3,) gravity in the base frame as the base is mounted, m/s^2."""
        return gravity_in_base(*self.base_rpy)

    def joint_position(self, actuator_position: Array) -> Array:
        """Return (…, 7) joint positions (or velocities) from actuator ones."""
        return actuator_position @ self.actuator_to_joint.T

    def actuator_position(self, joint_position: Array) -> Array:
        """Return (…, 7) actuator positions (or velocities) from joint ones."""
        return joint_position @ self.joint_to_actuator.T

    def joint_effort(self, actuator_effort: Array) -> Array:
        """Return (…, 7) joint torques from actuator torques: tau_joint = M^-T tau_actuator."""
        return actuator_effort @ self.joint_to_actuator

    def actuator_effort(self, joint_effort: Array) -> Array:
        """Return (…, 7) actuator torques from joint torques: tau_actuator = M^T tau_joint."""
        return joint_effort @ self.actuator_to_joint


def gravity_in_base(roll: float, pitch: float, yaw: float = 0.0) -> Array:
    """Return (3,) gravity in a base frame turned by Rz(yaw) Ry(pitch) Rx(roll), m/s^2.

    Yaw has no effect on it: gravity does not tell where north is.
    """
    del yaw
    return -GRAVITY * np.array(
        [
            -math.sin(pitch),
            math.cos(pitch) * math.sin(roll),
            math.cos(pitch) * math.cos(roll),
        ]
    )


def _parse(content: dict[str, Any]) -> Arm:
    known = {
        "name", "joints", "actuator_to_joint", "actuator_effort_limit", "parallelogram", "base_rpy",
    }  # fmt: skip
    for key in content:
        if key not in known:
            raise ConfigError(str(key), key, f"one of {', '.join(sorted(known))}")
    for key in sorted(known):
        if key not in content:
            raise ConfigError(key, None, "a value")
    if not isinstance(content["name"], str):
        raise ConfigError("name", content["name"], "a name")
    rows = content["joints"]
    if not isinstance(rows, list) or len(rows) != N_JOINTS:
        raise ConfigError("joints", rows, f"a list of {N_JOINTS} joints")
    joints = tuple(_parse_joint(row, name) for row, name in zip(rows, JOINT_NAMES, strict=True))
    matrix = np.array(
        [_numbers(f"actuator_to_joint[{i}]", row, N_JOINTS) for i, row in enumerate(
            _list("actuator_to_joint", content["actuator_to_joint"], N_JOINTS))]
    )  # fmt: skip
    if abs(np.linalg.det(matrix)) < 1e-6:
        raise ConfigError("actuator_to_joint", content["actuator_to_joint"], "an invertible matrix")
    limits = _numbers("actuator_effort_limit", content["actuator_effort_limit"], N_JOINTS)
    for joint, limit in zip(joints, limits, strict=True):
        if limit <= 0:
            raise ConfigError(f"actuator_effort_limit of {joint.name}", limit, "a positive torque")
    side = _number("parallelogram", content["parallelogram"])
    if side <= 0:
        raise ConfigError("parallelogram", side, "a positive length")
    roll, pitch, yaw = np.radians(_numbers("base_rpy", content["base_rpy"], 3)).tolist()
    return Arm(content["name"], joints, matrix, np.array(limits), side, (roll, pitch, yaw))


def _parse_joint(row: Any, name: str) -> Joint:
    fields = ("alpha", "a", "d", "offset", "lower", "upper", "effort_limit")
    where = f"joints.{name}"
    if not isinstance(row, dict) or row.get("name") != name:
        raise ConfigError(where, row, f"the joint named {name}")
    if set(row) != {"name", *fields}:
        raise ConfigError(where, sorted(set(row) ^ {"name", *fields}), f"just {', '.join(fields)}")
    value = {key: _number(f"{where}.{key}", row[key]) for key in fields}
    for key in ("alpha", "offset", "lower", "upper"):
        value[key] = math.radians(value[key])
    if value["lower"] >= value["upper"]:
        raise ConfigError(f"{where}.lower", row["lower"], f"less than upper ({row['upper']})")
    if value["effort_limit"] <= 0:
        raise ConfigError(f"{where}.effort_limit", row["effort_limit"], "a positive torque")
    return Joint(name, **value)


def _number(field_name: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not is_finite(value):
        raise ConfigError(field_name, value, "a finite number")
    return float(value)


def _list(field_name: str, value: Any, length: int) -> list[Any]:
    if not isinstance(value, list) or len(value) != length:
        raise ConfigError(field_name, value, f"a list of {length}")
    return value


def _numbers(field_name: str, value: Any, length: int) -> list[float]:
    return [
        _number(f"{field_name}[{i}]", item)
        for i, item in enumerate(_list(field_name, value, length))
    ]
