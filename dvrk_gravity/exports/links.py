"""The tree that a file describes: bodies, the joints that move each, names, the base."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from dvrk_gravity.arms import Arm, gravity_in_base
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import links_of_joints
from dvrk_gravity.exports.form import FileModel

_SAME = 1e-9  # m/s^2, of a base that is mounted as the arm's file says


@dataclass(frozen=True)
class Axis:
    """One joint of the file: it turns a body about z, or slides it along z.

    Attributes:
        name: Its name.
        joint: Index of the arm's joint that it is, or follows.
        factor: Times that joint's position.
        own: Whether it is that joint.
    """

    name: str
    joint: int
    factor: float
    own: bool


@dataclass(frozen=True, eq=False)
class FileLink:
    """One body of the file.

    Attributes:
        name: Its name.
        parent: Index of the link that it is on, -1 for the base.
        placement: Its frame at zero, seen from its parent's.
        kind: Of its axes.
        axes: The joints that move it, one after another about the same axis; none if it is fixed.
    """

    name: str
    parent: int
    placement: pin.SE3
    kind: str
    axes: tuple[Axis, ...]


def links(file_model: FileModel) -> tuple[FileLink, ...]:
    """Return the links of an arm, zeros of the joints where encoders have them."""
    arm = file_model.arm
    own = _own_links(arm)
    names = set(arm.joint_names)
    found = []
    for index, body in enumerate(arm.bodies):
        axes = []
        # The joint itself first, so that its name is that of the axis next to the parent.
        joints = sorted(np.flatnonzero(body.row).tolist(), key=lambda joint: own[joint] != index)
        for joint in joints:
            if own[joint] == index:
                axes.append(Axis(arm.joint_names[joint], joint, 1.0, True))
                continue
            name = unused_name(f"{body.name}_{arm.joint_names[joint]}", names)
            names.add(name)
            axes.append(Axis(name, joint, float(body.row[joint]), False))
        shift = -float(body.row @ file_model.joint_offset)
        placement = body.placement * motion_along(body.kind, shift)
        found.append(FileLink(body.name, body.parent, placement, body.kind, tuple(axes)))
    return tuple(found)


def _own_links(arm: Arm) -> tuple[int, ...]:
    """Return the body that each joint moves with a coefficient of one."""
    whole = [np.flatnonzero(arm.expand[:, joint] == 1.0).tolist() for joint in range(arm.n)]
    return tuple(
        body if body in candidates else candidates[0]
        for body, candidates in zip(links_of_joints(arm), whole, strict=True)
    )


def motion_along(kind: str, way: float) -> pin.SE3:
    """Return the motion by a coordinate about z, rad, or along it, m."""
    if kind == "revolute":
        return pin.SE3(pin.utils.rotate("z", way), np.zeros(3))
    return pin.SE3(np.eye(3), np.array([0.0, 0.0, way]))


def unused_name(name: str, names: set[str] | Sequence[str]) -> str:
    """Return a name that is not among some."""
    while name in names:
        name += "_"
    return name


def mounting(file_model: FileModel) -> Array:
    """Return (3, 3) the base in a world with z up: as the arm's file has it, if gravity is so."""
    vector = file_model.gravity
    strength = float(np.linalg.norm(vector))
    if strength == 0.0:
        return np.eye(3)
    rpy = file_model.arm.base_rpy
    if np.abs(vector / strength - gravity_in_base(*rpy) / np.linalg.norm(gravity_in_base(*rpy))
              ).max() < _SAME:  # fmt: skip
        return np.asarray(pin.rpy.rpyToMatrix(*rpy))
    up = np.array([0.0, 0.0, 1.0])
    turn = pin.Quaternion.FromTwoVectors(-vector / strength, up)
    return np.asarray(turn.toRotationMatrix())
