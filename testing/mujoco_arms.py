"""Arms as MuJoCo has them, built from DH tables and URDFs without the package's tree."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from dvrk_gravity.arms import Arm, DHRow
from dvrk_gravity.arrays import Array
from dvrk_gravity.files import yaml_file
from dvrk_gravity.files.resources import config_path

SIDE = 0.1  # m, the short side of the master arms' parallelogram
CRANK_FRAME = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])  # in frame 3
ROBOTS = Path(pin.__file__).parents[4] / "share" / "example-robot-data" / "robots"
UR = ROBOTS / "ur_description" / "urdf"
PANDA = ROBOTS / "panda_description" / "urdf" / "panda.urdf"
KINOVA = ROBOTS / "kinova_description" / "robots" / "kinova.urdf"
FILES = {
    "chain": f"{Path(__file__).with_name('chain.yaml')}",  # turns, turns, slides, turns
    "ur5": f"{UR / 'ur5_robot.urdf'}",
    "ur10": f"{UR / 'ur10_robot.urdf'}",
    "panda": f"{PANDA}#panda_hand",  # its fingers are held
    "panda_gripper": f"{PANDA}",  # one finger slides, the other follows
    "kinova": f"{KINOVA}",  # three joints turn without an end
}
"""What is not shipped with the package."""


@dataclass(frozen=True, eq=False)
class MujocoArm:
    """An arm in MuJoCo, one joint a body.

    Attributes:
        model: The model.
        expand: (nv, n) matrix from the arm's joints to MuJoCo's.
        bodies: (n,) MuJoCo's number of the body that each joint of the arm moves.
        frames: (n, 4, 4) the link's own frame seen from that body's.
    """

    model: mujoco.MjModel
    expand: Array
    bodies: Array
    frames: Array

    @property
    def centres(self) -> Array:
        """(n, 3) centres of mass of the links, in their own frames, m."""
        centres = self.model.body_ipos[self.bodies]
        turned = np.linalg.inv(self.frames)
        return np.einsum("nij,nj->ni", turned[:, :3, :3], centres) + turned[:, :3, 3]

    def torque(self, q: Array, qd: Array, qdd: Array, gravity: ArrayLike | None = None) -> Array:
        """Return (N, n) efforts of a motion (N, n) by ``mj_inverse``, N·m or N.

        Args:
            q: Positions.
            qd: Velocities.
            qdd: Accelerations.
            gravity: (3,) m/s^2; ``None``: the model's.
        """
        engine, data = self.model, mujoco.MjData(self.model)
        known = engine.opt.gravity.copy()
        engine.opt.gravity[:] = known if gravity is None else gravity
        effort = np.empty((len(q), engine.nv))
        motion = (part @ self.expand.T for part in (q, qd, qdd))
        for row, (data.qpos, data.qvel, data.qacc) in enumerate(zip(*motion, strict=True)):
            mujoco.mj_inverse(engine, data)
            effort[row] = data.qfrc_inverse
        engine.opt.gravity[:] = known
        return effort @ self.expand

    def mass_matrix(self, q: Array) -> Array:
        """Return the (N, n, n) inertia at positions (N, n), rotors left out, kg·m^2 (kg)."""
        engine, data = self.model, mujoco.MjData(self.model)
        full, result = np.empty((engine.nv, engine.nv)), np.empty((len(q), *self.expand.T.shape))
        for row, data.qpos in enumerate(q @ self.expand.T):
            mujoco.mj_fwdPosition(engine, data)
            mujoco.mj_fullM(engine, data, full)
            result[row] = self.expand.T @ full
        return result @ self.expand

    def tip_jacobian(self, q: Array, point: ArrayLike) -> Array:
        """Return the (N, 3, n) velocity in the base of a point of the last link, m/rad (1).

        Args:
            q: (N, n) positions.
            point: (3,) in the last link's frame, m.
        """
        engine, data, body = self.model, mujoco.MjData(self.model), int(self.bodies[-1])
        at = (self.frames[-1] @ np.append(point, 1.0))[:3]
        turning, result = np.empty((3, engine.nv)), np.empty((len(q), 3, engine.nv))
        for row, data.qpos in enumerate(q @ self.expand.T):
            mujoco.mj_kinematics(engine, data)
            mujoco.mj_comPos(engine, data)
            tip = data.xpos[body] + data.xmat[body].reshape(3, 3) @ at
            mujoco.mj_jac(engine, data, result[row], turning, tip, body)
        return result @ self.expand

    def added(
        self, motion: tuple[Array, Array, Array], joint: int, mass: float, com: ArrayLike,
        inertia: float = 0.0,
    ) -> Array:  # fmt: skip
        """Return (N, n) the further efforts of what is fastened to a link.

        Args:
            motion: (N, n) positions, velocities and accelerations.
            joint: Whose link.
            mass: Of a point, kg.
            com: (3,) where it is in the link's frame, m.
            inertia: The same about any axis of the link, kg·m^2.
        """
        bare = self.torque(*motion)
        engine, body = self.model, int(self.bodies[joint])
        fields = (engine.body_mass, engine.body_ipos, engine.body_iquat, engine.body_inertia)
        known = [field[body].copy() for field in fields]
        point = (self.frames[joint] @ np.append(com, 1.0))[:3]
        held, at, quat, about = known
        total, centre, full = _combined(float(held), at, quat, about, mass, point)
        moments, axes = np.linalg.eigh(full + inertia * np.eye(3))
        axes[:, 2] *= np.linalg.det(axes)
        turned = np.roll(Rotation.from_matrix(axes).as_quat(), 1)
        for field, value in zip(fields, (total, centre, turned, moments), strict=True):
            field[body] = value
        _settle(engine)
        loaded = self.torque(*motion)
        for field, value in zip(fields, known, strict=True):
            field[body] = value
        _settle(engine)
        return loaded - bare


def arm_of(name: str) -> Arm:
    """Return an arm by its name: one of ``FILES``, or one that the package has."""
    return Arm.load(FILES.get(name, name))


def mtm(name: str, inertias: Mapping[str, pin.Inertia], gravity: ArrayLike) -> MujocoArm:
    """Return a master arm: the crank on link 1 by q2 + q3, the bar on the crank's tip.

    Args:
        name: ``mtml`` or ``mtmr``.
        inertias: Of its bodies, in the link frames.
        gravity: (3,) in the base frame, m/s^2.
    """
    table = dh_table(name)
    fixed = [fixed_part(row) for row in table]
    chain = ""
    for number in range(7, 1, -1):
        body = f"link{number}"
        chain = body_xml(body, fixed[number - 2], fixed[number - 1], inertias[body], chain)
    offset2, offset3 = table[1].offset, table[2].offset
    # At q2 = q3 = 0 the crank's x axis lies along the forearm's.
    upright = fixed[0] @ turn("z", offset2 + offset3)
    tip = shift(SIDE, 0, 0)
    crank_frame = np.eye(4)
    crank_frame[:3, :3] = turn("x", table[2].alpha)[:3, :3] @ CRANK_FRAME
    bar_pose = tip @ turn("z", -offset3)  # along the arm again
    bar = body_xml("bar", bar_pose, turn("z", np.pi), inertias["bar"], "")
    crank = body_xml("crank", upright, tip @ crank_frame, inertias["crank"], bar)
    whole = body_xml("link1", np.eye(4), fixed[0], inertias["link1"], chain + crank)
    model = _compiled(whole, gravity)
    expand = np.zeros((model.nv, 7))
    for number in range(1, 8):
        expand[model.joint(f"link{number}").dofadr[0], number - 1] = 1.0
    expand[model.joint("crank").dofadr[0], [1, 2]] = 1.0
    expand[model.joint("bar").dofadr[0], 2] = -1.0
    bodies = np.array([model.body(f"link{number}").id for number in range(1, 8)])
    return MujocoArm(model, expand, bodies, np.array(fixed))


def table(name: str, inertias: Mapping[str, pin.Inertia], gravity: ArrayLike) -> MujocoArm:
    """Return a chain from the DH table of its file, with the links that follow it.

    Args:
        name: One of ``FILES`` or of the package's arms.
        inertias: Of its bodies, in their frames.
        gravity: (3,) in the base frame, m/s^2.
    """
    content = _content(name)
    joints = content["joints"]
    rows, n = dh_table(name), len(joints)
    modified = content.get("convention") == "modified"
    fixed = [along(row) if modified else fixed_part(row) for row in rows]
    follow: dict[str, dict[str, float]] = {}
    links = [f"link{i + 1}" for i in range(n)]
    inner: dict[str, str] = {}  # what hangs on a body beside the chain
    # The last one first, for what it carries is part of what it hangs on.
    for link in reversed(content.get("followers", [])):
        body, parent = link["name"], link["parent"]
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_euler("xyz", link.get("rpy", [0, 0, 0]), True).as_matrix()
        pose[:3, 3] = link.get("xyz", [0, 0, 0])
        if parent in links:
            pose = fixed[links.index(parent)] @ pose
        carried = inner.pop(body, "")
        xml = body_xml(body, pose, np.eye(4), inertias[body], carried, _motion(link))
        inner[parent] = xml + inner.get(parent, "")
        follow[body] = link["follows"]
    chain = ""
    for i, body in reversed(list(enumerate(links))):
        pose = fixed[i - 1] if i else np.eye(4)
        if modified:
            pose = pose @ about(rows[i])
        carried = inner.get(body, "") + chain
        chain = body_xml(body, pose, fixed[i], inertias[body], carried, _motion(joints[i]))
        follow[body] = {joints[i]["name"]: 1.0, **joints[i].get("follows", {})}
    model = _compiled(inner.get("base", "") + chain, gravity)
    names = [joint["name"] for joint in joints]
    expand = np.zeros((model.nv, n))
    for body, factors in follow.items():
        for joint, factor in factors.items():
            expand[model.joint(body).dofadr[0], names.index(joint)] = factor
    bodies = np.array([model.body(link).id for link in links])
    return MujocoArm(model, expand, bodies, np.array(fixed))


def _motion(joint: Mapping[str, Any]) -> str:
    return "slide" if joint.get("type") == "prismatic" else "hinge"


def urdf(arm: Arm, factors: Sequence[float]) -> MujocoArm:
    """Return an arm as MuJoCo reads its URDF.

    Joints that are not the arm's are held at zero, but for those that mimic one of them by a factor
    alone.

    Args:
        arm: The arm, loaded from that URDF.
        factors: On mass and inertia of the bodies that MuJoCo makes of it, as far as there are.
    """
    robot = ElementTree.parse(arm.source.partition("#")[0]).getroot()
    for link in robot.findall("link"):  # without the meshes, which MuJoCo would want to open
        for part in (*link.findall("visual"), *link.findall("collision")):
            link.remove(part)
    follow = {name: (name, 1.0) for name in arm.joint_names}
    for joint in robot.findall("joint"):
        for part in joint.findall("mimic"):
            joint.remove(part)
            if part.get("joint") in arm.joint_names:
                factor = float(part.get("multiplier", 1.0))
                follow[str(joint.get("name"))] = str(part.get("joint")), factor
        if joint.get("name") not in follow:
            joint.set("type", "fixed")
    model = mujoco.MjModel.from_xml_string(ElementTree.tostring(robot, encoding="unicode"))
    model.opt.gravity[:] = arm.gravity
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS
    model.dof_damping[:] = model.dof_frictionloss[:] = 0.0
    model.jnt_limited[:] = 0
    expand, bodies = np.zeros((model.nv, arm.n)), np.zeros(arm.n, dtype=int)
    for name, (leader, factor) in follow.items():
        expand[model.joint(name).dofadr[0], arm.joint_names.index(leader)] = factor
    for i, name in enumerate(arm.joint_names):
        bodies[i] = model.jnt_bodyid[model.joint(name).id]
    for body, factor in zip(bodies, factors, strict=False):
        model.body_mass[body] *= factor
        model.body_inertia[body] *= factor
    _settle(model)
    return MujocoArm(model, expand, bodies, np.tile(np.eye(4), (arm.n, 1, 1)))


def dh_table(name: str) -> list[DHRow]:
    """Return the rows of an arm's file, given by its path or an arm's name, in rad and m."""
    return [
        DHRow(math.radians(row["alpha"]), row["a"], row["d"], math.radians(row["offset"]))
        for row in _content(name)["joints"]
    ]


def _content(name: str) -> dict[str, Any]:
    path = FILES.get(name, name)
    return yaml_file.load(path if path.endswith(".yaml") else config_path(f"arms/{path}.yaml"))


def turn(axis: str, angle: float) -> Array:
    """Return a 4 x 4 rotation."""
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_euler(axis, angle).as_matrix()
    return matrix


def shift(x: float, y: float, z: float) -> Array:
    """Return a 4 x 4 translation."""
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def fixed_part(row: DHRow) -> Array:
    """Return the distal frame seen from the joint's own at its zero.

    It is what DH puts after a rotation, or after a slide along the same axis.
    """
    return along(row) @ about(row)


def along(row: DHRow) -> Array:
    """Return what DH puts about and along the joint's axis; of a modified table that is all."""
    return turn("z", row.offset) @ shift(0, 0, row.d)


