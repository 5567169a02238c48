"""What a URDF must hold, checked before Pinocchio reads it; xacro expanded first."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from contextlib import suppress
from copy import deepcopy
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from dvrk_gravity.arms.description import JointKind
from dvrk_gravity.arms.limits import check_range, check_travel
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files.entries import check_count

KINDS: dict[str, JointKind] = {
    "revolute": "revolute",
    "continuous": "revolute",
    "prismatic": "prismatic",
}
_TYPES = (*KINDS, "fixed")
# Of a base that moves about: such a joint may be in the file, but not in the arm.
_FREE = ("floating", "planar")
_STATED = ("effort", "velocity")
INERTIA = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_NAMES = ("link", "joint", "name")
# Numbers of joints that Pinocchio's reader stops at where they are none, used or not.
_OF_JOINTS = {
    "mimic": ("multiplier", "offset"),
    "dynamics": ("damping", "friction"),
    "safety_controller": ("soft_lower_limit", "soft_upper_limit", "k_position", "k_velocity"),
    "calibration": ("rising", "falling"),
}
# Chosen: an axis is written as a unit vector, or as a difference of points in m or mm. Pinocchio's
# reader takes one whose square is no number of its own for z.
_SHORTEST, _LONGEST = 1e-3, 1e3
# Of the elements of a file, and of their levels. Chosen: a humanoid has 300 links, and a link's
# parts are four levels deep; each level takes one of the C stack where a copy is made.
_MOST_LINKS, _DEEPEST = 2000, 50
# kg: links of a file for pictures alone weigh nothing, or what a reader wants at least.
PLACEHOLDER = 1e-3
# The limit that SDF's readers write where a joint has none.
_NO_LIMIT = 1e16


def parse(text: str) -> ElementTree.Element:
    """Return the robot of a URDF's text.

    Raises:
        XacroError: It is one that xacro has yet to expand.
        ConfigError: It is none.
    """
    if "<!DOCTYPE" in text:  # entities: nothing that a robot needs, and some are bombs
        raise ConfigError("", "a document type", "a URDF: XML without one")
    try:
        robot = ElementTree.XML(text, ElementTree.XMLParser(target=_ShallowTree()))
    except (ElementTree.ParseError, ValueError) as error:
        if "<xacro:" in text:  # its namespace may be missing
            raise _of_xacro("<xacro:…>") from error
        raise ConfigError("", str(error), "a URDF: XML with one robot in it") from error
    _check_expanded(robot)
    if robot.tag != "robot":
        raise ConfigError("", f"<{robot.tag}>", 'a URDF: <robot name="…">')
    return robot


class _ShallowTree(ElementTree.TreeBuilder):
    """Builds a tree of a bounded depth."""

    def __init__(self) -> None:
        super().__init__()
        self._depth = 0

    def start(self, tag: str, attrs: dict[str, str]) -> ElementTree.Element:
        self._depth += 1
        if self._depth > _DEEPEST:
            raise ConfigError(f"<{tag}>", "deeper nesting", f"at most {_DEEPEST} levels")
        return super().start(tag, attrs)

    def end(self, tag: str) -> ElementTree.Element:
        self._depth -= 1
        return super().end(tag)


def _check_expanded(robot: ElementTree.Element) -> None:
    """Raise ``XacroError`` for what is left of xacro: its tags, and what it fills in.

    Shapes, and what simulators and drivers read, are not looked at.
    """
    for part in robot:
        read = [*part.iter()] if part.tag == "joint" else [part]
        if part.tag == "link":
            read += [element for inertial in part.findall("inertial") for element in inertial]
        for element in (*read, *part):
            space, _, tag = str(element.tag).rpartition("}")
            if space.endswith("xacro"):
                raise _of_xacro(f"<xacro:{tag}>")
        for element in read:
            for key, value in element.items():
                if "${" in value or "$(" in value:
                    raise _of_xacro(f'<{element.tag} {key}="{value}">')


def _of_xacro(found: str) -> XacroError:
    return XacroError("", found, "a URDF without xacro")


def read_joints(robot: ElementTree.Element) -> dict[str, ElementTree.Element]:
    """Return the joints by name; those of ``<transmission>`` and other tags are none.

    Raises:
        ConfigError: A name that is missing or taken, a type or a link that there is not.
    """
    for tag in ("link", "joint"):
        check_count(tag, len(robot.findall(tag)), _MOST_LINKS)
    links = _links(robot)
    joints: dict[str, ElementTree.Element] = {}
    for joint in robot.findall("joint"):
        name = joint.get("name")
        if not name or name in joints:
            raise ConfigError("joint", name, "a name that no other joint has")
        if joint.get("type") not in (*_TYPES, *_FREE):
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
    if not links:
        raise ConfigError("link", "none", "a URDF with links and joints")
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


def check(
    robot: ElementTree.Element, joints: Mapping[str, ElementTree.Element], arm: Collection[str]
) -> None:
    """Check every number that is read of joints and inertias; those of shapes are not looked at.

    Args:
        robot: The robot.
        joints: Its joints, by name.
        arm: Names of those that are not held.

    Raises:
        ConfigError: Naming the joint or link; the reader drops an inertia that it cannot read.
    """
    for name, joint in joints.items():
        if joint.get("type") != "fixed":
            _check_limits(name, joint, name in arm and joint.find("mimic") is None)
    for link in robot.findall("link"):
        _check_inertia(f"link {link.get('name')}", link.find("inertial"))
    for name, joint in joints.items():
        _check_joint(f"joint {name}", joint)


def read_limits(name: str, joint: ElementTree.Element) -> tuple[float, float]:
    """Return the lower and upper limit of a joint that moves.

    They are infinite where it has no stops, and where it turns and the file says of none: exporters
    write 0 to 0.
    """
    kind = joint.get("type")
    lower, upper = (_limit(name, joint, key) for key in ("lower", "upper"))
    none = lower == upper == 0.0 or min(-lower, upper) >= _NO_LIMIT
    if kind == "continuous" or (kind == "revolute" and none):
        return -math.inf, math.inf
    return lower, upper


def stated_limit(name: str, joint: ElementTree.Element, key: str) -> float | None:
    """Return the effort or velocity limit that a joint states.

    ``None`` where there is none, or none that a joint can have: exporters write 0, -1 or inf where
    none is stated.
    """
    value = _limit(name, joint, key)
    return value if 0.0 < value < math.inf else None


def _limit(name: str, joint: ElementTree.Element, key: str) -> float:
    """Return a limit, which may be infinite; 0 where there is none.

    Raises:
        ConfigError: It is no number, or a velocity or an effort that no arm has.
    """
    text = attribute(joint, "limit", key) or "0"
    if text.strip().lower().lstrip("+-") in ("inf", "infinity"):
        return float(text)
    (value,) = _finite(f"joint {name}: limit {key}", text, 1)
    if key in _STATED:
        check_range(f"joint {name}: limit {key}", [value])
    return value


def _check_limits(name: str, joint: ElementTree.Element, of_arm: bool) -> None:
    """Raise ``ConfigError`` where limits are none that a joint can have."""
    if joint.get("type") in _FREE:
        if of_arm:
            raise ConfigError(
                f"joint {name}: type", joint.get("type"),
                f"{', '.join(_TYPES)} (fixed, if the base stood still; or robot.urdf#LINK, for an "
                "arm that is not on it)",
            )  # fmt: skip
        return
    for key in _STATED:
        stated_limit(name, joint, key)
    lower, upper = read_limits(name, joint)
    slides = joint.get("type") == "prismatic"
    if math.isinf(lower) or (lower == upper == 0.0 and not of_arm):
        return
    endless = "" if slides else "; a joint without stops has type continuous"
    check_travel(f"joint {name}: limit ", lower, upper, "m" if slides else "rad", endless)


def _check_inertia(where: str, inertial: ElementTree.Element | None) -> None:
    """Raise ``ConfigError`` for a mass or a moment of inertia that is no number.

    Whether a body can have the tensor is not asked here: see ``urdf_inertia``.
    """
    if inertial is None:
        return
    for tag, keys in (("mass", ("value",)), ("inertia", INERTIA)):
        for key in keys if inertial.find(tag) is not None else ():
            text = attribute(inertial, tag, key)
            value = _numbers(f"{where}: inertial {tag} {key}", text, 1)[0]
            if tag == "mass" and value < 0:
                raise ConfigError(f"{where}: inertial mass", value, "0 kg or more")
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
    they are in, and the link weighs nothing. It wants a name, limits of every joint that moves, a
    mass and an inertia.
    """
    robot = deepcopy(robot)
    robot.set("name", robot.get("name") or "robot")
    elements = robot.findall("joint")
    for joint in elements:
        if joint.get("type") not in ("fixed", *_FREE):
            limit = _part(joint, "limit")
            # What is infinite, and what is read here and not by it, it need not understand.
            endless = [key for key, text in limit.items() if math.isinf(float(text))]
            for key in (*endless, *_STATED):
                limit.set(key, "0")
    for link in robot.findall("link"):
        for shape in (*link.findall("visual"), *link.findall("collision")):
            link.remove(shape)
        for inertial in link.findall("inertial"):
            for tag, keys in (("mass", ("value",)), ("inertia", INERTIA)):
                part = _part(inertial, tag)
                for key in keys:
                    part.set(key, part.get(key, "0"))
            elements.append(inertial)
    for element in elements:
        for part in element:
            for key, text in part.items():
                if key in _NAMES:
                    continue
                with suppress(ValueError):  # not read, so not checked
                    part.set(key, " ".join(repr(float(word)) for word in text.split()))
    return ElementTree.tostring(robot, encoding="unicode")


