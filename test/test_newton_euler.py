"""Inverse dynamics of serial chains against checks that know nothing of the module.

Kinematics here are written anew from the document's frames, and accelerations come from
finite differences of them; MuJoCo is a second oracle.
"""

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


# Central differences of eighth order: error about h^8, rounding about 1e-16 / h^2.
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


def test_mujoco_gives_the_same_actuation_with_external_loads():
    for seed, n in enumerate([*range(1, 9)] * 2):
        rng = np.random.default_rng(seed)
        chain = random_chain(rng, n)
        q, qd, qdd = random_motion(rng, chain)
        expected, joint_ids = mujoco_inverse(chain, q, qd, qdd)
        tau = inverse_dynamics(chain, q, qd, qdd).tau
        scale = np.max(np.abs(expected))
        np.testing.assert_allclose(tau[joint_ids], expected, rtol=0, atol=1e-10 * scale)
        rigid = np.setdiff1d(np.arange(n), joint_ids)
        assert not np.any(tau[rigid])


def mujoco_inverse(chain, q, qd, qdd):
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
    tau = data.qfrc_inverse.copy()
    for *force, number, px, py, pz in chain.forces:
        k = model.body(f"link{int(number)}").id
        point = data.xpos[k] + data.xmat[k].reshape(3, 3) @ [px, py, pz]
        outside = np.zeros(model.nv)
        mujoco.mj_applyFT(model, data, np.array(force), np.zeros(3), point, k, outside)
        tau -= outside
    for *moment, number in chain.moments:
        k = model.body(f"link{int(number)}").id
        outside = np.zeros(model.nv)
        mujoco.mj_applyFT(model, data, np.zeros(3), np.array(moment), data.xpos[k], k, outside)
        tau -= outside
    return tau, moving


def test_order_of_the_rotation_angles():
    angles = [0.3, -1.1, 2.0]
    expected = Rotation.from_euler("xyz", angles).as_matrix()  # about the fixed axes, x first
    np.testing.assert_allclose(rotation_matrix(angles), expected, atol=1e-15)


def test_a_held_beam_on_paper():
    """Beam of 2 kg, centre 0.3 m out, held level: torque m g r, reaction m g upward."""
    link = Link(1.0, 2.0, np.array([0.3, 0, 0]), np.zeros((3, 3)))
    held = Mechanism((link,), (LinkJoint(JointType.REVOLUTE, np.eye(3)),))
    loads = inverse_dynamics(held, [0.0], [0.0], [0.0])
    np.testing.assert_allclose(loads.tau, [2 * 9.81 * 0.3], rtol=1e-14)
    np.testing.assert_allclose(loads.reactions, [[0, 2 * 9.81, 0, 0, 0, 0]], atol=1e-14)
    welded = replace(held, joints=(LinkJoint(JointType.RIGID, np.eye(3)),))
    loads = inverse_dynamics(welded, [0.0], [0.0], [0.0])
    assert loads.tau == 0
    np.testing.assert_allclose(loads.reactions[0, 5], 2 * 9.81 * 0.3, rtol=1e-14)


def test_a_slider_on_paper():
    """Slider q = 0.5 m out along x: its moment is about the joint's seat, not about P."""
    link = Link(0.0, 2.0, np.zeros(3), np.zeros((3, 3)))
    slider = Mechanism(
        (link,), (LinkJoint(JointType.PRISMATIC, rotation_matrix([0, np.pi / 2, 0])),)
    )
    loads = inverse_dynamics(slider, [0.5], [0.0], [3.0])
    np.testing.assert_allclose(loads.tau, [6.0], rtol=1e-14)
    expected = [0, 2 * 9.81, 0, -2 * 9.81 * 0.5, 0, 0]
    np.testing.assert_allclose(loads.reactions, [expected], atol=1e-14)


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


def test_a_reaction_is_the_wrench_without_the_actuated_component():
    rng = np.random.default_rng(10)
    chain = random_chain(rng, 6)
    kinds = [JointType.REVOLUTE, JointType.PRISMATIC, JointType.RIGID] * 2
    joints = tuple(replace(j, type=k) for j, k in zip(chain.joints, kinds, strict=True))
    chain = replace(chain, joints=joints)
    loads = inverse_dynamics(chain, *random_motion(rng, chain))
    actuated = loads.wrenches - loads.reactions
    expected = np.zeros((6, 6))
    expected[[0, 3], 5] = loads.tau[[0, 3]]
    expected[[1, 4], 2] = loads.tau[[1, 4]]
    np.testing.assert_array_equal(actuated, expected)
    assert np.all(loads.tau[[0, 1, 3, 4]] != 0)
    np.testing.assert_array_equal(loads.tau[[2, 5]], 0)


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
