"""The content of an arm's file: joints, bodies, transmission, limits, base."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np
import pinocchio as pin

from dvrk_gravity.arrays import Array
from dvrk_gravity.errors import ConfigError, printable

JointKind = Literal["revolute", "prismatic"]

GRAVITY = 9.81  # m/s^2
LEAST_GAIN, GREATEST_GAIN = 1e-3, 1e4
"""N·m/A: from a tenth of the least motor's torque constant, without a gear, to ten times those of
the largest robots' geared axes. An effort in N·m divided by it stays a current."""

# Relative standard error of drive gains that are given without one. Chosen: published gains of a
# UR10e are 5 to 12 % above those that a known load of 2.8 kg shows (docs/own_arm.md).
GAIN_ERROR = 0.05
UNITS: dict[JointKind, str] = {"revolute": "rad", "prismatic": "m"}
EFFORT_UNITS: dict[JointKind, str] = {"revolute": "N·m", "prismatic": "N"}
# How people write a unit of torque: N·m itself, and such as are a factor from it.
_NEWTON_METRES = {"nm", "n", "newtonmeter", "newtonmeters", "newtonmetre", "newtonmetres"}
_OF_NEWTON_METRES = {"mNm": 1e-3, "Nmm": 1e-3, "Ncm": 1e-2, "kNm": 1e3, "mN": 1e-3, "kN": 1e3}
ANY_UNIT = "a.u."  # arbitrary unit: that of the recordings, of which only its not being SI is known
# What counts as much as a rad, or a rad/s: where a threshold is given for joints that turn, that of
# joints that slide is as far at a lever of 0.1 m.
SCALES: dict[JointKind, float] = {"revolute": 1.0, "prismatic": 0.1}
# rad/s that no joint turns at. A tennis serve turns an elbow at 26 rad/s (Fleisig et al. 2003,
# Sports Biomechanics 2(1)); nobody guides an arm that fast.
FASTEST = 25.0
# rad by which positions may differ at any rate: ten steps of the coarsest encoder (an MTM's
# wrist_roll, 0.006 rad), and what stamps that are rounded to 10 ms hide at 6 rad/s.
UNTIMED_STEP = 0.06


def read_in(unit: str, effort: str) -> str:
    """Return an SI unit with N·m, or N, replaced by the unit that efforts are read in.

    A torque is in that unit; a mass, which makes torque, is in kg times it and over N·m: times a
    drive gain in N·m/A, ``kg·A/(N·m)`` is kg.
    """
    if "kg" in unit:
        return ", ".join(f"{part}·{effort}/(N·m)" for part in unit.split(", "))
    return unit.replace("N·m", effort)


def in_newtons(unit: str) -> bool:
    """Return whether a unit is N·m, or N, in any spelling."""
    return newton_metres(unit) == 1.0


def newton_metres(unit: str) -> float | None:
    """Return a unit's size in N·m, or N, in any spelling; ``None`` of one that is no multiple."""
    letters = _letters(unit)
    return 1.0 if letters.lower() in _NEWTON_METRES else _OF_NEWTON_METRES.get(letters)


def _letters(unit: str) -> str:
    return "".join(letter for letter in unit if letter.isalpha())


def thousandth(unit: str) -> str:
    """Return what a table calls a thousandth of a unit."""
    return f"10⁻³ {unit}" if unit == ANY_UNIT else f"m{unit}"


