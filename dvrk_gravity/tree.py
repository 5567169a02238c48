"""The arm as a Pinocchio model, the parallelogram included.

The parallelogram's two links add no freedom: relative to the arm the crank
turns with q3, relative to the forearm the bar turns with -q3. Pinocchio sees a
tree of nine joints; a constant (9, 7) matrix G takes the seven joints of
``measured_js`` to it, and torques and inertia back: tau = G^T tau_tree,
M = G^T M_tree G. G is constant, so no velocity terms are lost.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from dvrk_gravity.arm import GRAVITY, N_JOINTS, Arm, Joint

Array = NDArray[np.float64]

LINKS = (*(f"link{i}" for i in range(1, N_JOINTS + 1)), "bar", "crank")
"""Bodies; ``bar`` and ``crank`` are the seed document's 4' and 5'."""

# Depth first, as Pinocchio's algorithms want it: (body, joint that moves it, sign).
_TREE = (
    ("link1", 0, 1.0),
    ("link2", 1, 1.0),
    ("crank", 2, 1.0),
    ("link3", 2, 1.0),
    ("bar", 2, -1.0),
    ("link4", 3, 1.0),
    ("link5", 4, 1.0),
    ("link6", 5, 1.0),
    ("link7", 6, 1.0),
)
TREE_LINKS = tuple(body for body, _, _ in _TREE)


@dataclass(frozen=True, eq=False)
class Tree:
    """Rigid-body dynamics of one arm with given link inertias.

    Attributes:
        model: Pinocchio model of nine joints, gravity set.
        data: Its workspace (one thread at a time).
        expand: (9, 7) constant matrix G from joints to tree joints.
    """

    model: pin.Model
    data: pin.Data
    expand: Array

    def gravity(self, q: Array) -> Array:
        """Return (7,) gravity torques at (7,) positions, N·m."""
        torque = pin.computeGeneralizedGravity(self.model, self.data, self.expand @ q)
        return torque @ self.expand

    def inverse_dynamics(self, q: Array, qd: Array, qdd: Array) -> Array:
        """Return (7,) torques for a motion, N·m."""
        expand = self.expand
        return pin.rnea(self.model, self.data, expand @ q, expand @ qd, expand @ qdd) @ expand

    def bias(self, q: Array, qd: Array) -> Array:
        """Return (7,) gravity and velocity torques (no acceleration), N·m."""
        expand = self.expand
        return pin.nonLinearEffects(self.model, self.data, expand @ q, expand @ qd) @ expand

    def mass_matrix(self, q: Array) -> Array:
        """Return the (7, 7) joint-space inertia, kg·m^2."""
        upper = pin.crba(self.model, self.data, self.expand @ q)
        full = np.triu(upper) + np.triu(upper, 1).T
        return self.expand.T @ full @ self.expand

    def regressor(self, q: Array, qd: Array, qdd: Array) -> Array:
        """Return the (7, 90) regressor for :data:`TREE_LINKS`' inertial parameters.

        They are those of Pinocchio's joint frames, ten a link.
        """
        expand = self.expand
        return expand.T @ pin.computeJointTorqueRegressor(
            self.model, self.data, expand @ q, expand @ qd, expand @ qdd
        )


def build_tree(arm: Arm, inertias: Mapping[str, pin.Inertia], gravity: Array) -> Tree:
    """Build the tree.

    Args:
        arm: The arm.
        inertias: Inertia of each of :data:`LINKS` in its link frame (distal DH; see
            :func:`link_frames` for bar and crank); absent ones weigh nothing.
        gravity: (3,) gravity in the base frame, m/s^2.
    """
    model = pin.Model()
    model.name = arm.name
    model.gravity.linear = np.asarray(gravity, dtype=float)
    placements, frames = _placements(arm), link_frames(arm)
    index: dict[str, int] = {}
    expand = np.zeros((len(_TREE), N_JOINTS))
    for row, (body, joint, sign) in enumerate(_TREE):
        parent, placement = placements[body]
        name = body if body in ("bar", "crank") else arm.joint_names[joint]
        index[body] = model.addJoint(index.get(parent, 0), pin.JointModelRZ(), placement, name)
        inertia = inertias.get(body)
        if inertia is not None:
            model.appendBodyToJoint(index[body], inertia, frames[body])
        expand[row, joint] = sign
    expand.setflags(write=False)
    return Tree(model, model.createData(), expand)


