"""The master arm's parallelogram: a crank and a bar that follow the elbow.

They add no freedom: relative to the arm the crank turns with q3, relative to the forearm the bar
turns with -q3. ``bar`` and ``crank`` are the seed document's 4' and 5'.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from dvrk_gravity.arms.description import Description, Joint
from dvrk_gravity.arms.dh import DHRow, Follower
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
    """Tell whether an arm is a master arm: whether beta and its names fit it.

    The file of an arm with these joints is only read if it has an MTM's angles, too.
    """
    return arm.joint_names == JOINT_NAMES and arm.body_names == BODIES


def has_mtm_names(joints: Sequence[str]) -> bool:
    """Tell whether joints have the names of a master arm's, in their order."""
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
