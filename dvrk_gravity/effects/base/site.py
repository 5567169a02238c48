"""Where an effect acts: a value, not a text."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arms import Arm
from dvrk_gravity.effects.base.links import joint_of_link, links_of_joints

Array = NDArray[np.float64]


class Kind(Enum):
    """What kind of part of an arm an effect acts at."""

    JOINT = "joint"
    MOTOR = "motor"
    LINK = "link"
    BASE = "base"
    ARM = "arm"


@dataclass(frozen=True)
class Site:
    """A part of an arm.

    Attributes:
        kind: What kind of part.
        index: Index of the joint, of the motor, or of the body that the link is; 0 of base and
            arm.
    """

    kind: Kind
    index: int = 0

    def row(self, arm: Arm) -> Array:
        """Return the (n,) row that takes joint velocities to the velocity of a joint or motor.

        Transposed it takes a torque there to the joints.
        """
        if self.kind is Kind.MOTOR:
            return arm.joint_to_actuator[self.index]
        return np.eye(arm.n)[self.index]

    def column(self, arm: Arm) -> Array:
        """Return the (n,) column that takes a motion of a joint or motor to the joints."""
        if self.kind is Kind.MOTOR:
            return arm.actuator_to_joint[:, self.index]
        return np.eye(arm.n)[self.index]

    def unit(self, arm: Arm, unit: str) -> str:
        """Return the unit there of what is in ``unit`` where a joint turns."""
        at_joint = self.kind in (Kind.JOINT, Kind.MOTOR)
        return arm.joints[self.index].own_unit(unit) if at_joint else arm.own_unit(unit)

    def words(self, arm: Arm) -> str:
        """Return what a person calls it."""
        if self.kind in (Kind.BASE, Kind.ARM):
            return f"the {self.kind.value}"
        if self.kind is Kind.LINK and self.index not in links_of_joints(arm):
            return arm.body_names[self.index]
        joint = joint_of_link(arm, self.index) if self.kind is Kind.LINK else self.index
        name = arm.joint_names[joint]
        return name if self.kind is Kind.JOINT else f"{name}'s {self.kind.value}"


THE_ARM = Site(Kind.ARM)
THE_BASE = Site(Kind.BASE)


def joint(index: int) -> Site:
    """Return the site of a joint."""
    return Site(Kind.JOINT, index)


def motor(index: int) -> Site:
    """Return the site of a motor."""
    return Site(Kind.MOTOR, index)


def link(index: int) -> Site:
    """Return the site of the link that is a body of the arm."""
    return Site(Kind.LINK, index)
