"""Where an effect acts: a joint, a motor, a link, the base or the whole arm."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from functools import lru_cache

import numpy as np

from dvrk_gravity.arms import GRAVITY, Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.motion import Motion


class Kind(Enum):
    """Kind of part of an arm."""

    JOINT = "joint"
    MOTOR = "motor"
    LINK = "link"
    BASE = "base"
    ARM = "arm"


@dataclass(frozen=True)
class Site:
    """A part of an arm.

    Attributes:
        kind: Kind of part.
        index: Index of the joint, motor, or body that the link is; 0 of base and arm.
    """

    kind: Kind
    index: int = 0

    @classmethod
    def joint(cls, index: int) -> Site:
        """Return the site of a joint."""
        return cls(Kind.JOINT, index)

    @classmethod
    def motor(cls, index: int) -> Site:
        """Return the site of a motor."""
        return cls(Kind.MOTOR, index)

    @classmethod
    def link(cls, index: int) -> Site:
        """Return the site of the link that is a body of the arm."""
        return cls(Kind.LINK, index)

    def row(self, arm: Arm) -> Array:
        """Return the (n,) row from joint velocities to the velocity of the joint or motor.

        Its transpose takes a torque there to the joints.
        """
        if self.kind is Kind.MOTOR:
            return arm.joint_to_actuator[self.index]
        return np.eye(arm.n)[self.index]

    def column(self, arm: Arm) -> Array:
        """Return the (n,) column from a motion of the joint or motor to the joints'."""
        if self.kind is Kind.MOTOR:
            return arm.actuator_to_joint[:, self.index]
        return np.eye(arm.n)[self.index]

    def joints(self, arm: Arm) -> tuple[int, ...]:
        """Return the joint that a finding there names; none of base and arm."""
        if self.kind is Kind.LINK:
            return (joint_of_link(arm, self.index),)
        return (self.index,) if self.kind in (Kind.JOINT, Kind.MOTOR) else ()

    def unit(self, arm: Arm, unit: str) -> str:
        """Return the unit there of what is in ``unit`` on a joint that turns."""
        at_joint = self.kind in (Kind.JOINT, Kind.MOTOR)
        return arm.joints[self.index].own_unit(unit) if at_joint else arm.own_unit(unit)

    def words(self, arm: Arm) -> str:
        """Return its name in a sentence."""
        if self.kind in (Kind.BASE, Kind.ARM):
            return f"the {self.kind.value}"
        if self.kind is Kind.LINK and self.index not in links_of_joints(arm):
            return arm.body_names[self.index]
        joint = joint_of_link(arm, self.index) if self.kind is Kind.LINK else self.index
        name = arm.joint_names[joint]
        return name if self.kind is Kind.JOINT else f"{name}'s {self.kind.value}"


THE_ARM = Site(Kind.ARM)
THE_BASE = Site(Kind.BASE)


@lru_cache(maxsize=8)
def mixed_motors(arm: Arm) -> tuple[int, ...]:
    """Return the motors that move more than their own joint, or other joints with theirs."""
    off = np.abs(arm.joint_to_actuator - np.eye(arm.n)).max(axis=1)
    return tuple(int(motor) for motor in np.flatnonzero(off > 1e-9))


def effort_limits(arm: Arm, kind: Kind) -> Array:
    """Return (n,) the largest effort of each motor, at the motor or at its own joint."""
    if kind is Kind.MOTOR:
        return arm.actuator_effort_limit
    ratio = np.abs(np.diag(arm.joint_to_actuator))
    return np.where(ratio > 0.0, ratio * arm.actuator_effort_limit, arm.effort_limit)


def unit_travel(arm: Arm, kind: Kind) -> Array:
    """Return (n,) the travel of each joint, or of its motor, that corresponds to one rad."""
    if kind is not Kind.MOTOR:
        return arm.scale
    ratio = np.abs(np.diag(arm.joint_to_actuator))
    return np.where(ratio > 0.0, ratio, 1.0) * arm.scale


def encoder_sites(motion: Motion) -> Iterator[Site]:
    """Yield joints that move, and motors that move several joints of which one does.

    An encoder that does not move would only show a constant torque at other joints.
    """
    arm, moves = motion.arm, motion.moves
    for joint in np.flatnonzero(moves).tolist():
        yield Site.joint(joint)
    for motor in mixed_motors(arm) if motion.present.all() else ():
        if moves[arm.actuator_to_joint[:, motor] != 0.0].any():
            yield Site.motor(motor)


@lru_cache(maxsize=8)
def links_of_joints(arm: Arm) -> tuple[int, ...]:
    """Return the index of the body that each joint carries: of several, the one with most behind.

    An MTM's elbow moves forearm, crank and bar; the forearm carries the wrist. Where no body is
    moved by a joint alone (each of a PSM's jaws turns by half of `jaw`), others move it as well.
    """
    below = np.zeros(len(arm.bodies), dtype=int)
    for index in range(len(arm.bodies) - 1, -1, -1):
        parent = arm.bodies[index].parent
        if parent >= 0:
            below[parent] += 1 + below[index]
    alone = (arm.expand[:, None] == np.eye(arm.n)).all(axis=2)  # (bodies, n), by that joint alone
    worth = np.where(alone, below[:, None] + len(arm.bodies), below[:, None])
    worth = np.where(arm.expand != 0.0, worth, -1)
    return tuple(int(body) for body in np.argmax(worth, axis=0))


def last_link(arm: Arm) -> str:
    """Return the name of the last joint's link, usually the hand or the tool.

    It need not be the last body: of a gripper that may be a finger that follows another.
    """
    return arm.body_names[links_of_joints(arm)[-1]]


@lru_cache(maxsize=8)
def joint_of_link(arm: Arm, body: int) -> int:
    """Return the joint whose link a body is, or the last one that moves it."""
    links = links_of_joints(arm)
    if body in links:
        return links.index(body)
    while body >= 0 and not arm.bodies[body].row.any():
        body = arm.bodies[body].parent
    return int(np.flatnonzero(arm.bodies[body].row)[-1])


@lru_cache(maxsize=8)
def joints_with_weight(arm: Arm) -> tuple[int, ...]:
    """Return the joints whose link weighs on one: all but a first joint with a vertical axis."""
    first = arm.bodies[0]
    axis = first.placement.rotation[:, 2]
    upright = np.linalg.norm(np.cross(axis, arm.gravity)) < 1e-9 * GRAVITY
    turns = first.kind == "revolute" and bool(upright)
    return tuple(joint for joint in range(arm.n) if not (turns and first.row[joint]))
