"""Reading an arm from a URDF. Pinocchio reads it; what it would not say clearly is checked before.

Every moving joint's axis becomes z: its joint frame is the URDF's turned by the least angle, and
the URDF's own link frame is kept beside it (``Body.frame``).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from dvrk_gravity.arms.description import Array, Body, Description, Joint, JointKind
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import text_file

_KINDS: dict[str, JointKind] = {
    "revolute": "revolute",
    "continuous": "revolute",
    "prismatic": "prismatic",
}
_TYPES = (*_KINDS, "fixed")
_INERTIA = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_Z = np.array([0.0, 0.0, 1.0])


def read(path: Path, tip: str | None, source: str) -> Description:
    """Return the arm in a URDF; see :meth:`Arm.from_urdf`.

    Raises:
        ConfigError: Naming the file, the joint or link, and what was expected.
    """
    text = text_file.read(path, "URDF")
    try:
        return _parse(text, tip, source)
    except ConfigError as error:
        raise error if error.source else error.in_file(path) from None


def _parse(text: str, tip: str | None, source: str) -> Description:
    if "<!DOCTYPE" in text:  # entities: nothing that a robot needs, and some are bombs
        raise ConfigError("", "a document type", "a URDF: XML without one")
    try:
        robot = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise ConfigError("", str(error), "a URDF: XML with a robot in it") from error
    if robot.tag != "robot" or not robot.get("name"):
        raise ConfigError("", f"<{robot.tag}>", 'a URDF: <robot name="…">')
    described = _joints(robot)
    root = _root(robot, described)
    chain = None if tip is None else _chain(described, root, tip)
    moving = {name: joint for name, joint in described.items() if joint.get("type") != "fixed"}
    for name in moving:
        _check(name, moving[name])
    _check_numbers(robot)
    try:
        model = pin.buildModelFromXML(text)
    except ValueError as error:
        raise ConfigError("", "what Pinocchio cannot read", "a URDF") from error
    model = _held(model, {name for name in moving if chain is not None and name not in chain})
    names = [name for name in model.names[1:] if moving[name].find("mimic") is None]
    if not names:
        raise ConfigError("joint", f"none of {len(described)} that moves", "at least one")
    rows = _rows(moving, names, [*model.names[1:]])
    joints = tuple(_joint(name, moving[name]) for name in names)
    bodies, parameters = _bodies(model, moving, rows)
    limits = np.array([joint.effort_limit for joint in joints])
    return Description(
        str(robot.get("name")), joints, bodies, np.eye(len(joints)), limits,
        inertial_parameters=parameters, source=source,
    )  # fmt: skip


def _joints(robot: ElementTree.Element) -> dict[str, ElementTree.Element]:
    """Return the joints by name; those of ``<transmission>`` and other tags are none."""
    links = [link.get("name") for link in robot.findall("link")]
    joints: dict[str, ElementTree.Element] = {}
    for joint in robot.findall("joint"):
        name = joint.get("name")
        if not name or name in joints:
            raise ConfigError("joint", name, "a name that no other joint has")
        if joint.get("type") not in _TYPES:
            raise ConfigError(f"joint {name}: type", joint.get("type"), f"{', '.join(_TYPES)}")
        for end in ("parent", "child"):
            if _attribute(joint, end, "link") not in links:
                raise ConfigError(
                    f"joint {name}: {end}", _attribute(joint, end, "link"), "a link of the file"
                )
        joints[name] = joint
    return joints


def _root(robot: ElementTree.Element, joints: Mapping[str, ElementTree.Element]) -> str:
    children = [str(_attribute(joint, "child", "link")) for joint in joints.values()]
    for child in children:
        if children.count(child) > 1:
            raise ConfigError(f"link {child}", "the child of two joints", "a tree of links")
    roots = [str(link.get("name")) for link in robot.findall("link")]
    roots = [name for name in roots if name not in children]
    if len(roots) != 1:
        raise ConfigError("link", roots, "one link that is no joint's child")
    return roots[0]


def _chain(joints: Mapping[str, ElementTree.Element], root: str, tip: str) -> set[str]:
    """Return the joints between the root and a link."""
    above = {str(_attribute(joint, "child", "link")): name for name, joint in joints.items()}
    if tip != root and tip not in above:
        raise ConfigError("tip", tip, f"a link: {', '.join(above)}")
    chain = set()
    while tip != root:
        name = above[tip]
        if name in chain:
            raise ConfigError(f"joint {name}", "a loop", "a tree of links")
        chain.add(name)
        tip = str(_attribute(joints[name], "parent", "link"))
    return chain


def _check(name: str, joint: ElementTree.Element) -> None:
    """Raise ``ConfigError`` where limits are missing or none that a joint can have."""
    effort = _float(name, joint, "limit", "effort")
    # A mimic joint is no joint of the arm, but Pinocchio's reader wants its limits.
    if effort <= 0 and joint.find("mimic") is None:
        raise ConfigError(f"joint {name}: limit effort", effort, "more than 0 N·m or N")
    _float(name, joint, "limit", "velocity")
    if joint.get("type") == "continuous":
        return
    lower, upper = (_float(name, joint, "limit", key, 0.0) for key in ("lower", "upper"))
    if lower >= upper:
        raise ConfigError(f"joint {name}: limit lower", lower, f"less than upper ({upper:g})")


def _check_numbers(robot: ElementTree.Element) -> None:
    """Raise ``ConfigError`` for a number that is none: the reader drops an inertia it cannot read.

    Every place, axis and inertia is looked at, those of shapes are not.
    """
    for link in robot.findall("link"):
        where, inertial = f"link {link.get('name')}", link.find("inertial")
        if inertial is None:
            continue
        for tag, keys in (("mass", ("value",)), ("inertia", _INERTIA)):
            for key in keys:
                text = _attribute(inertial, tag, key)
                value = _numbers(f"{where}: inertial {tag} {key}", text, 1)[0]
                if tag == "mass" and value < 0:
                    raise ConfigError(f"{where}: inertial mass", value, "0 kg or more")
        _check_origin(f"{where}: inertial", inertial)
    for joint in robot.findall("joint"):
        where = f"joint {joint.get('name')}"
        _check_origin(where, joint)
        axis = _attribute(joint, "axis", "xyz")
        if joint.get("type") == "fixed":  # it has none, whatever the file says: exporters write 0
            continue
        if axis is not None and not any(_numbers(f"{where}: axis", axis, 3)):
            raise ConfigError(f"{where}: axis", axis, "a direction that is not zero")


def _check_origin(where: str, element: ElementTree.Element) -> None:
    for key in ("xyz", "rpy"):
        text = _attribute(element, "origin", key)
        if text is not None:
            _numbers(f"{where} origin {key}", text, 3)


def _numbers(field: str, text: str | None, count: int) -> list[float]:
    try:
        values = [float(word) for word in (text or "").split()]
    except ValueError:
        values = []
    if len(values) != count or not np.isfinite(values).all():
        raise ConfigError(
            field, text, "a finite number" if count == 1 else f"{count} finite numbers"
        )
    return values


def _joint(name: str, joint: ElementTree.Element) -> Joint:
    effort = _float(name, joint, "limit", "effort")
    if joint.get("type") == "continuous":
        return Joint(name, -np.inf, np.inf, effort)
    lower, upper = (_float(name, joint, "limit", key, 0.0) for key in ("lower", "upper"))
    return Joint(name, lower, upper, effort, _KINDS[str(joint.get("type"))])


def _held(model: pin.Model, names: set[str]) -> pin.Model:
    """Return the model with some joints held at zero, or as near as their limits let them."""
    held = [i for i in range(1, model.njoints) if model.names[i] in names]
    if not held:
        return model
    q = pin.neutral(model)
    for i in held:
        joint = model.joints[i]
        if joint.nq == 1:
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
                _float(at, moving[at], "mimic", key, default)
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
        kind = _KINDS[str(moving[name].get("type"))]
        row, constant = rows[name]
        subspace = model.joints[i].createData().S.reshape(6)
        turn = pin.SE3(_onto(subspace[3:] if kind == "revolute" else subspace[:3]), np.zeros(3))
        parent = model.parents[i] - 1
        before = bodies[parent].frame if parent >= 0 else pin.SE3.Identity()
        if kind == "revolute":
            shift = pin.SE3(pin.utils.rotate("z", constant), np.zeros(3))
        else:
            shift = pin.SE3(np.eye(3), constant * _Z)
        link = str(_attribute(moving[name], "child", "link"))
        placement = before * model.jointPlacements[i] * turn * shift
        bodies.append(Body(link, parent, placement, kind, row, turn.inverse()))
        parameters.append(turn.actInv(model.inertias[i]).toDynamicParameters())
    return tuple(bodies), np.array(parameters)


def _onto(axis: Array) -> Array:
    """Return the rotation (3, 3) by the least angle whose z axis is a unit vector."""
    if axis[2] <= -1.0 + 1e-12:
        return np.diag([1.0, -1.0, -1.0])
    return np.asarray(pin.Quaternion.FromTwoVectors(_Z, axis).toRotationMatrix())


def _attribute(joint: ElementTree.Element, tag: str, key: str) -> str | None:
    element = joint.find(tag)
    return None if element is None else element.get(key)


def _float(
    name: str, joint: ElementTree.Element, tag: str, key: str, default: float | None = None
) -> float:
    """Return a number of a joint's tag; ``default`` where it is not given."""
    text = _attribute(joint, tag, key)
    if text is None and default is not None:
        return default
    return _numbers(f"joint {name}: {tag} {key}", text, 1)[0]
