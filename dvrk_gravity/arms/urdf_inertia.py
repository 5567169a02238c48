"""What a URDF says of the masses of links that no link can have, or does not say."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np

from dvrk_gravity.arms.urdf_file import INERTIA, PLACEHOLDER, attribute
from dvrk_gravity.arrays import Array


@dataclass(frozen=True)
class InertiaSettings:
    """When an inertia counts as none that a body can have.

    Attributes:
        rounding: Part of the largest principal moment by which another may be below zero, or the
            two others together less than the largest. Chosen: what numbers of two digits leave.
            Of 1460 links of example-robot-data with masses, 3 are off by 0.001 to 0.08 and 70 by
            more.
        least: kg·m^2, that counts as none. Chosen: far below any link's (a gram at a mm), far above
            what rounding leaves: an iCub's file has moments of -5e-20.
        radius: Radius of gyration, m, beyond any link's: of an arm that reaches 2 m. Moments in
            kg·mm^2, kg·cm^2 or g·mm^2 are beyond.
    """

    rounding: float = 0.01
    least: float = 1e-12
    radius: float = 2.0


def inertia_warnings(
    robot: ElementTree.Element, joints: Mapping[str, ElementTree.Element], arm: Collection[str]
) -> Iterator[str]:
    """Yield a line for each link that joints move and whose masses are not to be believed.

    Args:
        robot: A checked robot.
        joints: Its joints, by name.
        arm: Names of those that are not held.
    """
    settings = InertiaSettings()
    carried_by = _rigid_groups(joints, arm)
    mass: dict[str, float] = {}
    for link in robot.findall("link"):
        name = str(link.get("name"))
        group = carried_by.get(name)
        if group is None:  # the base, which does not move
            continue
        inertial = link.find("inertial")
        weighs = _number(inertial, "mass", "value")
        mass[group] = mass.get(group, 0.0) + weighs
        if inertial is not None:
            yield from (f"link {name}: {text}" for text in _of_inertial(inertial, settings))
    if weightless := ", ".join(name for name, weighs in mass.items() if weighs <= PLACEHOLDER):
        yield f"no mass of {weightless}, which a joint moves (<inertial>): counted as weightless"


def _rigid_groups(
    joints: Mapping[str, ElementTree.Element], arm: Collection[str]
) -> dict[str, str]:
    """Return, for each link that moves, the link next to the joint that moves it rigidly."""
    above = {str(attribute(joint, "child", "link")): name for name, joint in joints.items()}

    def group(link: str) -> str | None:
        while link in above:
            joint = joints[above[link]]
            if joint.get("type") != "fixed" and above[link] in arm:
                return link
            link = str(attribute(joint, "parent", "link"))
        return None

    found = {link: group(link) for link in above}
    return {link: name for link, name in found.items() if name is not None}


def _of_inertial(inertial: ElementTree.Element, settings: InertiaSettings) -> Iterator[str]:
    """Yield what is wrong with an inertia that is written down."""
    if inertial.find("mass") is None:
        yield "<inertial> without <mass>: counted as weightless"
        return
    mass = _number(inertial, "mass", "value")
    if inertial.find("inertia") is None:
        yield "<inertial> without <inertia>: counted as a point mass"
        return
    if mass <= PLACEHOLDER:
        return
    # About the centre of mass; a rotation of its frame changes no principal moment.
    moments = np.linalg.eigvalsh(_tensor(inertial))
    least, middle, largest = moments.tolist()
    allowed = max(settings.rounding * max(abs(least), abs(largest)), settings.least)
    shown = ", ".join(f"{moment:.3g}" for moment in moments)
    why = ""
    if least < -allowed:
        why = "one is negative"
    elif largest - least - middle > allowed:
        why = "the largest is more than the two others together"
    elif (radius := np.sqrt(max(moments.sum(), 0.0) / (2.0 * mass))) > settings.radius:
        why = f"of {mass:g} kg they lie {radius:.3g} m from its centre; kg·m^2?"
    if why:
        yield f"an inertia that no body has, principal moments {shown} kg·m^2: {why}"


def _tensor(inertial: ElementTree.Element) -> Array:
    xx, xy, xz, yy, yz, zz = (_number(inertial, "inertia", key) for key in INERTIA)
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _number(inertial: ElementTree.Element | None, tag: str, key: str) -> float:
    return 0.0 if inertial is None else float(attribute(inertial, tag, key) or 0.0)
