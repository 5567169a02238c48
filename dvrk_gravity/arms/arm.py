"""An arm as data: joints, the tree of bodies that they move, transmission, limits, base."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from dvrk_gravity.arguments import PATH
from dvrk_gravity.errors import ArgumentError, ConfigError
from dvrk_gravity.resources import config_path

Array = NDArray[np.float64]
JointKind = Literal["revolute", "prismatic"]

GRAVITY = 9.81  # m/s^2
UNITS: dict[JointKind, str] = {"revolute": "rad", "prismatic": "m"}
EFFORT_UNITS: dict[JointKind, str] = {"revolute": "N·m", "prismatic": "N"}
# What counts as much as a rad, or a rad/s: where a threshold is given for joints that turn, that of
# joints that slide is as far at a lever of 0.1 m.
SCALES: dict[JointKind, float] = {"revolute": 1.0, "prismatic": 0.1}
SUPPORTED = (
    "mtml, mtmr, or the path of an arm's .yaml file (written like config/arms/mtmr.yaml) or .urdf "
    "(robot.urdf#LINK: what is between the base and that link)"
)


@dataclass(frozen=True)
class Joint:
    """One joint that is measured and driven.

    Attributes:
        name: Name as in ``measured_js``.
        lower: Lower position limit, rad or m; ``-inf`` if it turns without end.
        upper: Upper position limit, rad or m; ``inf`` likewise.
        effort_limit: Largest effort in joint space, N·m or N.
        kind: ``revolute`` or ``prismatic``.
    """

    name: str
    lower: float
    upper: float
    effort_limit: float
    kind: JointKind = "revolute"

    @property
    def unit(self) -> str:
        """Unit of its position: rad or m."""
        return UNITS[self.kind]

    @property
    def effort_unit(self) -> str:
        """Unit of its effort: N·m or N."""
        return EFFORT_UNITS[self.kind]

    def shown(self, position: float, decimals: int = 0) -> str:
        """Return a position, or a difference of two, as a person says it: in deg or mm."""
        if self.kind == "revolute":
            return f"{math.degrees(position):.{decimals}f} deg"
        return f"{1e3 * position:.{decimals}f} mm"


@dataclass(frozen=True, eq=False)
class Body:
    """One rigid body of the tree, and the axis that it turns about or slides along.

    The coordinate along that axis is ``row @ q``: of a link of the chain one joint's position, of a
    link that follows others (parallelogram, counterweight, mimic joint) a constant combination. A
    constant that a joint adds is in the placement.

    Attributes:
        name: Its name.
        parent: Index of the body that it moves on, -1 for the base; less than its own index.
        placement: Its joint's frame at zero seen from the parent's joint frame; the axis is z.
        kind: Whether it turns about z or slides along it.
        row: (n,) its row of the constant matrix G from joints to bodies.
        frame: The link's own frame (distal DH frame, URDF link) seen from its joint's frame.
    """

    name: str
    parent: int
    placement: pin.SE3
    kind: JointKind
    row: Array
    frame: pin.SE3


@dataclass(frozen=True, eq=False)
class Arm:
    """Geometry and limits of one arm; torques' causes are the effects' business.

    Attributes:
        name: Its name.
        joints: The n joints, in the order of every array.
        bodies: The rigid bodies, depth first.
        actuator_to_joint: (n, n) matrix M of ``q_joint = M q_actuator``.
        actuator_effort_limit: (n,) largest actuator efforts, N·m or N.
        base_rpy: Roll, pitch, yaw of the base frame in a world with z up, rad.
        inertial_parameters: (bodies, 10) nominal ones where the file brings them (a URDF), ``None``
            where not: m, m c (3), Ixx, Ixy, Iyy, Ixz, Iyz, Izz about the origin of the body's
            joint frame (kg, kg·m, kg·m^2), as ``effects`` and Pinocchio have them.
        source: What :meth:`load` loads it from: a name or a path; ``""`` if not from there.
    """

    name: str
    joints: tuple[Joint, ...]
    bodies: tuple[Body, ...]
    actuator_to_joint: Array
    actuator_effort_limit: Array
    base_rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)
    inertial_parameters: Array | None = None
    source: str = ""

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        rows = (body.row for body in self.bodies)
        for array in (self.actuator_to_joint, self.actuator_effort_limit, *rows):
            array.setflags(write=False)
        if self.inertial_parameters is not None:
            self.inertial_parameters.setflags(write=False)

    @classmethod
    def load(cls, name_or_path: str | Path) -> Arm:
        """Load an arm by name (``mtml``, ``mtmr``), from a YAML file, or from a URDF.

        ``robot.urdf#LINK`` is the chain from the base to that link; see :meth:`from_urdf`.

        Raises:
            ConfigError: Unknown name, another kind of file, or a file with a wrong, missing or
                unknown field.
        """
        # The readers build arms, so they are above this module.
        from dvrk_gravity.arms import urdf_arm, yaml_arm

        path = cls.file(name_or_path)
        if path.suffix.lower() == ".urdf":
            _, _, tip = str(name_or_path).partition("#")
            return urdf_arm.read(path, tip or None, str(name_or_path))
        return yaml_arm.read(path, str(name_or_path))

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
        """
        from dvrk_gravity.arms import urdf_arm

        return urdf_arm.read(Path(path), tip, f"{path}#{tip}" if tip else str(path))

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
        urdf = text.partition("#")[0]
        if urdf.lower().endswith(".urdf"):
            return Path(urdf)
        if text.endswith((".yaml", ".yml")):
            return Path(text)
        try:
            return config_path(f"arms/{text}.yaml")
        except (OSError, ValueError) as error:  # not there, or nothing a path can be
            raise ConfigError("arm", text, SUPPORTED) from error

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints, in the order of every array."""
        return tuple(joint.name for joint in self.joints)

    @cached_property
    def units(self) -> tuple[str, ...]:
        """Units of the joints' positions: rad or m."""
        return tuple(joint.unit for joint in self.joints)

    @cached_property
    def effort_units(self) -> tuple[str, ...]:
        """Units of the joints' efforts: N·m or N."""
        return tuple(joint.effort_unit for joint in self.joints)

    @cached_property
    def body_names(self) -> tuple[str, ...]:
        """Names of the bodies."""
        return tuple(body.name for body in self.bodies)

    def body(self, name: str) -> Body:
        """Return a body by its name.

        Raises:
            ConfigError: There is none of that name.
        """
        if name not in self.body_names:
            raise ConfigError("link", name, f"one of {', '.join(self.body_names)}")
        return self.bodies[self.body_names.index(name)]

    @cached_property
    def expand(self) -> Array:
        """(bodies, n) constant matrix G from joints to the coordinates of the bodies."""
        matrix = np.array([body.row for body in self.bodies])
        matrix.setflags(write=False)
        return matrix

    @cached_property
    def effort_limit(self) -> Array:
        """(n,) largest joint efforts, N·m or N."""
        return np.array([joint.effort_limit for joint in self.joints])

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
    def joint_to_actuator(self) -> Array:
        """(n, n) inverse of :attr:`actuator_to_joint`."""
        return np.asarray(np.linalg.inv(self.actuator_to_joint), dtype=float)

    @cached_property
    def gravity(self) -> Array:
        """(3,) gravity in the base frame as the base is mounted, m/s^2."""
        return gravity_in_base(*self.base_rpy)

    def joint_position(self, actuator_position: Array) -> Array:
        """Return (…, n) joint positions (or velocities) from actuator ones."""
        return actuator_position @ self.actuator_to_joint.T

    def actuator_position(self, joint_position: Array) -> Array:
        """Return (…, n) actuator positions (or velocities) from joint ones."""
        return joint_position @ self.joint_to_actuator.T

    def joint_effort(self, actuator_effort: Array) -> Array:
        """Return (…, n) joint efforts from actuator efforts: tau_joint = M^-T tau_actuator."""
        return actuator_effort @ self.joint_to_actuator

    def actuator_effort(self, joint_effort: Array) -> Array:
        """Return (…, n) actuator efforts from joint efforts: tau_actuator = M^T tau_joint."""
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
