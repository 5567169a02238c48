"""What acts on a plant, sorted by what it asks of a time step: explicit, implicit, dry."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import PlantPart

# Friction acts downwards on what moves up, upwards on what moves down.
_SIGNS = np.array([[-1.0], [1.0]])


class Effects:
    """The parts of one plant, prepared for evaluation at one state after another.

    What each part asks for is said in :class:`dvrk_gravity.effects.PlantPart`. Dry friction is a
    level for each direction of each row that rubs: the joints first, then the motors that move
    more than one joint.

    Attributes:
        damping: (n, n) viscous friction in joint space, N·m·s/rad.
        rows: (m, n) joint velocities -> velocities of what rubs.
        partly_implicit: Whether :meth:`implicit` has anything to say.
    """

    def __init__(self, arm: Arm, parts: Sequence[PlantPart], friction_scale: float = 1.0) -> None:
        """Sort the parts.

        Args:
            arm: The arm, for its transmission.
            parts: What acts.
            friction_scale: Factor on every friction: dry, viscous, drag, with memory.
        """
        to_motor = arm.joint_to_actuator
        n = len(to_motor)
        self._scale = friction_scale
        self._weight = [part.weight for part in parts if part.weight is not None]
        self._at = [part.at for part in parts if part.at is not None]
        self._drag = [part.drag for part in parts if part.drag is not None]
        self._memory = [part.memory for part in parts if part.memory is not None]
        self.partly_implicit = bool(self._drag or self._memory)
        self._nothing = np.zeros(n), np.zeros((n, n))
        self.damping = np.zeros((n, n))
        for part in parts:
            if part.damping is not None:
                self.damping += friction_scale * part.damping
        # A motor whose row is one joint's alone rubs where that joint does.
        mixed = np.diag((np.abs(to_motor - np.eye(n)).max(axis=1) > 1e-12).astype(float))
        mapping = np.block([[np.eye(n), np.zeros((n, n))], [np.eye(n) - mixed, mixed]])
        dry = [(part.dry, part.fade) for part in parts if part.dry is not None]
        rubs = np.arange(2 * n) < n  # a joint may yet get a level by its position
        for levels, _ in dry:
            rubs |= (np.abs(levels) @ mapping).any(axis=0)
        self.rows = np.ascontiguousarray(np.vstack([np.eye(n), to_motor])[rubs])
        mapping = mapping[:, rubs]
        self._joints = np.s_[:n]
        self._bounds = np.zeros((2, len(self.rows)))
        self._fading = []
        for levels, fade in dry:
            signed = _SIGNS * friction_scale * levels
            if fade is None:
                self._bounds += signed.dot(mapping)
            else:
                # What is left of each level -> both bounds of every row, by one product.
                self._fading.append((fade, np.hstack([row[:, None] * mapping for row in signed])))

    def smooth(self, q: Array, qd: Array) -> tuple[Array, Array]:
        """Evaluate what is taken at the step's beginning.

        Args:
            q: (n,) rad.
            qd: (n,) rad/s.

        Returns:
            Smooth torques (n,) N·m, as the actuators would have to apply them, and what dry
            friction can do against the motion (2, m) N·m: least (moving up), at most 0, and
            greatest (moving down), at least 0.
        """
        torque = np.zeros(len(q))
        for tree in self._weight:
            # As Tree.gravity; for matrices this small, dot takes half the time of @.
            weight = pin.computeGeneralizedGravity(tree.model, tree.data, tree.expand.dot(q))
            torque += weight.dot(tree.expand)
        bounds = self._bounds
        for at in self._at:
            value, level = at(q, qd)
            torque += value
            if level is not None:
                level = self._scale * level
                bounds = bounds.copy()
                bounds[0, self._joints] -= level
                bounds[1, self._joints] += level
        for fade, matrix in self._fading:
            bounds = bounds + fade(qd).dot(matrix).reshape(bounds.shape)
        return torque, bounds

    def implicit(self, q: Array, qd: Array, dt: float) -> tuple[Array, Array]:
        """Evaluate friction of which a part is taken at the step's end.

        Args:
            q: (n,) rad.
            qd: (n,) rad/s.
            dt: Length of the step, s.

        Returns:
            Torque (n,) N·m at the step's beginning, and what it adds to the mass matrix (n, n),
            kg·m^2, for the rest.
        """
        torque, mass = self._nothing
        for memory in self._memory:
            value, stiffness = memory.torque(qd)
            torque = torque + self._scale * value
            mass = mass + (self._scale * dt**2) * stiffness
        for drag in self._drag:
            value, damping = drag(q, qd)
            torque = torque + self._scale * value
            mass = mass + (self._scale * dt) * damping
        return torque, mass

    def go(self, way: Array) -> None:
        """Pass the (n,) displacement of a step, rad, to friction with memory."""
        for memory in self._memory:
            memory.go(way)

    def reset(self) -> None:
        """Let friction that has a memory forget the way."""
        for memory in self._memory:
            memory.reset()