def link_frames(arm: Arm) -> dict[str, pin.SE3]:
    """Return each link's frame seen from its joint's frame in the tree.

    ``link1`` … ``link7``: distal DH frames. ``bar`` and ``crank``: both at the
    crank's tip, x_bar = -x2, y_bar = -y2; x_crank = z3, y_crank = -x3.
    """
    frames = {f"link{i}": _dh(joint) for i, joint in enumerate(arm.joints, start=1)}
    half_turn = pin.utils.rotate("z", np.pi)
    frames["bar"] = pin.SE3(half_turn, np.array([-arm.joints[1].a, 0.0, 0.0]))
    offset = pin.utils.rotate("z", arm.joints[2].offset)
    tip = offset @ np.array([arm.parallelogram, 0.0, 0.0])
    # Columns: the crank's axes in frame 3.
    axes = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    frames["crank"] = pin.SE3(offset @ pin.utils.rotate("x", arm.joints[2].alpha) @ axes, tip)
    return frames


def beta_tree(arm: Arm, beta: Array, gravity: Array) -> Tree:
    """Build a tree whose gravity torques are those of ``beta``, for Pinocchio to evaluate.

    Masses cannot be told from beta. Every link gets one kilogram, which keeps
    Pinocchio's centres of mass finite, and first moments that make up for it.

    Args:
        arm: The arm.
        beta: (10,), (12,) or (14,) base parameters, N·m.
        gravity: (3,) gravity in the base frame, m/s^2.
    """
    moment = np.zeros(14)
    moment[: len(beta)] = beta
    moment /= GRAVITY
    wrist = arm.joints[3].d
    levers = {
        "link1": (moment[12], 0.0, moment[13]),
        "link2": (moment[0] - 6 * arm.joints[1].a, moment[1], 0.0),
        "link3": (moment[2] - 5 * arm.joints[2].a, 0.0, moment[3] - 4 * wrist),
        "link4": (moment[4], 0.0, 0.0),
        "link5": (moment[7], moment[5], moment[6]),
        "link6": (moment[9], 0.0, moment[8]),
        "link7": (moment[10], moment[11], 0.0),
    }
    inertias = {
        body: pin.Inertia(1.0, np.array(lever), np.zeros((3, 3))) for body, lever in levers.items()
    }
    return build_tree(arm, inertias, gravity)


def _dh(joint: Joint) -> pin.SE3:
    """Distal frame seen from the joint's frame at q: Rz(offset) Tz(d) Tx(a) Rx(alpha)."""
    turn = pin.utils.rotate("z", joint.offset)
    translation = turn @ np.array([joint.a, 0.0, joint.d])
    return pin.SE3(turn @ pin.utils.rotate("x", joint.alpha), translation)


def _placements(arm: Arm) -> dict[str, tuple[str, pin.SE3]]:
    """Return, for each body, its parent body and its joint's frame seen from the parent's."""
    placements = {"link1": ("", pin.SE3.Identity())}
    for i, joint in enumerate(arm.joints[:-1], start=1):
        placements[f"link{i + 1}"] = (f"link{i}", _dh(joint))
    # The crank turns about the shoulder, starting along the arm; the bar about a
    # point of the forearm, keeping the arm's orientation.
    shoulder = pin.SE3(pin.utils.rotate("z", arm.joints[1].offset), np.zeros(3))
    placements["crank"] = ("link2", shoulder)
    turn = pin.utils.rotate("z", arm.joints[2].offset)
    pivot = turn @ np.array([arm.parallelogram, 0.0, 0.0])
    placements["bar"] = ("link3", pin.SE3(np.eye(3), pivot))
    return placements
