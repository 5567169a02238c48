"""URDFs for the peers: the arm's own without meshes, or a chain from its DH table."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from dvrk_gravity.arms import Arm, nominal_inertias
from dvrk_gravity.arrays import Array
from testing import mujoco_arms

CHAIN = "URDF has no parallelograms: links of the open chain are not the arm's"


def write(arm: Arm, path: Path) -> str:
    """Write an arm as URDF in joint space; return why its links are not the arm's, if so."""
    source = arm.source.partition("#")[0]
    if source.endswith((".urdf", ".xml")):
        path.write_text(_without_meshes(arm, Path(source)))
        return ""
    path.write_text(_chain(arm))
    return CHAIN


def _without_meshes(arm: Arm, source: Path) -> str:
    """Return a URDF in which only the arm's joints move."""
    robot = ElementTree.parse(source).getroot()
    for link in robot.findall("link"):
        for part in (*link.findall("visual"), *link.findall("collision")):
            link.remove(part)
    for joint in robot.findall("joint"):
        for part in (*joint.findall("mimic"), *joint.findall("dynamics")):
            joint.remove(part)
        if joint.get("name") not in arm.joint_names:
            joint.set("type", "fixed")
    for part in (*robot.findall("transmission"), *robot.findall("gazebo")):
        robot.remove(part)
    return ElementTree.tostring(robot, encoding="unicode")


def _chain(arm: Arm) -> str:
    """Return the arm's serial chain; what follows it or two joints at once is left out."""
    rows, n = mujoco_arms.dh_table(arm.name), arm.n
    modified = arm.name in ("psm", "ecm")
    fixed = [mujoco_arms.along(r) if modified else mujoco_arms.fixed_part(r) for r in rows]
    try:
        stated = nominal_inertias(arm)
    except Exception:  # an arm whose file states no masses
        stated = {}
    text = ["<robot name='arm'><link name='base'/>"]
    for i, joint in enumerate(arm.joint_names):
        pose = fixed[i - 1] if i else np.eye(4)
        if modified:
            pose = pose @ mujoco_arms.about(rows[i])
        # A joint of ours turns at what its DH row puts before the link's own frame.
        xyz, rpy = pose[:3, 3], Rotation.from_matrix(pose[:3, :3]).as_euler("xyz")
        kind = "prismatic" if joint == "insertion" else "revolute"
        parent = f"link{i}" if i else "base"
        inertia = stated.get(f"link{i + 1}", _plausible(n - i))
        own = fixed[i]
        text.append(
            f"<link name='link{i + 1}'>{_inertial(inertia, own)}</link>"
            f"<joint name='{joint}' type='{kind}'><parent link='{parent}'/>"
            f"<child link='link{i + 1}'/><origin xyz='{_text(xyz)}' rpy='{_text(rpy)}'/>"
            f"<axis xyz='0 0 1'/><limit lower='{arm.lower[i]}' upper='{arm.upper[i]}' "
            f"effort='{arm.effort_limit[i]}' velocity='10'/></joint>"
        )
    return "".join([*text, "</robot>"])


def _plausible(after: int) -> pin.Inertia:
    """Return a link that nothing is known of: half a kilogram for the first, grams for the last."""
    mass = 0.08 * after
    return pin.Inertia(mass, np.array([0.0, 0.0, 0.02]), 1e-3 * mass * np.eye(3))


def _inertial(inertia: pin.Inertia, frame: Array) -> str:
    lever = (frame @ np.append(inertia.lever, 1.0))[:3]
    i = frame[:3, :3] @ inertia.inertia @ frame[:3, :3].T
    return (
        (
            f"<inertial><origin xyz='{_text(lever)}' rpy='0 0 0'/><mass value='{inertia.mass!r}'/>"
            f"<inertia ixx='{i[0, 0]!r}' ixy='{i[0, 1]!r}' ixz='{i[0, 2]!r}' iyy='{i[1, 1]!r}' "
            f"iyz='{i[1, 2]!r}' izz='{i[2, 2]!r}'/></inertial>"
        )
        .replace("np.float64(", "")
        .replace(")", "")
    )


def _text(values: Array) -> str:
    return " ".join(repr(float(value)) for value in values)