def _part(element: ElementTree.Element, tag: str) -> ElementTree.Element:
    """Return the first of an element's parts with a tag, a new one if there is none."""
    part = element.find(tag)
    return ElementTree.SubElement(element, tag) if part is None else part


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


class XacroError(ConfigError):
    """A URDF with something of xacro left in it; the attributes are ``ConfigError``'s."""


def expand(path: Path, found: XacroError) -> str:
    """Return the text of the URDF that xacro makes of a file, with all arguments' defaults.

    Args:
        path: The file.
        found: What is left of xacro in it.

    Raises:
        ConfigError: The package ``xacrodoc`` is not installed, or the file cannot be expanded.
    """
    name = path.name.removesuffix(".xacro")
    target = name if name != path.name else f"{path.stem}_expanded.urdf"
    by_hand = f"`xacro {path.name} > {target}`"
    try:
        from xacrodoc import XacroDoc
    except ImportError:
        expected = f"a URDF without xacro: {by_hand}, or `pip install xacrodoc`"
        raise ConfigError(found.field, found.value, expected, path) from None
    try:
        return str(XacroDoc.from_file(path).to_urdf_string())
    except Exception as error:  # the file's own expressions are run: anything may come of them
        expected = f"what xacro expands with the defaults of all arguments; else {by_hand}"
        raise ConfigError("", f"xacro's {type(error).__name__}: {error}", expected, path) from error
