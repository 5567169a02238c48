"""A model in an MJCF's form as the text of one.

A link that follows joints has joints of its own that equality constraints couple to them; a motor
that moves several joints, and a spring between joints, is a fixed tendon.
"""

from __future__ import annotations

import math
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import pinocchio as pin

from dvrk_gravity.arrays import Array
from dvrk_gravity.exports.form import FileModel
from dvrk_gravity.exports.links import FileLink, links, mounting, unused_name
from dvrk_gravity.exports.urdf import numbers, to_text

# kg and kg·m^2. MuJoCo refuses moving bodies without either (mjMINVAL, 1e-15): what torque does not
# show at 1e-9 N·m.
_LEAST = 1e-11
# s: dry friction stops a joint within two steps of MuJoCo's default 2 ms, which is as stiff as it
# permits. Its default, 0.02, lets joints creep, and friction follow acceleration.
_STOPS_IN = 0.004
# A constant torque is a spring so soft and so long that its stiffness shows nowhere: its own torque
# per rad, relative to that constant.
_SOFT = 1e-12


def text(file_model: FileModel) -> str:
    """Return the MJCF of a model in its form; body frames are joint frames, z along the axis."""
    arm = file_model.arm
    root = Element("mujoco", model=arm.name)
    SubElement(root, "compiler", angle="radian", autolimits="true")
    SubElement(
        root, "option", gravity=numbers(0.0, 0.0, -float(np.linalg.norm(file_model.gravity)))
    )
    names = {*arm.body_names, *arm.joint_names}
    base = SubElement(SubElement(root, "worldbody"), "body", name=unused_name("base", names))
    _place(base, pin.SE3(mounting(file_model), np.zeros(3)))
    tree = links(file_model)
    bodies: list[Element] = []
    for link, row in zip(tree, file_model.links, strict=True):
        body = SubElement(base if link.parent < 0 else bodies[link.parent], "body", name=link.name)
        bodies.append(body)
        _place(body, link.placement)
        _inertial(body, row, bool(link.axes))
        for axis in link.axes:
            _joint(body, link, axis.name, axis.joint if axis.own else None, file_model)
    _couple_joints(root, tree, file_model)
    _tendons(root, file_model)
    actuators = SubElement(root, "actuator")
    for joint in arm.joints:
        motor = SubElement(actuators, "motor", name=joint.name, joint=joint.name)
        if joint.effort_stated and math.isfinite(joint.effort_limit):
            motor.set("ctrlrange", numbers(-joint.effort_limit, joint.effort_limit))
    return to_text(root)


def massless_links(file_model: FileModel) -> tuple[str, ...]:
    """Return the moving links to which the file gives the least mass, or inertia, there may be."""
    return tuple(
        link.name
        for link, row in zip(links(file_model), file_model.links, strict=True)
        if link.axes and _too_light(row)
    )


def _too_light(row: Array) -> bool:
    if row[0] < _LEAST:
        return True
    inertia = pin.Inertia.FromDynamicParameters(row).inertia
    return bool(np.linalg.eigvalsh(inertia)[0] < _LEAST)


def _place(body: Element, placement: pin.SE3) -> None:
    body.set("pos", numbers(*placement.translation))
    x, y, z, w = pin.Quaternion(placement.rotation).coeffs()
    body.set("quat", numbers(w, x, y, z))


def _inertial(body: Element, row: Array, moves: bool) -> None:
    mass, centre, inertia = 0.0, np.zeros(3), np.zeros((3, 3))
    if row[0] > 0.0:
        whole = pin.Inertia.FromDynamicParameters(row)
        mass, centre, inertia = float(row[0]), whole.lever, whole.inertia
    if moves and _too_light(row):
        mass, inertia = max(mass, _LEAST), inertia + _LEAST * np.eye(3)
    elif mass == 0.0:
        return
    six = (inertia[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
    SubElement(
        body, "inertial", pos=numbers(*centre), mass=numbers(mass), fullinertia=numbers(*six)
    )


def _joint(
    body: Element, link: FileLink, name: str, own: int | None, file_model: FileModel
) -> None:
    """Write a joint; one that follows others has nothing of its own."""
    kind = "hinge" if link.kind == "revolute" else "slide"
    joint = SubElement(body, "joint", name=name, type=kind, axis="0 0 1")
    if own is None:
        if len(link.axes) > 1:  # beside another about the same axis: one has to be felt
            joint.set("armature", numbers(_LEAST))
        return
    arm = file_model.arm
    lower, upper = float(arm.lower[own]), float(arm.upper[own])
    if math.isfinite(lower) and math.isfinite(upper):
        joint.set("range", numbers(lower, upper))
    dynamics = file_model.dynamics
    armature, damping, dry = (
        float(levels[0, own]) for levels in (dynamics.inertia, dynamics.damping, dynamics.friction)
    )
    if armature:
        joint.set("armature", numbers(armature))
    if damping:
        joint.set("damping", numbers(damping))
    if dry:
        joint.set("frictionloss", numbers(dry))
        joint.set("solreffriction", numbers(_STOPS_IN, 1.0))
    constant, stiffness = float(dynamics.constant[own]), float(dynamics.stiffness[own])
    if constant or stiffness:
        soft = stiffness or _SOFT * constant
        joint.set("stiffness", numbers(soft))
        joint.set("springref", numbers(-constant / soft))


def _couple_joints(root: Element, tree: tuple[FileLink, ...], file_model: FileModel) -> None:
    """Write the constraints of joints that follow others."""
    followers = [axis for link in tree for axis in link.axes if not axis.own]
    if not followers:
        return
    equality = SubElement(root, "equality")
    for axis in followers:
        SubElement(
            equality, "joint", joint1=axis.name, joint2=file_model.arm.joint_names[axis.joint],
            polycoef=numbers(0.0, axis.factor, 0.0, 0.0, 0.0),
        )  # fmt: skip


def _tendons(root: Element, file_model: FileModel) -> None:
    """Write motors that move several joints, and springs between joints."""
    arm, dynamics = file_model.arm, file_model.dynamics
    found: list[tuple[str, Array, dict[str, str]]] = []
    for index, name in enumerate(arm.joint_names):
        of_motor = {
            key: numbers(values[index])
            for key, (_, values) in (
                ("armature", dynamics.inertia),
                ("damping", dynamics.damping),
                ("frictionloss", dynamics.friction),
            )
            if values[index]
        }
        if "frictionloss" in of_motor:
            of_motor["solreffriction"] = numbers(_STOPS_IN, 1.0)
        if of_motor:
            found.append((f"{name}_motor", arm.joint_to_actuator[index], of_motor))
    sizes, ways = np.linalg.eigh(dynamics.coupling)
    for index, (size, way) in enumerate(zip(sizes.tolist(), ways.T, strict=True)):
        if abs(size) > 1e-12 * np.abs(sizes).max():
            of_spring = {"stiffness": numbers(size), "springlength": "0.0"}
            found.append((f"spring_{index + 1}", way, of_spring))
    if not found:
        return
    tendons = SubElement(root, "tendon")
    for name, row, values in found:
        tendon = SubElement(tendons, "fixed", {"name": name, **values})
        for joint, ratio in zip(arm.joint_names, row.tolist(), strict=True):
            if ratio:
                SubElement(tendon, "joint", joint=joint, coef=numbers(ratio))
