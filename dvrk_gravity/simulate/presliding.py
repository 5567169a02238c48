"""Presliding friction along a motion: elements with a state, implicit in the step's velocity."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arm import N_JOINTS
from dvrk_gravity.effects import PreslidingHysteresis

Array = NDArray[np.float64]


class Presliding:
    """The elements of one term, dz = (sign(dx) - z) |dx| / displacement (Dahl 1968).

    Over one step an element pushes with what it has at the step's beginning plus its present
    stiffness times the way to come; the stiffness goes into the mass matrix, h^2 K, as an
    implicit spring's does, so that short displacements need no short steps. Along the way that was
    gone the states are exact.
    """

    def __init__(self, term: PreslidingHysteresis, scale: float) -> None:
        """Start relaxed.

        Args:
            term: The elements.
            scale: Factor on their levels.
        """
        # Elements at the joints, then at the motors; those without a level are left out.
        levels = scale * np.hstack([term.joint, term.motor])
        element, row = np.nonzero(levels)
        self._level = levels[element, row]
        self._displacement = term.displacement[element]
        self._rows = np.vstack([np.eye(N_JOINTS), term.arm.joint_to_actuator])[row]
        self._state = np.zeros(len(self._level))

    def reset(self) -> None:
        """Relax all elements."""
        self._state[:] = 0.0

    def torque(self, v: Array) -> tuple[Array, Array]:
        """Return the friction at (7,) velocities: (7,) N·m, and stiffness (7, 7) N·m/rad."""
        slope = self._level / self._displacement * (1.0 - self._state * np.sign(self._rows.dot(v)))
        return (self._level * self._state).dot(self._rows), (self._rows.T * slope).dot(self._rows)

    def go(self, way: Array) -> None:
        """Follow the joints along (7,) rad."""
        step = self._rows.dot(way)
        goal = np.sign(step)
        self._state = goal + (self._state - goal) * np.exp(-np.abs(step) / self._displacement)
