"""What a URDF must hold, checked before Pinocchio reads it, which would not say it clearly."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from copy import deepcopy
from xml.etree import ElementTree

import numpy as np

from dvrk_gravity.arms.description import JointKind
from dvrk_gravity.arms.range import check_range
from dvrk_gravity.errors import ConfigError

KINDS: dict[str, JointKind] = {
    "revolute": "revolute",
    "continuous": "revolute",
    "prismatic": "prismatic",
}
_TYPES = (*KINDS, "fixed")
_INERTIA = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_NAMES = ("link", "joint", "name")
_MOMENTS = ("ixx", "iyy", "izz")
# Numbers of joints that Pinocchio's reader stops at where they are none, used or not.
_OF_JOINTS = {
    "limit": ("lower", "upper", "effort", "velocity"),
    "mimic": ("multiplier", "offset"),
    "dynamics": ("damping", "friction"),
    "safety_controller": ("soft_lower_limit", "soft_upper_limit", "k_position", "k_velocity"),
    "calibration": ("rising", "falling"),
}
# Chosen: an axis is written as a unit vector, or as a difference of points in m or mm. Pinocchio's
# reader takes one whose square is no number of its own for z.
_SHORTEST, _LONGEST = 1e-3, 1e3
# kg·m^2. Chosen: far below any link's (a gram at a mm), far above the rounding of exporters: an
# iCub's file has moments of -5e-20.
_ROUNDED = 1e-12


def parse(text: str) -> ElementTree.Element:
    """Return the robot of a URDF's text.

    Raises:
        ConfigError: It is none, or one that xacro has yet to expand.
    """
    if "<!DOCTYPE" in text:  # entities: nothing that a robot needs, and some are bombs
        raise ConfigError("", "a document type", "a URDF: XML without one")
    try:
        robot = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        if "<xacro:" in text:  # its namespace may be missing
            raise _of_xacro("<xacro:…>") from error
        raise ConfigError("", str(error), "a URDF: XML with a robot in it") from error
    _check_expanded(robot)
    if robot.tag != "robot" or not robot.get("name"):
        raise ConfigError("", f"<{robot.tag}>", 'a URDF: <robot name="…">')
    return robot


def _check_expanded(robot: ElementTree.Element) -> None:
    """Raise ``ConfigError`` for what is left of xacro: its tags, and what it fills in."""
    for element in robot.iter():
        space, _, tag = str(element.tag).rpartition("}")
        if space.endswith("xacro"):
            raise _of_xacro(f"<xacro:{tag}>")
        for key, value in element.items():
            if "${" in value or "$(" in value:
                raise _of_xacro(f'<{tag} {key}="{value}">')


def _of_xacro(found: str) -> ConfigError:
    return ConfigError("", found, "a URDF without xacro: expand it with xacro first")


def read_joints(robot: ElementTree.Element) -> dict[str, ElementTree.Element]:
    """Return the joints by name; those of ``<transmission>`` and other tags are none.

    Raises:
        ConfigError: A name that is missing or taken, a type or a link that there is not.
    """
    links = _links(robot)
    joints: dict[str, ElementTree.Element] = {}
    for joint in robot.findall("joint"):
        name = joint.get("name")
        if not name or name in joints:
            raise ConfigError("joint", name, "a name that no other joint has")
        if joint.get("type") not in _TYPES:
            raise ConfigError(f"joint {name}: type", joint.get("type"), f"{', '.join(_TYPES)}")
        for end in ("parent", "child"):
            if attribute(joint, end, "link") not in links:
                raise ConfigError(
                    f"joint {name}: {end}", attribute(joint, end, "link"), "a link of the file"
                )
        joints[name] = joint
    return joints


def _links(robot: ElementTree.Element) -> list[str]:
    names: list[str] = []
    for link in robot.findall("link"):
        name = link.get("name")
        if not name or name in names:
            raise ConfigError("link", name, "a name that no other link has")
        names.append(name)
    return names


def find_root(robot: ElementTree.Element, joints: Mapping[str, ElementTree.Element]) -> str:
    """Return the link that all others are on.

    Raises:
        ConfigError: There is none, or more than one, or links that are on none.
    """
    children = [str(attribute(joint, "child", "link")) for joint in joints.values()]
    for child in children:
        if children.count(child) > 1:
            raise ConfigError(f"link {child}", "the child of two joints", "a tree of links")
    links = _links(robot)
    roots = [name for name in links if name not in children]
    if len(roots) != 1:
        raise ConfigError("link", roots, "one link that is no joint's child")
    reached = {roots[0]}
    waiting = list(joints.values())
    while on_tree := [joint for joint in waiting if attribute(joint, "parent", "link") in reached]:
        reached |= {str(attribute(joint, "child", "link")) for joint in on_tree}
        waiting = [joint for joint in waiting if joint not in on_tree]
    if waiting:
        loop = ", ".join(str(joint.get("name")) for joint in waiting)
        off = ", ".join(name for name in links if name not in reached)
        raise ConfigError(f"joint {loop}", f"a loop of {off}", f"a tree of links from {roots[0]}")
    return roots[0]


def check(robot: ElementTree.Element, joints: Mapping[str, ElementTree.Element]) -> None:
    """Check every number that is read of joints and inertias; those of shapes are not looked at.

    Raises:
        ConfigError: Naming the joint or link; the reader drops an inertia that it cannot read.
    """
    for name, joint in joints.items():
        if joint.get("type") != "fixed":
            _check_limits(name, joint)
    for link in robot.findall("link"):
        _check_inertia(f"link {link.get('name')}", link.find("inertial"))
    for name, joint in joints.items():
        _check_joint(f"joint {name}", joint)


def _check_limits(name: str, joint: ElementTree.Element) -> None:
    """Raise ``ConfigError`` where limits are missing or none that a joint can have."""
    for key in ("effort", "velocity"):  # what Pinocchio's reader wants of a mimic joint too
        if attribute(joint, "limit", key) is None:
            raise ConfigError(
                f"joint {name}: limit {key}", None,
                'a finite number, as in <limit effort="20" velocity="3"/>',
            )  # fmt: skip
    effort = read_number(name, joint, "limit", "effort")
    # A mimic joint is no joint of the arm, but Pinocchio's reader wants its limits.
    if effort <= 0 and joint.find("mimic") is None:
        raise ConfigError(f"joint {name}: limit effort", effort, "more than 0 N·m or N")
    if joint.get("type") == "continuous":
        return
    lower, upper = (read_number(name, joint, "limit", key, 0.0) for key in ("lower", "upper"))
    if lower >= upper:
        raise ConfigError(f"joint {name}: limit lower", lower, f"less than upper ({upper:g})")


def _check_inertia(where: str, inertial: ElementTree.Element | None) -> None:
    """Raise ``ConfigError`` for a mass or a moment of inertia that is none.

    Whether a body can have the tensor is not asked: many files have roughly rounded ones.
    """
    if inertial is None:
        return
    for tag, keys in (("mass", ("value",)), ("inertia", _INERTIA)):
        for key in keys:
            text = attribute(inertial, tag, key)
            value = _numbers(f"{where}: inertial {tag} {key}", text, 1)[0]
            if tag == "mass" and value < 0:
                raise ConfigError(f"{where}: inertial mass", value, "0 kg or more")
            if key in _MOMENTS and value < -_ROUNDED:
                raise ConfigError(f"{where}: inertial inertia {key}", value, "0 kg·m^2 or more")
    _check_origin(f"{where}: inertial", inertial)


def _check_joint(where: str, joint: ElementTree.Element) -> None:
    """Raise ``ConfigError`` for a number of a joint that is none, or no axis."""
    for tag, keys in _OF_JOINTS.items():
        for key in keys:
            text = attribute(joint, tag, key)
            if text is not None:
                (value,) = _finite(f"{where}: {tag} {key}", text, 1)
                if tag == "dynamics" and value < 0.0:
                    raise ConfigError(f"{where}: {tag} {key}", value, "0 or more")
    mimic = joint.find("mimic")
    if mimic is not None and not mimic.get("joint"):
        raise ConfigError(f"{where}: mimic joint", mimic.get("joint"), "the joint that it follows")
    _check_origin(where, joint)
    axis = attribute(joint, "axis", "xyz")
    # A fixed joint has none, whatever the file says: exporters write 0.
    if axis is None or joint.get("type") == "fixed":
        return
    length = np.hypot.reduce(_finite(f"{where}: axis", axis, 3))
    if not length:
        raise ConfigError(f"{where}: axis", axis, "a direction that is not zero")
    if not _SHORTEST <= length <= _LONGEST:
        raise ConfigError(
            f"{where}: axis", axis, f"a direction of length {_SHORTEST:g} to {_LONGEST:g}"
        )


def _check_origin(where: str, element: ElementTree.Element) -> None:
    for key in ("xyz", "rpy"):
        text = attribute(element, "origin", key)
        if text is not None:
            _numbers(f"{where} origin {key}", text, 3)


def dynamics(robot: ElementTree.Element) -> str:
    """Return a checked URDF's text without shapes, its numbers as every reader takes them.

    Where a blank ends a number, or a tab parts two, Pinocchio's reader leaves out the inertia that
    they are in, and the link weighs nothing.
    """
    robot = deepcopy(robot)
    elements = robot.findall("joint")
    for link in robot.findall("link"):
        for shape in (*link.findall("visual"), *link.findall("collision")):
            link.remove(shape)
        elements += link.findall("inertial")
    for element in elements:
        for part in element:
            for key, text in part.items():
                if key in _NAMES:
                    continue
                with suppress(ValueError):  # what nobody checks, as nobody reads it
                    part.set(key, " ".join(repr(float(word)) for word in text.split()))
    return ElementTree.tostring(robot, encoding="unicode")


def attribute(element: ElementTree.Element, tag: str, key: str) -> str | None:
    """Return an attribute of the first of an element's parts with a tag, if there is one."""
    part = element.find(tag)
    return None if part is None else part.get(key)


def read_number(
    name: str, joint: ElementTree.Element, tag: str, key: str, default: float | None = None
) -> float:
    """Return a number of a joint's tag; ``default`` where it is not given.

    Raises:
        ConfigError: It is none that an arm can have.
    """
    text = attribute(joint, tag, key)
    if text is None and default is not None:
        return default
    return _numbers(f"joint {name}: {tag} {key}", text, 1)[0]


def _numbers(field: str, text: str | None, count: int) -> list[float]:
    values = _finite(field, text, count)
    check_range(field, values)
    return values


def _finite(field: str, text: str | None, count: int) -> list[float]:
    try:
        values = [float(word) for word in (text or "").split()]
    except ValueError:
        values = []
    if len(values) != count or not np.isfinite(values).all():
        raise ConfigError(
            field, text, "a finite number" if count == 1 else f"{count} finite numbers"
        )
    return values
