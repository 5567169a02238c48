"""Rigid-body dynamics of any arm by Pinocchio, links that follow others included.

Pinocchio sees a tree with one joint a body; the constant matrix G (bodies, n) takes the joints of
``measured_js`` to it, and efforts and inertia back: tau = G^T tau_tree, M = G^T M_tree G. G is
constant, so no velocity terms are lost.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from dvrk_gravity.arms.description import Body, Description
from dvrk_gravity.arrays import Array


@dataclass(frozen=True, eq=False)
class Tree:
    """Rigid-body dynamics of one arm with given link inertias.

    Attributes:
        model: Pinocchio model with a joint a body, gravity set.
        data: Its workspace (one thread at a time).
        expand: (bodies, n) constant matrix G from joints to tree joints.
    """

    model: pin.Model
    data: pin.Data
    expand: Array

    def gravity(self, q: Array) -> Array:
        """Return (n,) gravity efforts at (n,) positions, N·m or N."""
        torque = pin.computeGeneralizedGravity(self.model, self.data, self.expand @ q)
        return torque @ self.expand

    def inverse_dynamics(self, q: Array, qd: Array, qdd: Array) -> Array:
        """Return (n,) efforts for a motion, N·m or N."""
        expand = self.expand
        return pin.rnea(self.model, self.data, expand @ q, expand @ qd, expand @ qdd) @ expand

    def bias(self, q: Array, qd: Array) -> Array:
        """Return (n,) gravity and velocity efforts (no acceleration), N·m or N."""
        expand = self.expand
        return pin.nonLinearEffects(self.model, self.data, expand @ q, expand @ qd) @ expand

    def mass_matrix(self, q: Array) -> Array:
        """Return the (n, n) joint-space inertia, kg·m^2 (kg, kg·m where joints slide)."""
        upper = pin.crba(self.model, self.data, self.expand @ q)
        full = np.triu(upper) + np.triu(upper, 1).T
        return self.expand.T @ full @ self.expand

    def regressor(self, q: Array, qd: Array, qdd: Array) -> Array:
        """Return the (n, 10 bodies) regressor for the bodies' inertial parameters.

        They are those of the bodies' joint frames, ten a body.
        """
        expand = self.expand
        return expand.T @ pin.computeJointTorqueRegressor(
            self.model, self.data, expand @ q, expand @ qd, expand @ qdd
        )


def build_tree(arm: Description, inertias: Mapping[str, pin.Inertia], gravity: Array) -> Tree:
    """Build the tree.

    Args:
        arm: The arm.
        inertias: Inertia of bodies by name, in their link frames (``Body.frame``); absent ones
            weigh nothing.
        gravity: (3,) gravity in the base frame, m/s^2.
    """
    model = pinocchio_model(arm.bodies, inertias, gravity)
    model.name = arm.name
    return Tree(model, model.createData(), arm.expand)


def pinocchio_model(
    bodies: Iterable[Body], inertias: Mapping[str, pin.Inertia], gravity: Array
) -> pin.Model:
    """Return bodies as a Pinocchio model, a joint a body; the arguments are ``build_tree``'s."""
    model = pin.Model()
    model.gravity.linear = np.asarray(gravity, dtype=float)
    for body in bodies:
        joint = pin.JointModelRZ() if body.kind == "revolute" else pin.JointModelPZ()
        index = model.addJoint(body.parent + 1, joint, body.placement, body.name)
        inertia = inertias.get(body.name)
        if inertia is not None:
            model.appendBodyToJoint(index, inertia, body.frame)
    return model


def link_frames(arm: Description) -> dict[str, pin.SE3]:
    """Return each link's frame seen from its joint's frame in the tree."""
    return {body.name: body.frame for body in arm.bodies}


def nominal_inertias(arm: Description) -> dict[str, pin.Inertia]:
    """Return the nominal inertia of the bodies that have one, in their link frames.

    Bodies without mass (a frame that a URDF lets turn) are left out.
    """
    if arm.inertial_parameters is None:
        return {}
    return {
        body.name: body.frame.actInv(pin.Inertia.FromDynamicParameters(row))
        for body, row in zip(arm.bodies, arm.inertial_parameters, strict=True)
        if row[0] > 0.0
    }
