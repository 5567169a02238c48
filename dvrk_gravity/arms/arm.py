"""An arm as data: joints, the tree of bodies that they move, transmission, limits, base."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arms import held_joints, urdf_arm, yaml_arm
from dvrk_gravity.arms.description import GRAVITY, SCALES, Description, in_newtons, read_in
from dvrk_gravity.arrays import Array
from dvrk_gravity.errors import ArgumentError, ConfigError
from dvrk_gravity.files.resources import config_path
from dvrk_gravity.validation import PATH, is_urdf, path_of, split_link

SUPPORTED = (
    "mtml, mtmr, psm, ecm, or the path of an arm's .yaml file (written like config/arms/mtmr.yaml) "
    "or .urdf (robot.urdf#LINK: the chain from the base to that link)"
)


@dataclass(frozen=True, eq=False)
class Arm(Description):
    """An arm as data; the effects model its torques."""

    @classmethod
    def load(cls, name_or_path: str | Path) -> Arm:
        """Load an arm by name (``mtml``, ``PSM``, …), from a YAML file, or from a URDF.

        ``robot.urdf#LINK`` is the chain from the base to that link; see :meth:`from_urdf`.

        Raises:
            ConfigError: Unknown name, another kind of file, or a file with a wrong, missing or
                unknown field.
        """
        path = cls.file(name_or_path)
        source = _as_named(str(name_or_path))
        if is_urdf(path):
            _, link = split_link(str(name_or_path))
            return cls._of_file(urdf_arm.read(path, link or None, source))
        return cls._of_file(yaml_arm.read(path, source))

    @classmethod
    def from_urdf(cls, path: str | Path, tip: str | None = None) -> Arm:
        """Read an arm from a URDF, with its limits and nominal inertial parameters.

        Joints that do not move are merged, mimic joints become bodies that follow, and the
        actuators are the joints.

        Args:
            path: The URDF.
            tip: Link at the end of the chain that is the arm; joints that do not lead to it are
                held at zero, or at the limit next to it. ``None``: all that moves is the arm.

        Raises:
            ConfigError: No such file, not a URDF, or what no arm can have.
            ArgumentError: A path that is none.
        """
        file = path_of("path", path)
        return cls._of_file(urdf_arm.read(file, tip, f"{path}#{tip}" if tip else str(path)))

    @classmethod
    def _of_file(cls, description: Description) -> Arm:
        return cls(**{field.name: getattr(description, field.name) for field in fields(cls)})

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
        text = _as_named(str(name_or_path))
        if _is_path(text):
            return Path(split_link(text)[0])
        try:
            return config_path(f"arms/{text}.yaml")
        except (OSError, ValueError) as error:  # not there, or nothing a path can be
            raise ConfigError("arm", str(name_or_path), SUPPORTED) from error

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @cached_property
    def units(self) -> tuple[str, ...]:
        """Units of the joints' positions: rad or m."""
        return tuple(joint.unit for joint in self.joints)

    @cached_property
    def effort_units(self) -> tuple[str, ...]:
        """Units of the joints' efforts: N·m or N."""
        return tuple(joint.effort_unit for joint in self.joints)

    @cached_property
    def effort_limit(self) -> Array:
        """(n,) largest joint efforts, N·m or N."""
        return np.array([joint.effort_limit for joint in self.joints])

    @cached_property
    def velocity_limit(self) -> Array:
        """(n,) largest velocities that the arm's file states, rad/s or m/s; ``inf``: none."""
        return np.array([joint.velocity_limit for joint in self.joints])

    @cached_property
    def lower(self) -> Array:
        """(n,) lower position limits, rad or m."""
        return np.array([joint.lower for joint in self.joints])

    @cached_property
    def upper(self) -> Array:
        """(n,) upper position limits, rad or m."""
        return np.array([joint.upper for joint in self.joints])

    @cached_property
    def range(self) -> tuple[Array, Array]:
        """(n,) lowest and (n,) highest positions to draw from: the limits, or a whole turn."""
        endless = ~np.isfinite(self.lower) | ~np.isfinite(self.upper)
        return np.where(endless, -np.pi, self.lower), np.where(endless, np.pi, self.upper)

    @cached_property
    def scale(self) -> Array:
        """(n,) what counts as much as a rad: 1 rad where a joint turns, 0.1 m where it slides."""
        return np.array([SCALES[joint.kind] for joint in self.joints])

    @cached_property
    def has_friction(self) -> NDArray[np.bool_]:
        """(n,) which joints have friction of their own: all but :attr:`frictionless`."""
        return ~np.isin(self.joint_names, self.frictionless)

    @cached_property
    def joint_to_actuator(self) -> Array:
        """(n, n) inverse of :attr:`actuator_to_joint`."""
        return np.asarray(np.linalg.inv(self.actuator_to_joint), dtype=float)

    @property
    def direct_drive(self) -> bool:
        """Whether each motor's coordinate is its joint's: there is no transmission."""
        return bool((self.actuator_to_joint == np.eye(self.n)).all())

    @cached_property
    def gravity(self) -> Array:
        """(3,) gravity in the base frame as the base is mounted, m/s^2."""
        return gravity_in_base(*self.base_rpy)

    def own_unit(self, unit: str) -> str:
        """Return the unit of what is in ``unit`` where efforts are in N·m."""
        return read_in(unit, self.read_in) if self.read_in else unit

    @property
    def read_in(self) -> str:
        """Unit of efforts, and of all that is reported, where that is not N·m."""
        return self.joints[0].read_in

    @property
    def newtons_stated(self) -> bool:
        """Whether efforts are stated, not only assumed, to be in N·m."""
        return self.drive_gains is not None and bool((self.drive_gains == 1.0).all())

    def with_effort_unit(self, unit: str, size: float = 1.0) -> Arm:
        """Return the arm with its efforts in a unit that is not N·m, as its recordings have them.

        Args:
            unit: The unit.
            size: How much an effort of 1 N·m is in it, about: limits and nominal masses of the
                arm's file are taken to it.

        Raises:
            ConfigError: Words that are no unit, or drive gains, which take efforts to N·m.
        """
        if in_newtons(unit):  # stated, not only assumed
            return self.with_drive_gains(np.ones(self.n), np.zeros(self.n))
        nominal, factor = self.inertial_parameters, size / self.effort_size
        joints = (
            replace(
                joint,
                read_in=unit,
                effort_limit=factor * joint.effort_limit,
                damping=factor * joint.damping,
                friction=factor * joint.friction,
            )
            for joint in self.joints
        )
        return replace(
            self,
            joints=tuple(joints),
            actuator_effort_limit=factor * self.actuator_effort_limit,
            inertial_parameters=None if nominal is None else factor * nominal,
            effort_size=size,
        )

    def with_drive_gains(
        self, gains: Sequence[float] | Array, error: Sequence[float] | Array | None = None
    ) -> Arm:
        """Return the arm with what a unit (A) of its efforts is in N·m, or N.

        Args:
            gains: (n,) of the joints in their order; of motors, where efforts are motors'.
            error: (n,) relative standard errors; ``None``: as good as published ones are.

        Raises:
            ConfigError: Another number of them, or one that is not positive.
        """
        values = np.array(gains, dtype=float)
        spread = None if error is None else np.array(error, dtype=float)
        joints = tuple(replace(joint, read_in="") for joint in self.joints)
        return replace(self, joints=joints, drive_gains=values, drive_gain_error=spread)

    def limited_to(self, effort: Array) -> Arm:
        """Return the arm with joint effort limits, N·m or N, where its file states none.

        Args:
            effort: (n,) limits.
        """
        if all(joint.effort_stated for joint in self.joints):
            return self
        joints = tuple(
            joint if joint.effort_stated else replace(joint, effort_limit=limit, effort_stated=True)
            for joint, limit in zip(self.joints, effort.tolist(), strict=True)
        )
        # A transmission has limits of its own, so there is none here.
        limits = np.array([joint.effort_limit for joint in joints])
        return replace(self, joints=joints, actuator_effort_limit=limits)

    def with_held_joints(self, where: Mapping[str, float]) -> Arm:
        """Return the arm with some joints held still, rad or m by name; see ``held_joints``.

        Raises:
            ConfigError: A joint that there is not, none left, or one whose motor moves others.
        """
        return self._of_file(held_joints.hold_joints(self, where)) if where else self

    def torque_of_reading(self, effort: Array) -> Array:
        """Return (…, n) efforts in N·m, or N, of what the arm reads; the same without gains."""
        return effort if self.drive_gains is None else effort * self.drive_gains

    def reading_of_torque(self, effort: Array) -> Array:
        """Return (…, n) efforts as the arm reads and takes them, of those in N·m, or N."""
        return effort if self.drive_gains is None else effort / self.drive_gains

    def joint_position(self, actuator_position: Array) -> Array:
        """Return (…, n) joint positions (or velocities) from actuator ones."""
        return actuator_position @ self.actuator_to_joint.T

    def actuator_position(self, joint_position: Array) -> Array:
        """Return (…, n) actuator positions (or velocities) from joint ones."""
        return joint_position @ self.joint_to_actuator.T

    def joint_effort(self, actuator_effort: Array) -> Array:
        """Return (…, n) joint efforts from actuator efforts: tau_joint = M^-T tau_actuator."""
        return actuator_effort @ self.joint_to_actuator

    def joints_of(self, motors: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return (…, n) joints whose efforts those of some (…, n) motors are a part of."""
        return motors @ (self.joint_to_actuator != 0.0)

    def motors_of(self, joints: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return (…, n) motors whose efforts are parts of those of some (…, n) joints alone."""
        return ~(~joints @ (self.actuator_to_joint != 0.0))

    def actuator_effort(self, joint_effort: Array) -> Array:
        """Return (…, n) actuator efforts from joint efforts: tau_actuator = M^T tau_joint."""
        return joint_effort @ self.actuator_to_joint


def gravity_in_base(roll: float, pitch: float, yaw: float = 0.0) -> Array:
    """Return (3,) gravity in a base frame turned by Rz(yaw) Ry(pitch) Rx(roll), m/s^2.

    Yaw has no effect on it.
    """
    del yaw
    return -GRAVITY * np.array(
        [
            -math.sin(pitch),
            math.cos(pitch) * math.sin(roll),
            math.cos(pitch) * math.cos(roll),
        ]
    )


def _is_path(text: str) -> bool:
    file, _ = split_link(text)
    return is_urdf(file) or file.lower().endswith((".yaml", ".yml"))


def _as_named(text: str) -> str:
    """Return a path unchanged, and a name in lower case."""
    return text if _is_path(text) else text.lower()
