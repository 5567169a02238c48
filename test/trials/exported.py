"""Models of all that an MJCF can hold, and what MuJoCo makes of the file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
from made_up_arm import random_inertia
from robots import PANDA, UR5

from dvrk_gravity.arms import Arm, gravity_in_base, is_mtm, rigid_body
from dvrk_gravity.effects import (
    CoulombFriction,
    ElasticCable,
    Gravity,
    JointSpring,
    LinkInertia,
    LinkWeight,
    Payload,
    Range,
    RotorInertia,
    State,
    ViscousFriction,
    beta_map,
)
from dvrk_gravity.exports import ExportResult
from dvrk_gravity.model import TorqueModel


def load(name: str, made_up: Path) -> Arm:
    return Arm.load({"made_up": made_up, "ur5": UR5, "panda": PANDA}.get(name, name))


def physical(arm: Arm, seed: int = 0) -> np.ndarray:
    """Return (bodies, 10) of bodies that can exist."""
    random = np.random.default_rng(seed)
    return np.array([random_inertia(random).toDynamicParameters() for _ in arm.bodies])


def weight(arm: Arm, rows: np.ndarray, vector: np.ndarray) -> Gravity | LinkWeight:
    if is_mtm(arm):
        return Gravity(arm, beta_map(replace(arm, base_rpy=(0.3, 0.2, 0.0))) @ rows.ravel(), vector)
    return LinkWeight(arm, rows[:, :4], vector)


def whole(arm: Arm, tilt: tuple[float, float] = (0.2, -0.3)) -> TorqueModel:
    """Return a model of all that an MJCF can hold: at joints, at motors, in a tilted base."""
    random, rows, n = np.random.default_rng(1), physical(arm), arm.n
    some = lambda: random.uniform(0.01, 0.1, n)  # noqa: E731
    vector = gravity_in_base(*tilt)
    spring = random.normal(size=(n, n)) * 0.1
    dry = [some(), some()]
    endless = Range(np.full(n, -np.inf), np.full(n, np.inf))
    terms = (
        weight(arm, rows, vector),
        LinkInertia(arm, rows),
        Payload(arm, arm.body_names[-1], 0.3, np.array([0.01, -0.02, 0.03]), vector),
        RotorInertia(arm, some()),
        ViscousFriction(arm, some(), some()),
        CoulombFriction(
            arm, dry[0], dry[0], dry[1], dry[1], 1e-4 * np.ones(n), np.zeros(n), np.zeros(n)
        ),
        ElasticCable(arm, random.normal(size=(2, n)), endless),
        JointSpring(arm, spring + spring.T, some()),
    )
    return TorqueModel(arm, terms, joint_offset=random.uniform(-0.05, 0.05, n))


def states(arm: Arm, seed: int = 2) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    random = np.random.default_rng(seed)
    lower, upper = (np.clip(edge, -3.0, 3.0) for edge in arm.range)
    edge = 0.02 * (upper - lower)
    q = random.uniform(lower + edge, upper - edge, (20, arm.n))
    qd, qdd = random.normal(size=(2, *q.shape)) * arm.scale
    return q, qd, qdd


def without_dry(model: TorqueModel) -> TorqueModel:
    """Return a model without dry friction, which MuJoCo has as a soft constraint."""
    terms = tuple(term for term in model.terms if not isinstance(term, CoulombFriction))
    return replace(model, terms=terms)


def held_torque(exported: ExportResult, q, qd, qdd, dry: bool = True) -> np.ndarray:
    """Return the torque of what a file has: its bodies by true positions, the rest by measured."""
    held = exported.file_model
    dynamics = held.dynamics if dry else replace(held.dynamics, friction=np.zeros((2, held.arm.n)))
    bodies = (held.arm, held.links.ravel(), q - held.joint_offset, qd, qdd, held.gravity)
    return rigid_body.torque(*bodies) + dynamics.torque(State(q, qd, qdd))


def by_mujoco(text: str, arm: Arm, q, qd, qdd) -> np.ndarray:
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    names = [model.joint(i).name for i in range(model.njnt)]
    expand = np.zeros((model.nv, arm.n))
    for row, name in enumerate(names):
        if name in arm.joint_names:
            expand[row, arm.joint_names.index(name)] = 1.0
    for e in range(model.neq):
        master = names[model.eq_obj2id[e]]
        expand[model.eq_obj1id[e], arm.joint_names.index(master)] = model.eq_data[e, 1]
    out = []
    for row in zip(q, qd, qdd, strict=True):
        data.qpos[:], data.qvel[:], data.qacc[:] = (expand @ values for values in row)
        mujoco.mj_inverse(model, data)
        out.append(expand.T @ data.qfrc_inverse)
    return np.array(out)


def most(array: np.ndarray) -> float:
    return float(np.abs(array).max())
