"""Reading an arm from a URDF. Pinocchio reads it once ``urdf_file`` has looked at it.

Every moving joint's axis becomes z: its joint frame is the URDF's turned by the least angle, and
the URDF's own link frame is kept beside it (``Body.frame``).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from dvrk_gravity.arms.description import Body, Description, Joint
from dvrk_gravity.arms.limits import MOST_JOINTS
from dvrk_gravity.arms.plausible_effort import with_plausible_efforts
from dvrk_gravity.arms.urdf_file import (
    KINDS,
    PLACEHOLDER,
    XacroError,
    attribute,
    check,
    dynamics,
    expand,
    find_root,
    parse,
    read_joints,
    read_limits,
    read_number,
    stated_limit,
)
from dvrk_gravity.arms.urdf_inertia import inertia_warnings
from dvrk_gravity.arrays import Array
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import text_file
from dvrk_gravity.files.entries import check_count

_Z = np.array([0.0, 0.0, 1.0])


def read(path: Path, tip: str | None, source: str) -> Description:
    """Return the arm in a URDF; see :meth:`Arm.from_urdf`.

    Raises:
        ConfigError: Naming the file, the joint or link, and what was expected.
    """
    robot = read_robot(path)
    try:
        return replace(_parse(robot, path.stem, tip, source), urdf=str(path))
    except ConfigError as error:
        raise error if error.source else error.in_file(path) from None


def read_robot(path: Path) -> ElementTree.Element:
    """Return the robot in a URDF, xacro expanded.

    Raises:
        ConfigError: Naming the file, and what was expected.
    """
    text = text_file.read(path, "URDF")
    try:
        try:
            return parse(text)
        except XacroError as found:
            return parse(expand(path, found))
    except ConfigError as error:
        raise error if error.source else error.in_file(path) from None


def _parse(robot: ElementTree.Element, name: str, tip: str | None, source: str) -> Description:
    described = read_joints(robot)
    root = find_root(robot, described)
    moving = {name: joint for name, joint in described.items() if joint.get("type") != "fixed"}
    chain = set(moving) if tip is None else _chain(described, root, tip)
    check_count("joint", len(chain), MOST_JOINTS)
    check(robot, described, chain)
    try:
        model = pin.buildModelFromXML(dynamics(robot))
    except ValueError as error:
        raise ConfigError("", "what Pinocchio cannot read", "a URDF") from error
    model = _hold_joints(model, set(moving) - chain)
    names = [name for name in model.names[1:] if moving[name].find("mimic") is None]
    if not names:
        raise ConfigError("joint", f"none of {len(described)} that moves", "at least one")
    rows = _rows(moving, names, [*model.names[1:]])
    joints = tuple(_joint(name, moving[name]) for name in names)
    bodies, parameters = _bodies(model, moving, rows)
    limits = np.array([joint.effort_limit for joint in joints])
    weighs = bool(parameters[:, 0].max() > PLACEHOLDER)
    arm = Description(
        robot.get("name") or name, joints, bodies, np.eye(len(joints)), limits,
        inertial_parameters=parameters if weighs else None, source=source,
        merged=_merged_links(model, bodies),
        warnings=tuple(inertia_warnings(robot, described, chain)) if weighs else (),
    )  # fmt: skip
    return with_plausible_efforts(arm)


def _chain(joints: Mapping[str, ElementTree.Element], root: str, tip: str) -> set[str]:
    """Return the joints between the root and a link."""
    above = {str(attribute(joint, "child", "link")): name for name, joint in joints.items()}
    if tip != root and tip not in above:
        raise ConfigError("tip", tip, f"a link: {', '.join(above)}")
    chain = set()
    while tip != root:
        chain.add(above[tip])
        tip = str(attribute(joints[above[tip]], "parent", "link"))
    return chain


def _joint(name: str, joint: ElementTree.Element) -> Joint:
    effort, velocity = (stated_limit(name, joint, key) for key in ("effort", "velocity"))
    damping, friction = (
        read_number(name, joint, "dynamics", key, 0.0) for key in ("damping", "friction")
    )
    lower, upper = read_limits(name, joint)
    ends = (float(attribute(joint, "limit", key) or 0.0) for key in ("lower", "upper"))
    range_given = joint.get("type") == "continuous" or any(ends)
    return Joint(
        name, lower, upper, effort or np.inf, KINDS[str(joint.get("type"))],
        damping=damping, friction=friction, velocity_limit=velocity or np.inf,
        range_stated=range_given, effort_stated=effort is not None,
    )  # fmt: skip


def _hold_joints(model: pin.Model, names: set[str]) -> pin.Model:
    """Return the model with some joints held at zero, or as near as their limits let them."""
    held = [i for i in range(1, model.njoints) if model.names[i] in names]
    if not held:
        return model
    q = pin.neutral(model)
    for i in held:
        joint = model.joints[i]
        if joint.nq == 1:  # else one without stops, or of a base that moves about
            at = joint.idx_q
            q[at] = np.clip(q[at], model.lowerPositionLimit[at], model.upperPositionLimit[at])
    return pin.buildReducedModel(model, held, q)


def _rows(
    moving: Mapping[str, ElementTree.Element], names: list[str], wanted: list[str]
) -> dict[str, tuple[Array, float]]:
    """Return every joint's position as a combination of the arm's joints and a constant."""
    rows: dict[str, tuple[Array, float]] = {}
    for name in wanted:
        factor, constant, at, seen = 1.0, 0.0, name, [name]
        while (mimic := moving[at].find("mimic")) is not None:
            step, shift = (
                read_number(at, moving[at], "mimic", key, default)
                for key, default in (("multiplier", 1.0), ("offset", 0.0))
            )
            constant += factor * shift
            factor *= step
            master = str(mimic.get("joint"))
            if master not in moving:
                raise ConfigError(f"joint {at}: mimic", master, "a joint that moves")
            if master in seen:
                raise ConfigError(
                    f"joint {name}: mimic", f"a loop: {', '.join([*seen, master])}", "a joint"
                )
            at = master
            seen.append(at)
        if at not in names:
            raise ConfigError(f"joint {name}: mimic", at, "a joint that leads to the tip")
        rows[name] = (factor * np.eye(len(names))[names.index(at)], constant)
    return rows


def _bodies(
    model: pin.Model,
    moving: Mapping[str, ElementTree.Element],
    rows: Mapping[str, tuple[Array, float]],
) -> tuple[tuple[Body, ...], Array]:
    """Return the bodies with their joints' axes along z, and their inertial parameters."""
    bodies: list[Body] = []
    parameters = []
    for i in range(1, model.njoints):
        name = model.names[i]
        kind = KINDS[str(moving[name].get("type"))]
        row, constant = rows[name]
        subspace = model.joints[i].createData().S.reshape(6)
        turn = pin.SE3(
            _rotation_onto(subspace[3:] if kind == "revolute" else subspace[:3]), np.zeros(3)
        )
        parent = model.parents[i] - 1
        before = bodies[parent].frame if parent >= 0 else pin.SE3.Identity()
        if kind == "revolute":
            shift = pin.SE3(pin.utils.rotate("z", constant), np.zeros(3))
        else:
            shift = pin.SE3(np.eye(3), constant * _Z)
        link = str(attribute(moving[name], "child", "link"))
        placement = before * model.jointPlacements[i] * turn * shift
        bodies.append(Body(link, parent, placement, kind, row, turn.inverse()))
        parameters.append(turn.actInv(model.inertias[i]).toDynamicParameters())
    return tuple(bodies), np.array(parameters)


def _merged_links(model: pin.Model, bodies: tuple[Body, ...]) -> dict[str, tuple[int, pin.SE3]]:
    """Return the links that are no bodies' own: on which body they are, and where."""
    own = [body.name for body in bodies]
    return {
        frame.name: (frame.parentJoint - 1, pin.SE3(frame.placement))
        for frame in model.frames
        if frame.type == pin.FrameType.BODY and frame.name not in own
    }


def _rotation_onto(axis: Array) -> Array:
    """Return the rotation (3, 3) by the least angle whose z axis is a unit vector."""
    if axis[2] <= -1.0 + 1e-12:
        return np.diag([1.0, -1.0, -1.0])
    return np.asarray(pin.Quaternion.FromTwoVectors(_Z, axis).toRotationMatrix())
