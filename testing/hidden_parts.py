"""What hidden effects have in common: what was hidden, and typical magnitudes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from testing.hidden_plant import Torque

Random = np.random.Generator

# Effort noise of the joints sets the scale of what is hidden, N·m.
LEVEL = np.array([0.02, 0.04, 0.03, 0.01, 0.005, 0.004, 0.002])
N = len(LEVEL)
SPEED = np.array([0.25, 0.25, 0.25, 1.2, 0.7, 0.35, 1.3])  # typical of the motions, rad/s
RANGE = np.array([0.5, 0.4, 0.4, 1.5, 1.2, 0.4, 1.5])  # half the way of the motions, rad
LOADED = (1, 2, 4, 5)  # joints that feel gravity
_ROUNDS = 40
INERTIA = np.array([0.006, 0.006, 0.006, 0.0004, 0.0003, 0.0003, 0.0002])


@dataclass(frozen=True)
class Hidden:
    """What was hidden.

    Attributes:
        effect: Name in the vocabulary, ``"nothing"``, or ``"outside"`` for what has no name there.
        joints: Joints that it is said of.
        parameters: True values by the names that findings use.
    """

    effect: str
    joints: tuple[str, ...]
    parameters: Mapping[str, float]


def found(arm: Arm, effect: str, joint: int | None, **parameters: float) -> Hidden:
    """Return what was hidden on one joint, or on the arm."""
    joints = () if joint is None else (arm.joint_names[joint],)
    return Hidden(effect, joints, {name: float(value) for name, value in parameters.items()})


def size(random: Random, low: float = 1.0, high: float = 4.0) -> float:
    """Return a factor, log-uniform."""
    return float(np.exp(random.uniform(np.log(low), np.log(high))))


def sign(random: Random) -> float:
    """Return +1 or -1."""
    return float(random.choice([-1.0, 1.0]))


def on_joint(joint: int, function: Callable[[float, float, float], float]) -> Torque:
    """Return a torque on one joint from (time, its position, its velocity)."""

    def torque(time: float, q: Array, v: Array) -> Array:
        result = np.zeros_like(q)
        result[joint] = function(time, q[joint], v[joint])
        return result

    return torque


def saturated(effort: Array, part: float) -> Array:
    """Return (T,) what is read of a torque if the motor's constant falls with the current.

    The torque of a current that reads e is e (1 - part (e / E)^2), with E the largest torque.

    Args:
        effort: (T,) the torque.
        part: Below 4/27; above, no current makes E.
    """
    largest, read = np.abs(effort).max(), effort
    for _ in range(_ROUNDS):
        read = effort / (1.0 - part * (read / largest) ** 2)
    return np.asarray(read)
