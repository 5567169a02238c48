"""Inverse dynamics of serial chains against MuJoCo; on paper: ``test_newton_euler_exercises``."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dvrk_gravity.errors import ConfigError, ShapeError
from dvrk_gravity.newton_euler import (
    JointType,
    Link,
    LinkJoint,
    Mechanism,
    inverse_dynamics,
    rotation_matrix,
)


def random_chain(rng, n, loads=2):
    """A chain of bodies that exist: inertias come from eight random point masses."""
    links, joints = [], []
    types = rng.integers(0, 3, n)
    types[rng.integers(n)] = rng.integers(0, 2)  # at least one joint moves
    for kind in types:
        points, masses = rng.normal(size=(8, 3)) * 0.2, rng.uniform(0.1, 1, 8)
        com = masses @ points / masses.sum()
        arms = points - com
        inertia = np.einsum(
            "k,kij->ij", masses, [(a @ a) * np.eye(3) - np.outer(a, a) for a in arms]
        )
        links.append(Link(rng.uniform(0, 1), masses.sum(), com, inertia))
        joints.append(LinkJoint(JointType(kind), Rotation.random(random_state=rng).as_matrix()))
    numbers = rng.integers(1, n + 1, (2, loads))
    forces = np.column_stack(
        [rng.normal(size=(loads, 3)) * 20, numbers[0], rng.normal(size=(loads, 3))]
    )
    moments = np.column_stack([rng.normal(size=(loads, 3)) * 5, numbers[1]])
    gravity = rng.normal(size=3) * 9
    return Mechanism(tuple(links), tuple(joints), gravity, forces, moments)


def random_motion(rng, chain, samples=()):
    q, qd, qdd = (rng.normal(size=(*samples, chain.n)) for _ in range(3))
    moving = np.array([joint.type != JointType.RIGID for joint in chain.joints])
    return q, qd * moving, qdd * moving


def test_every_link_is_in_dynamic_equilibrium_under_its_reactions():
    """Weight, inertia and external loads are borne by what MuJoCo says that each joint carries."""
    for seed, n in enumerate([*range(1, 9)] * 2):
        rng = np.random.default_rng(seed)
        chain = random_chain(rng, n)
        motion = random_motion(rng, chain)
        expected = mujoco_wrenches(chain, *motion)
        loads = inverse_dynamics(chain, *motion)
        atol = 1e-10 * np.abs(expected).max()
        np.testing.assert_allclose(loads.wrenches, expected, rtol=0, atol=atol)
        # The actuator carries the component along its axis, and a rigid joint has none.
        actuated = {JointType.REVOLUTE: 5, JointType.PRISMATIC: 2}
        for i, joint in enumerate(chain.joints):
            tau = 0.0
            if joint.type in actuated:
                tau, expected[i, actuated[joint.type]] = expected[i, actuated[joint.type]], 0.0
            assert loads.tau[i] == pytest.approx(tau, abs=atol)
        np.testing.assert_allclose(loads.reactions, expected, rtol=0, atol=atol)


def mujoco_wrenches(chain, q, qd, qdd):
    """Return (n, 6) what link i-1 exerts on link i, in link i's axes, about the joint's seat."""
    spec = mujoco.MjSpec()
    spec.option.gravity = chain.gravity
    body, end = spec.worldbody, np.zeros(3)
    moving = []
    for i, (link, joint) in enumerate(zip(chain.links, chain.joints, strict=True)):
        turn = joint.rotation
        if joint.type == JointType.RIGID:
            turn = turn @ Rotation.from_euler("z", q[i]).as_matrix()
        else:
            moving.append(i)
        x, y, z, w = Rotation.from_matrix(turn).as_quat()
        body = body.add_body(name=f"link{i + 1}", pos=end, quat=[w, x, y, z])
        body.mass, body.ipos, body.explicitinertial = link.mass, link.com, True
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = link.inertia
        body.fullinertia = [xx, yy, zz, xy, xz, yz]
        if joint.type != JointType.RIGID:
            slide = joint.type == JointType.PRISMATIC
            kind = mujoco.mjtJoint.mjJNT_SLIDE if slide else mujoco.mjtJoint.mjJNT_HINGE
            body.add_joint(type=kind, axis=[0, 0, 1])
        end = np.array([link.length, 0, 0])
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.qacc[:] = q[moving], qd[moving], qdd[moving]
    mujoco.mj_inverse(model, data)
    axes = data.xmat.reshape(-1, 3, 3)
    for *force, number, px, py, pz in chain.forces:
        k = int(number)
        lever = data.xpos[k] + axes[k] @ [px, py, pz] - data.xipos[k]
        data.xfrc_applied[k] += [*force, *np.cross(lever, force)]
    for *moment, number in chain.moments:
        data.xfrc_applied[int(number), 3:] += moment
    mujoco.mj_rnePostConstraint(model, data)
    wrenches = []
    for k, joint in enumerate(chain.joints, 1):
        back = q[k - 1] if joint.type == JointType.PRISMATIC else 0.0
        seat = data.xpos[k] - back * axes[k][:, 2]
        moment, force = data.cfrc_int[k, :3], data.cfrc_int[k, 3:]
        moment = moment + np.cross(data.subtree_com[model.body_rootid[k]] - seat, force)
        wrenches.append([*(axes[k].T @ force), *(axes[k].T @ moment)])
    return np.array(wrenches)


def test_order_of_the_rotation_angles():
    angles = [0.3, -1.1, 2.0]
    expected = Rotation.from_euler("xyz", angles).as_matrix()  # about the fixed axes, x first
    np.testing.assert_allclose(rotation_matrix(angles), expected, atol=1e-15)


def test_a_trajectory_is_its_samples_one_by_one():
    rng = np.random.default_rng(9)
    chain = random_chain(rng, 5)
    q, qd, qdd = random_motion(rng, chain, (2, 3))
    loads = inverse_dynamics(chain, q, qd, qdd)
    assert loads.tau.shape == (2, 3, 5)
    assert loads.reactions.shape == (2, 3, 5, 6)
    for k in np.ndindex(2, 3):
        single = inverse_dynamics(chain, q[k], qd[k], qdd[k])
        np.testing.assert_array_equal(loads.tau[k], single.tau)
        np.testing.assert_array_equal(loads.wrenches[k], single.wrenches)
    assert inverse_dynamics(chain, q[:0, 0], qd[:0, 0], qdd[:0, 0]).tau.shape == (0, 5)


def test_arrays_that_do_not_fit_are_named():
    chain = random_chain(np.random.default_rng(0), 3)
    zero = np.zeros(3)
    with pytest.raises(ShapeError, match=r"^q has shape \(2,\)"):
        inverse_dynamics(chain, zero[:2], zero, zero)
    with pytest.raises(ShapeError, match=r"^qdd has shape"):
        inverse_dynamics(chain, zero, zero, np.zeros((2, 3)))
    with pytest.raises(ConfigError, match=r"^qd: got \[nan\]"):
        inverse_dynamics(chain, zero, [0, np.nan, 0], zero)
    rigid = replace(chain, joints=tuple(replace(j, type=JointType.RIGID) for j in chain.joints))
    with pytest.raises(ConfigError, match=r"^qdd: joint 2: got 1\.0, .*rigid"):
        inverse_dynamics(rigid, [1, 2, 3], zero, [0, 1, 0])
