"""What a URDF and an MJCF hold, beside bodies, of the dynamics of joints and motors.

Both have viscous and dry friction at each joint, the same in both directions. An MJCF has rotors,
linear springs, and motors that move several joints (fixed tendons) as well.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import JointDynamics, separable_rotors

Format = Literal["URDF", "MJCF"]


@dataclass(frozen=True)
class FileFormat:
    """What files of a format hold beside bodies and friction at joints.

    Attributes:
        title: The format, with its article.
        motors: Rotors, and friction of motors that move several joints.
        springs: Constant torques and linear springs, at joints and between them.
        gravity: m/s^2 by which their readers let an arm fall; ``None``: a file states it.
    """

    title: str
    motors: bool
    springs: bool
    gravity: float | None = None

    def representable(self, dynamics: JointDynamics) -> JointDynamics:
        """Return the joint dynamics that a file can hold, motors of one joint being at that joint.

        Where it holds no rotors, those that turn like links are left: its bodies can have them.
        """
        arm = dynamics.arm
        sites = np.array([[1.0], [float(self.motors)]])
        if self.motors:
            inertia = _at_joints(arm, dynamics.inertia, 2)
        else:
            separable = np.isin(np.arange(arm.n), separable_rotors(arm))
            inertia = np.where(separable, 0.0, dynamics.inertia) * [[0.0], [1.0]]
        return replace(
            dynamics,
            damping=sites * _at_joints(arm, dynamics.damping, 2),
            friction=sites * _at_joints(arm, dynamics.friction, 1),
            inertia=inertia,
            constant=self.springs * dynamics.constant,
            stiffness=self.springs * dynamics.stiffness,
            coupling=self.springs * dynamics.coupling,
        )

    def missing(self, dynamics: JointDynamics) -> str:
        """Return in words which of these dynamics the format cannot hold; ``""``: it holds all."""
        rubs = dynamics.damping.any() or dynamics.friction.any()
        turns = dynamics.inertia.any()
        pulls = dynamics.constant.any() or dynamics.stiffness.any() or dynamics.coupling.any()
        if not rubs and turns and not self.motors:
            return f"{self.title} has no rotors"
        if not rubs and not self.springs:
            return f"{self.title} has nothing for it"
        lacks = [dynamics.omits] if dynamics.omits else []
        if turns and not self.motors:
            lacks.append("its rotors")
        if pulls and not self.springs:
            lacks.append("its springs")
        if not self.motors:
            alone = "that of motors that move several joints"
            lacks.append("motors' that move several" if lacks else alone)
        return ", and ".join(lacks)


FORMATS: Mapping[Format, FileFormat] = {
    "URDF": FileFormat("a URDF", motors=False, springs=False, gravity=9.81),
    "MJCF": FileFormat("an MJCF", motors=True, springs=True),
}


def _at_joints(arm: Arm, levels: Array, power: int) -> Array:
    """Return (2, n) levels at the joints, and at those motors alone that move several joints.

    Args:
        arm: The arm.
        levels: (2, n) levels at the joints and at the motors.
        power: Of a gear ratio in a level: 1 of a torque, 2 of an inertia or a damping.
    """
    (joint, motor), ratio = levels, arm.joint_to_actuator
    alone = np.count_nonzero(ratio, axis=1) == 1
    moved = (np.abs(ratio) ** power).T @ np.where(alone, motor, 0.0)
    return np.array([joint + moved, np.where(alone, 0.0, motor)])