@dataclass(frozen=True)
class Joint:
    """One joint that is measured and driven.

    Attributes:
        name: Name as in ``measured_js``.
        lower: Lower position limit, rad or m; ``-inf`` if it turns without end.
        upper: Upper position limit, rad or m; ``inf`` likewise.
        effort_limit: Largest effort in joint space, N·m or N.
        kind: ``revolute`` or ``prismatic``.
        read_in: Unit of its effort where that is not N·m or N: ``A``, or :data:`ANY_UNIT`.
        damping: Viscous friction that the arm's file states, N·m·s/rad or N·s/m.
        friction: Dry friction that it states, N·m or N.
        velocity_limit: Largest velocity that the arm's file states, rad/s or m/s; ``inf`` where it
            states none.
        range_stated: Whether the arm's file says where it stops, or that it does not.
        effort_stated: Whether ``effort_limit`` is what the arm's file states. If not, it is a
            plausible size (``plausible_effort``): enough for a fit, not for a command.
        published_error: Error of careful fits of this joint on a motion that they had not seen, as
            a part of its torque; ``None`` where none is published.
    """

    name: str
    lower: float
    upper: float
    effort_limit: float
    kind: JointKind = "revolute"
    read_in: str = ""
    damping: float = 0.0
    friction: float = 0.0
    velocity_limit: float = math.inf
    range_stated: bool = True
    effort_stated: bool = True
    published_error: float | None = None

    @property
    def unit(self) -> str:
        """Unit of its position: rad or m."""
        return UNITS[self.kind]

    @property
    def effort_unit(self) -> str:
        """Unit of its effort: N·m or N, or the one that it is read in."""
        return self.read_in or EFFORT_UNITS[self.kind]

    def own_unit(self, unit: str) -> str:
        """Return the unit at this joint of what is in ``unit`` where a joint turns."""
        if self.read_in:
            unit = read_in(unit, self.read_in)
        if self.kind == "prismatic":
            return unit.replace("N·m", "N").replace("rad", "m").replace("kg·m^2", "kg")
        return unit

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
class Description:
    """Geometry and limits of one arm.

    Attributes:
        name: Its name.
        joints: The n joints, in the order of every array.
        bodies: The rigid bodies, depth first.
        actuator_to_joint: (n, n) matrix M of ``q_joint = M q_actuator``.
        actuator_effort_limit: (n,) largest actuator efforts, N·m or N.
        base_rpy: Roll, pitch, yaw of the base frame in a world with z up, rad.
        base_stated: Whether its file says how the base is mounted; a URDF does not.
        inertial_parameters: (bodies, 10) nominal ones where the file brings them (a URDF), ``None``
            where not: m, m c (3), Ixx, Ixy, Iyy, Ixz, Iyz, Izz about the origin of the body's
            joint frame (kg, kg·m, kg·m^2), as ``effects`` and Pinocchio have them.
        sizes: About how heavy, kg, and how large, m, bodies are, by name, as far as the file says:
            what a fit expects of them before any data.
        drive_gains: (n,) N·m (or N) of each unit, usually A, in which the arm reads and takes
            efforts; ``None``: it reads them in N·m. Inside, all efforts are in N·m.
        drive_gain_error: (n,) their relative standard errors; ``None`` without gains.
        effort_size: How much an effort of 1 N·m is in the unit of the efforts, about, where that is
            another: limits and nominal parameters are multiples of it.
        frictionless: Names of joints that have no friction of their own.
        gravity_in_reading: Whether the efforts that the arm reads hold its weight.
        gravity_in_command: Whether those that it takes are to; else it holds its weight itself.
        held: Where joints of its file are held that are none of its joints, rad or m, by name.
        merged: Links that move with a body: its index, -1 for the base, and the link's frame seen
            from the body's own (``Body.frame``), by name.
        warnings: What its file says of links that no link can have, or leaves out: a line each.
        source: What :meth:`load` loads it from: a name or a path; ``""`` if not from there.
        urdf: Path of the URDF that it was read from; ``""``: from none.
    """

    name: str
    joints: tuple[Joint, ...]
    bodies: tuple[Body, ...]
    actuator_to_joint: Array
    actuator_effort_limit: Array
    base_rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)
    base_stated: bool = False
    inertial_parameters: Array | None = None
    sizes: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    drive_gains: Array | None = None
    drive_gain_error: Array | None = None
    effort_size: float = 1.0
    frictionless: tuple[str, ...] = ()
    gravity_in_reading: bool = True
    gravity_in_command: bool = True
    held: Mapping[str, float] = field(default_factory=dict)
    merged: Mapping[str, tuple[int, pin.SE3]] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    source: str = ""
    urdf: str = ""

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        rows = (body.row for body in self.bodies)
        names = [*(joint.name for joint in self.joints), *(body.name for body in self.bodies)]
        for name in (self.name, *names):
            if printable(name) != name:
                raise ConfigError("name", name, "one of characters that can be printed")
        for name in names:
            if "." in name:  # a parameter is called link_weight.NAME
                raise ConfigError("name", name, "one without dots, which group parameters")
        self._check_readings()
        given = (self.inertial_parameters, self.drive_gains, self.drive_gain_error)
        for array in (self.actuator_to_joint, self.actuator_effort_limit, *rows, *given):
            if array is not None:
                array.setflags(write=False)
        direct = (self.actuator_to_joint == np.eye(len(self.joints))).all()
        if not self.gravity_in_reading and (self.joints[0].read_in or not direct):
            alternative = "drive_gains instead of effort_unit" if direct else "no actuator_to_joint"
            raise ConfigError("effort_has_gravity.read", False, f"{alternative} beside it")

    def _check_readings(self) -> None:
        """Check drive gains and their errors, and put usual ones where none are given.

        Raises:
            ConfigError: Gains of another number than the joints', or that are not positive; errors
                likewise; a unit that is none; a joint without friction that there is not.
        """
        n, gains = len(self.joints), self.drive_gains
        for name in self.frictionless:
            if name not in self.joint_names:
                raise ConfigError("frictionless", name, f"some of {', '.join(self.joint_names)}")
        unit = self.joints[0].read_in
        if any(letter.isspace() for letter in unit):
            raise ConfigError("effort_unit", unit, "a unit such as A or N·m")
        factor = _OF_NEWTON_METRES.get(_letters(unit))
        if factor:
            raise ConfigError("effort_unit", unit, f"drive gains instead, of {factor:g} N·m each")
        if gains is None:
            return
        if unit:
            raise ConfigError("effort_unit", unit, "none with drive gains: they give N·m")
        if gains.shape != (n,):
            each = ", ".join(self.joint_names)
            raise ConfigError(
                "drive_gains", f"{gains.size} numbers", f"{n}, one for each of {each}"
            )
        for joint, gain in zip(self.joints, gains.tolist(), strict=True):
            if not LEAST_GAIN <= gain <= GREATEST_GAIN:
                allowed = f"{LEAST_GAIN:g} to {GREATEST_GAIN:g} {joint.effort_unit}/A"
                raise ConfigError(f"drive_gains of {joint.name}", gain, allowed)
        error = self.drive_gain_error
        if error is None:
            object.__setattr__(self, "drive_gain_error", np.full(n, GAIN_ERROR))
            return
        if error.shape != (n,):
            raise ConfigError("drive_gain_error", error.tolist(), f"{n} numbers, 0 or more")
        for joint, value in zip(self.joints, error.tolist(), strict=True):
            if not 0.0 <= value < np.inf:
                raise ConfigError(f"drive_gain_error of {joint.name}", value, "0 or more")

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints, in the order of every array."""
        return tuple(joint.name for joint in self.joints)

    @cached_property
    def body_names(self) -> tuple[str, ...]:
        """Names of the bodies."""
        return tuple(body.name for body in self.bodies)

    @cached_property
    def expand(self) -> Array:
        """(bodies, n) constant matrix G from joints to the coordinates of the bodies."""
        matrix = np.array([body.row for body in self.bodies])
        matrix.setflags(write=False)
        return matrix

    def body(self, name: str) -> Body:
        """Return a body by its name.

        Raises:
            ConfigError: There is none of that name.
        """
        if name not in self.body_names:
            raise ConfigError("link", name, f"one of {', '.join(self.body_names)}")
        return self.bodies[self.body_names.index(name)]

    def carrier(self, link: str) -> tuple[int, pin.SE3]:
        """Return the index of the body that a link moves with, and the link's frame in the body's.

        A link on a fixed joint, or on one that is held, moves with the body that carries it.

        Raises:
            ConfigError: There is none of that name, or it does not move.
        """
        if link in self.body_names:
            return self.body_names.index(link), pin.SE3.Identity()
        index, frame = self.merged.get(link, (-1, pin.SE3.Identity()))
        if index < 0:
            still = " (it does not move)" if link in self.merged else ""
            raise ConfigError("link", f"{link}{still}", f"one of {', '.join(self.body_names)}")
        return index, frame
