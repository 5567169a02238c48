"""What a robot's file, a URDF or an MJCF, can hold of torques apart from bodies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.motion import State
from dvrk_gravity.errors import ShapeError

_nothing = partial(np.zeros, ())


@dataclass(frozen=True, eq=False)
class JointDynamics:
    """Friction, rotors and linear springs, at the joints and at the motors.

    tau = c + k q + K q + d qd + f sign(qd) + i qdd + J' (d_m w + f_m sign(w) + i_m dw/dt), with
    w = J qd the motors' velocities and products by joint, K q apart. All but the arm is optional.
    Units are those of joints that turn; one that slides has N and m.

    Attributes:
        arm: The arm, for its transmission.
        damping: (2, n) d and d_m, viscous friction at the joints and at the motors, N·m·s/rad.
        friction: (2, n) f and f_m, dry friction, the same in both directions, N·m.
        inertia: (2, n) i and i_m, of rotors as joints or motors feel it, kg·m^2.
        constant: (n,) c, torque where all positions are zero, N·m.
        stiffness: (n,) k, of springs at joints, N·m/rad.
        coupling: (n, n) K, symmetric, of springs between joints, N·m/rad.
        omits: What it leaves out of the torque that it is nearest to, in words.
        directions: State -> (…, n) directions of the joints and of the motors, -1 to 1, by which
            that torque's dry friction acts, or ``None`` if they are unknown; the signs of their
            velocities if not given.

    Raises:
        ShapeError: An array of another shape.
    """

    arm: Arm
    damping: Array = field(default_factory=_nothing)
    friction: Array = field(default_factory=_nothing)
    inertia: Array = field(default_factory=_nothing)
    constant: Array = field(default_factory=_nothing)
    stiffness: Array = field(default_factory=_nothing)
    coupling: Array = field(default_factory=_nothing)
    omits: str = ""
    directions: Callable[[State], tuple[Array, Array] | None] | None = None

    def __post_init__(self) -> None:
        """Put zeros where nothing is given."""
        n = self.arm.n
        shapes = {"constant": (n,), "stiffness": (n,), "coupling": (n, n)}
        for name in ("damping", "friction", "inertia", *shapes):
            given, shape = getattr(self, name), shapes.get(name, (2, n))
            if given.shape not in ((), shape):
                raise ShapeError(name, given.shape, str(shape))
            object.__setattr__(self, name, given + np.zeros(shape))

    def torque(self, state: State) -> Array:
        """Return (…, n) torques, N·m; those of unknown velocity or acceleration are zero."""
        torque = self.constant + self.stiffness * state.q + state.q @ self.coupling
        moving = self._with_motors(state.qd)
        signs = moving and (np.sign(moving[0]), np.sign(moving[1]))
        ways = self.directions(state) if self.directions else signs
        for levels, motion in (
            (self.damping, moving),
            (self.friction, ways),
            (self.inertia, self._with_motors(state.qdd)),
        ):
            if motion is not None:
                joint, motor = motion
                torque = torque + levels[0] * joint + self.arm.joint_effort(levels[1] * motor)
        return np.asarray(torque)

    def _with_motors(self, joint: Array | None) -> tuple[Array, Array] | None:
        return None if joint is None else (joint, self.arm.actuator_position(joint))
