"""Inverse dynamics and joint reactions of a mechanism; Pinocchio does the recursion.

Source: "Recursive inverse dynamics", sections 1.1 (forward recursion), 1.2 (inverse
recursion) and 2.2 (what is printed, in which frame and order).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from dvrk_gravity.arms import tree
from dvrk_gravity.arrays import Array
from dvrk_gravity.errors import ConfigError, ShapeError
from dvrk_gravity.newton_euler.mechanism import JointType, Mechanism

# Component of a joint's wrench (Fx Fy Fz Mx My Mz) that its actuator carries.
_ACTUATED = {JointType.REVOLUTE: 5, JointType.PRISMATIC: 2}


@dataclass(frozen=True)
class JointLoads:
    """What the joints carry.

    A wrench is what link i-1 exerts on link i, in link i's axes, its moment about
    Q_{i-1}, where the joint sits on link i-1 (the same point as P_i unless the joint is
    prismatic): (Fx, Fy, Fz, Mx, My, Mz), N and N·m.

    Attributes:
        tau: Actuation torque, N·m, or force, N, of each joint; 0 for a rigid one. (..., n).
        wrenches: Whole wrench through each joint, actuation included. (..., n, 6).
        reactions: The constraint's part: the wrench with the actuated component 0, as the
            document prints it. (..., n, 6).
    """

    tau: Array
    wrenches: Array
    reactions: Array


def pinocchio_model(mechanism: Mechanism) -> pin.Model:
    """Return the chain as a Pinocchio model with one joint of one coordinate per link.

    A rigid joint becomes a revolute one that stays at zero: Pinocchio gives reactions
    at joints only, and merging the links would lose them.
    """
    inertias = {
        body.name: pin.Inertia(link.mass, link.com, link.inertia)
        for body, link in zip(mechanism.bodies, mechanism.links, strict=True)
    }
    return tree.pinocchio_model(mechanism.bodies, inertias, mechanism.gravity)


def inverse_dynamics(
    mechanism: Mechanism, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike
) -> JointLoads:
    """Return actuation and reactions for one sample or a trajectory.

    Args:
        mechanism: The chain with its external loads, which stay constant in the absolute frame.
        q: Positions, (..., n), rad or m; of a rigid joint the fixed angle about its z axis.
        qd: Velocities, same shape; 0 for rigid joints.
        qdd: Accelerations, same shape; 0 for rigid joints.

    Raises:
        ShapeError: Arrays that do not fit the mechanism or one another.
        ConfigError: A value that is not finite, loads that overflow, or a rigid joint that moves.
    """
    arrays = _check_motion(mechanism, q, qd, qdd)
    shape, n = arrays[0].shape, mechanism.n
    samples = [array.reshape(-1, n) for array in arrays]
    model = pinocchio_model(mechanism)
    data = model.createData()
    wrenches = np.empty((len(samples[0]), n, 6))
    for k, (position, velocity, acceleration) in enumerate(zip(*samples, strict=True)):
        if len(mechanism.forces) or len(mechanism.moments):
            pin.forwardKinematics(model, data, position)
            external = _external(mechanism, data)
            pin.rnea(model, data, position, velocity, acceleration, external)
        else:
            pin.rnea(model, data, position, velocity, acceleration)
        for i in range(n):
            wrenches[k, i] = data.f[i + 1].vector
    if not np.all(np.isfinite(wrenches)):
        raise ConfigError("q, qd, qdd", "an overflow", "values whose loads are finite")
    tau, reactions = np.zeros((len(wrenches), n)), wrenches.copy()
    for i, joint in enumerate(mechanism.joints):
        if joint.type is JointType.PRISMATIC:
            # Pinocchio's moment is about P_i; Q_{i-1} lies q behind it along z.
            wrenches[:, i, 3] -= samples[0][:, i] * wrenches[:, i, 1]
            wrenches[:, i, 4] += samples[0][:, i] * wrenches[:, i, 0]
            reactions[:, i] = wrenches[:, i]
        if joint.type is not JointType.RIGID:
            actuated = _ACTUATED[joint.type]
            tau[:, i] = wrenches[:, i, actuated]
            reactions[:, i, actuated] = 0.0
    return JointLoads(tau.reshape(shape), wrenches.reshape(*shape, 6), reactions.reshape(*shape, 6))


def _external(mechanism: Mechanism, data: pin.Data) -> list[pin.Force]:
    """Return the external wrench on each link, about P_i in the link's axes."""
    wrenches = np.zeros((mechanism.n + 1, 6))
    for *force, number, px, py, pz in mechanism.forces:
        local = data.oMi[int(number)].rotation.T @ np.array(force)
        wrenches[int(number)] += [*local, *np.cross([px, py, pz], local)]
    for *moment, number in mechanism.moments:
        wrenches[int(number), 3:] += data.oMi[int(number)].rotation.T @ np.array(moment)
    return [pin.Force(wrench) for wrench in wrenches]


def _check_motion(
    mechanism: Mechanism, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike
) -> tuple[Array, Array, Array]:
    """Return the three arrays as floats after checking shapes, values and rigid joints."""
    position, velocity, acceleration = (np.asarray(a, dtype=float) for a in (q, qd, qdd))
    if position.ndim == 0 or position.shape[-1] != mechanism.n:
        raise ShapeError("q", position.shape, f"(..., {mechanism.n}), one column per joint")
    rigid = [joint.type is JointType.RIGID for joint in mechanism.joints]
    for name, array in (("q", position), ("qd", velocity), ("qdd", acceleration)):
        if array.shape != position.shape:
            raise ShapeError(name, array.shape, f"{position.shape} like q")
        if not np.all(np.isfinite(array)):
            raise ConfigError(name, array[~np.isfinite(array)].tolist(), "finite numbers")
        moving = np.any(array.reshape(-1, mechanism.n), axis=0) & rigid
        if name != "q" and np.any(moving):
            i = int(np.flatnonzero(moving)[0])
            raise ConfigError(
                f"{name}: joint {i + 1}", array[..., i].tolist(), "0, as the joint is rigid"
            )
    return position, velocity, acceleration
