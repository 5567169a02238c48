"""A model in a URDF's form as the text of one.

A link that follows joints has a mimic joint for each of them, one after another about one axis: a
PSM's first jaw turns with wrist_yaw and against half of jaw.
"""

from __future__ import annotations

import math
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import pinocchio as pin

from dvrk_gravity.arms import attribute
from dvrk_gravity.arrays import Array
from dvrk_gravity.exports.form import FileModel
from dvrk_gravity.exports.links import Axis, links, mounting, unused_name

_INERTIA = ("ixx", "ixy", "iyy", "ixz", "iyz", "izz")  # as in a row of inertial parameters
_TURNS = 4.0 * math.pi  # rad, beyond which readers take a range for degrees


def text(file_model: FileModel) -> str:
    """Return the URDF of a model in its form; link frames are joint frames, z along the axis."""
    arm = file_model.arm
    robot = Element("robot", name=arm.name)
    names = {*arm.body_names, *arm.joint_names}
    base = unused_name("base", names)
    SubElement(robot, "link", name=base)
    mount(robot, base, file_model)
    tree = links(file_model)
    for link, row in zip(tree, file_model.links, strict=True):
        parent, placement = base if link.parent < 0 else tree[link.parent].name, link.placement
        for place, axis in enumerate(link.axes):
            last = place == len(link.axes) - 1
            child = link.name if last else unused_name(axis.name, names)
            joint = SubElement(robot, "joint", name=axis.name)
            _ends(joint, parent, child, placement)
            SubElement(joint, "axis", xyz="0 0 1")
            _motion(joint, link.kind, axis, file_model)
            if not last:
                SubElement(robot, "link", name=child)
            parent, placement = child, pin.SE3.Identity()
        if not link.axes:
            joint = SubElement(robot, "joint", name=unused_name(link.name, names), type="fixed")
            _ends(joint, parent, link.name, placement)
        inertial(SubElement(robot, "link", name=link.name), row)
    return to_text(robot)


def mount(robot: Element, base: str, file_model: FileModel) -> None:
    """Put a base as it is mounted on a new link with z up, unless it is upright."""
    turn = mounting(file_model)
    if (turn == np.eye(3)).all():
        return
    names = {str(part.get("name")) for part in robot} | {*file_model.arm.body_names}
    world = unused_name("world", names)
    robot.insert(0, Element("link", name=world))
    joint = SubElement(robot, "joint", name=unused_name("mounting", names), type="fixed")
    _ends(joint, world, base, pin.SE3(turn, np.zeros(3)))


def to_text(robot: Element) -> str:
    """Return an XML document, indented."""
    ElementTree.indent(robot)
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(robot, encoding="unicode") + "\n"


def numbers(*values: float) -> str:
    """Return numbers as XML has them, to the last digit."""
    return " ".join(repr(float(value) + 0.0) for value in values)


def _ends(joint: Element, parent: str, child: str, placement: pin.SE3) -> None:
    SubElement(joint, "parent", link=parent)
    SubElement(joint, "child", link=child)
    origin(joint, placement)


def origin(element: Element, placement: pin.SE3) -> None:
    """Write where something is in its parent's frame."""
    found = element.find("origin")
    part = SubElement(element, "origin") if found is None else found
    part.set("xyz", numbers(*placement.translation))
    part.set("rpy", numbers(*pin.rpy.matrixToRpy(placement.rotation)))


def placement_of(element: Element) -> pin.SE3:
    """Return where something is in its parent's frame."""
    xyz, rpy = (
        np.array((attribute(element, "origin", key) or "0 0 0").split(), dtype=float)
        for key in ("xyz", "rpy")
    )
    return pin.SE3(pin.rpy.rpyToMatrix(*rpy), xyz)


def inertial(link: Element, row: Array) -> None:
    """Write a body's (10,) inertial parameters in its link's frame; nothing of one without mass."""
    for old in link.findall("inertial"):
        link.remove(old)
    mass = float(row[0])
    if mass <= 0.0:
        return
    body = pin.Inertia.FromDynamicParameters(row)
    part = SubElement(link, "inertial")
    SubElement(part, "origin", xyz=numbers(*body.lever), rpy="0 0 0")
    SubElement(part, "mass", value=numbers(mass))
    # Pinocchio's six: xx, xy, yy, xz, yz, zz.
    six = (body.inertia[i, j] for i, j in ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2)))
    SubElement(part, "inertia", dict(zip(_INERTIA, map(numbers, six), strict=True)))


def _motion(joint: Element, kind: str, axis: Axis, file_model: FileModel) -> None:
    """Write a joint's kind, limits and friction, or what it follows."""
    of = file_model.arm.joints[axis.joint]
    edges = sorted((axis.factor * of.lower, axis.factor * of.upper))
    ends = kind == "prismatic" or max(map(abs, edges)) <= _TURNS
    joint.set("type", kind if ends else "continuous")
    # 0 is what is not known.
    limit = {
        "effort": numbers(of.effort_limit if axis.own and math.isfinite(of.effort_limit) else 0.0),
        "velocity": numbers(
            abs(axis.factor) * of.velocity_limit if math.isfinite(of.velocity_limit) else 0.0
        ),
    }
    if ends:
        limit |= {"lower": numbers(edges[0]), "upper": numbers(edges[1])}
    SubElement(joint, "limit", limit)
    if axis.own:
        dynamics(joint, file_model, axis.joint)
    else:
        SubElement(joint, "mimic", joint=of.name, multiplier=numbers(axis.factor), offset="0.0")


def dynamics(joint: Element, file_model: FileModel, index: int) -> None:
    """Write the friction of the arm's joint of that index."""
    for old in joint.findall("dynamics"):
        joint.remove(old)
    damping, dry = file_model.dynamics.damping[0, index], file_model.dynamics.friction[0, index]
    SubElement(joint, "dynamics", damping=numbers(damping), friction=numbers(dry))