def about(row: DHRow) -> Array:
    """Return what DH puts along and about x, which a modified table has before the joint."""
    return shift(row.a, 0, 0) @ turn("x", row.alpha)


def body_xml(
    name: str, pose: Array, frame: Array, inertia: pin.Inertia, inner: str, kind: str = "hinge"
) -> str:
    """Return a body that moves about or along its z, with an inertia given in ``frame``."""
    rotation = frame[:3, :3]
    lever = frame @ np.append(inertia.lever, 1.0)
    i = rotation @ inertia.inertia @ rotation.T
    w_last = Rotation.from_matrix(pose[:3, :3]).as_quat()
    return (
        f'<body name="{name}" pos="{_text(pose[:3, 3])}" quat="{_text(np.roll(w_last, 1))}">'
        f'<joint name="{name}" type="{kind}" axis="0 0 1"/>'
        f'<inertial mass="{inertia.mass!r}" pos="{_text(lever[:3])}" fullinertia="'
        f'{_text(i[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]])}"/>{inner}</body>'
    )


def _text(values: Array) -> str:
    return " ".join(repr(float(value)) for value in values)


def _compiled(body: str, gravity: ArrayLike) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><compiler angle="radian"/><option gravity="{_text(np.asarray(gravity))}"/>'
        f"<worldbody>{body}</worldbody></mujoco>"
    )


def _settle(engine: mujoco.MjModel) -> None:
    """Let MuJoCo derive anew what follows from masses."""
    mujoco.mj_setConst(engine, mujoco.MjData(engine))


def _combined(
    mass: float, centre: Array, quat: Array, moments: Array, point: float, com: Array
) -> tuple[float, Array, Array]:
    """Return mass, centre and inertia about it of a body and a point, in the body's frame."""
    axes = Rotation.from_quat(np.roll(quat, -1)).as_matrix()
    total = mass + point
    middle = (mass * centre + point * com) / total
    full = axes @ np.diag(moments) @ axes.T
    for part, at in ((mass, centre), (point, com)):
        away = at - middle
        full = full + part * (away @ away * np.eye(3) - np.outer(away, away))
    return total, middle, full
