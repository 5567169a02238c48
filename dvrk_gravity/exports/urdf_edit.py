"""A model in a URDF's form as its arm's own URDF with other numbers.

Links, joints, meshes and whatever else the file has stay; inertia, friction, zeros and the mounting
are the model's. What the arm does not move is fixed where the arm has it.
"""

from __future__ import annotations

import os
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from dvrk_gravity.arms import attribute, read_joints, read_limits, read_robot
from dvrk_gravity.exports import urdf
from dvrk_gravity.exports.form import FileModel


def is_editable(file_model: FileModel) -> bool:
    """Return whether the URDF of a model's arm is still there, and no joint of it is held."""
    arm = file_model.arm
    return bool(arm.urdf) and Path(arm.urdf).is_file() and not arm.held


def text(file_model: FileModel, folder: Path) -> str:
    """Return the URDF of a model, for a folder that meshes are found from.

    Raises:
        ConfigError: The file is no URDF any more.
    """
    arm, path = file_model.arm, Path(file_model.arm.urdf)
    robot = read_robot(path)
    joints = read_joints(robot)
    bodies = {
        body.name: (body, row) for body, row in zip(arm.bodies, file_model.links, strict=True)
    }
    for name, joint in joints.items():
        child = str(attribute(joint, "child", "link"))
        if joint.get("type") == "fixed":
            continue
        if child not in bodies:
            _fix(name, joint)
            continue
        body, _ = bodies[child]
        _shift(joint, -float(body.row @ file_model.joint_offset))
        if name in arm.joint_names:
            urdf.dynamics(joint, file_model, arm.joint_names.index(name))
    parents = {
        str(attribute(j, "child", "link")): str(attribute(j, "parent", "link"))
        for j in joints.values()
    }
    for link in robot.findall("link"):
        at = name = str(link.get("name"))
        if name in bodies:
            body, row = bodies[name]
            whole = pin.Inertia.FromDynamicParameters(row) if row[0] > 0.0 else pin.Inertia.Zero()
            urdf.inertial(link, body.frame.actInv(whole).toDynamicParameters())
            continue
        while at in parents and at not in bodies:
            at = parents[at]
        if at in bodies:  # rigidly on a body, which has its mass
            urdf.inertial(link, np.zeros(10))
    base = next(name for name in map(str, parents.values()) if name not in parents)
    urdf.mount(robot, base, file_model)
    for mesh in robot.iter("mesh"):
        file = mesh.get("filename", "")
        if file and "://" not in file and not Path(file).is_absolute():
            mesh.set("filename", os.path.relpath(path.parent / file, folder))
    return urdf.to_text(robot)


def _fix(name: str, joint: Element) -> None:
    """Fix a joint that is not the arm's at zero, or at the limit next to it."""
    if joint.get("type") in ("revolute", "prismatic"):
        _shift(joint, float(np.clip(0.0, *read_limits(name, joint))))
    joint.set("type", "fixed")
    for tag in ("axis", "limit", "mimic", "dynamics"):
        for part in joint.findall(tag):
            joint.remove(part)


def _shift(joint: Element, way: float) -> None:
    """Move the zero of a joint along its axis, rad or m."""
    if way == 0.0:
        return
    axis = np.array((attribute(joint, "axis", "xyz") or "1 0 0").split(), dtype=float)
    axis /= np.linalg.norm(axis)
    if joint.get("type") == "prismatic":
        step = pin.SE3(np.eye(3), way * axis)
    else:
        step = pin.SE3(pin.exp3(way * axis), np.zeros(3))
    urdf.origin(joint, urdf.placement_of(joint) * step)
