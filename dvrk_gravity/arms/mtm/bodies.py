"""The master arm as rigid bodies: its parallelogram, and a tree with the gravity torques of beta.

Crank and bar follow the elbow and add no freedom: relative to the arm the crank turns with q3,
relative to the forearm the bar turns with -q3. They are the seed document's 5' and 4'.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from dvrk_gravity.arms.description import GRAVITY, Description, Joint
from dvrk_gravity.arms.dh import DHRow, Follower
from dvrk_gravity.arms.tree import Tree, build_tree
from dvrk_gravity.arrays import Array
from dvrk_gravity.errors import ConfigError

JOINT_NAMES = (
    "outer_yaw",
    "shoulder_pitch",
    "elbow_pitch",
    "wrist_platform",
    "wrist_pitch",
    "wrist_yaw",
    "wrist_roll",
)
N_JOINTS = len(JOINT_NAMES)
BODIES = ("link1", "link2", "crank", "link3", "bar", "link4", "link5", "link6", "link7")
ANGLES = (  # alpha, offset of each joint, deg: what makes a chain an MTM, whatever its lengths
    (90, -90), (0, -90), (-90, 90), (90, 0), (-90, 0), (90, -90), (0, 90),
)  # fmt: skip


def is_mtm(arm: Description) -> bool:
    """Return whether an arm is a master arm, with beta's joints and bodies.

    The .yaml of an arm with these joints is only read if it has an MTM's angles, too. A URDF is not
    asked for them: its arm has links of its own, whatever their names.
    """
    return not arm.urdf and arm.joint_names == JOINT_NAMES and arm.body_names == BODIES


def has_mtm_names(joints: Sequence[str]) -> bool:
    """Return whether joints have a master arm's names, in order."""
    return tuple(joints) == JOINT_NAMES


def check(joints: Sequence[Joint], table: Sequence[DHRow]) -> None:
    """Make sure that a chain is an MTM's, whatever its lengths: gY(q) beta counts on it.

    Raises:
        ConfigError: Other joints, or other angles.
    """
    if len(joints) != N_JOINTS:
        raise ConfigError("joints", f"{len(joints)} joints", f"the {N_JOINTS} of an MTM")
    for joint, name in zip(joints, JOINT_NAMES, strict=True):
        if (joint.name, joint.kind) != (name, "revolute"):
            raise ConfigError(
                f"joints.{name}", f"{joint.kind} {joint.name}", "an MTM's joints in their order"
            )
    for joint, row, angles in zip(joints, table, ANGLES, strict=True):
        found = np.degrees([row.alpha, row.offset])
        if not np.allclose(found, angles, atol=1e-9):
            raise ConfigError(
                f"joints.{joint.name}", f"alpha {found[0]:g}, offset {found[1]:g}",
                f"alpha {angles[0]}, offset {angles[1]}, as an MTM's gravity model has them",
            )  # fmt: skip


def followers(table: Sequence[DHRow], side: float) -> tuple[Follower, Follower]:
    """Return crank and bar of an MTM.

    Their frames are both at the crank's tip: x_bar = -x2, y_bar = -y2; x_crank = z3, y_crank = -x3.

    Args:
        table: The seven rows of its DH table.
        side: Length of the parallelogram's short sides, m.
    """
    elbow = np.eye(len(table))[2]
    # The crank turns about the shoulder, starting along the arm; the bar about a point of the
    # forearm, keeping the arm's orientation.
    shoulder = pin.SE3(pin.utils.rotate("z", table[1].offset), np.zeros(3))
    turn = pin.utils.rotate("z", table[2].offset)
    tip = turn @ np.array([side, 0.0, 0.0])
    # Columns: the crank's axes in frame 3.
    axes = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    crank_frame = pin.SE3(turn @ pin.utils.rotate("x", table[2].alpha) @ axes, tip)
    bar_frame = pin.SE3(pin.utils.rotate("z", np.pi), np.array([-table[1].a, 0.0, 0.0]))
    return (
        Follower("crank", "link2", shoulder, "revolute", elbow, crank_frame),
        Follower("bar", "link3", pin.SE3(np.eye(3), tip), "revolute", 0.0 - elbow, bar_frame),
    )


def beta_tree(arm: Description, beta: Array, gravity: Array) -> Tree:
    """Build a tree whose gravity torques are those of ``beta``, for Pinocchio to evaluate.

    Beta does not determine the masses. Every link gets one kilogram, which keeps Pinocchio's
    centres of mass finite, and first moments that compensate.

    Args:
        arm: An MTM.
        beta: (10,), (12,) or (14,) base parameters, N·m.
        gravity: (3,) gravity in the base frame, m/s^2.
    """
    moment = np.zeros(14)
    moment[: len(beta)] = beta
    moment /= GRAVITY
    upper, fore, wrist = (arm.body(f"link{i}").frame for i in (2, 3, 4))
    # Of a distal frame: a is the way along its own x axis, d the one along the joint's.
    length = [float(frame.rotation[:, 0] @ frame.translation) for frame in (upper, fore)]
    h = float(wrist.translation[2])
    levers = {
        "link1": (moment[12], 0.0, moment[13]),
        "link2": (moment[0] - 6 * length[0], moment[1], 0.0),
        "link3": (moment[2] - 5 * length[1], 0.0, moment[3] - 4 * h),
        "link4": (moment[4], 0.0, 0.0),
        "link5": (moment[7], moment[5], moment[6]),
        "link6": (moment[9], 0.0, moment[8]),
        "link7": (moment[10], moment[11], 0.0),
    }
    inertias = {
        body: pin.Inertia(1.0, np.array(lever), np.zeros((3, 3))) for body, lever in levers.items()
    }
    return build_tree(arm, inertias, gravity)
