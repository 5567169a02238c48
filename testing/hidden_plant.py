"""A plant with causes of torque that no model file knows of."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import PlantPart
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.simulate import Plant

Torque = Callable[[float, Array, Array], Array]
"""(time, (n,) position, (n,) velocity) -> (n,) torque that the actuators must apply, N·m."""


class HiddenPlant(Plant):
    """A :class:`Plant` with further parts, and with torques that are evaluated once a step."""

    def __init__(
        self,
        model: TorqueModel,
        links: Mapping[str, pin.Inertia],
        rotor_inertia: ArrayLike,
        parts: tuple[PlantPart, ...],
        extra: tuple[Torque, ...],
    ) -> None:
        """Build the plant; see :class:`Plant` for the other arguments and the errors.

        Args:
            model: The arm's terms.
            links: Inertia of the links.
            rotor_inertia: (n,) reflected inertia at the actuators, kg·m^2.
            parts: What acts beside the model's terms.
            extra: Further torques.
        """
        self._beside = parts
        self._extra = extra
        super().__init__(model, links, rotor_inertia)

    def _parts(self) -> tuple[PlantPart, ...]:
        return (*super()._parts(), *self._beside)

    def _current_dynamics(self) -> tuple[Array, Array, Array, Array]:
        if self._evaluated is None:
            mass, smooth, bounds, tree_q = super()._current_dynamics()
            for torque in self._extra:
                smooth = smooth + torque(self.time, self.q, self.v)
            self._evaluated = (mass, smooth, bounds, tree_q)
        return self._evaluated


class Dahl:
    """Presliding friction of one joint (Dahl 1968): dF = stiffness (v - |v| F / level) dt."""

    def __init__(self, joint: int, level: float, length: float) -> None:
        """Start relaxed.

        Args:
            joint: Index of the joint.
            level: Friction far from the last reversal, N·m.
            length: Way within which it builds up, rad: the stiffness is level / length.
        """
        self._joint, self._level, self._length = joint, level, length
        self._force = 0.0
        self._last: float | None = None

    def __call__(self, time: float, q: Array, v: Array) -> Array:
        """Return (n,) friction torque, N·m; goes on from the position of the last call."""
        position = float(q[self._joint])
        way = 0.0 if self._last is None else position - self._last
        self._last = position
        # Exact for a way in one direction.
        goal = self._level * np.sign(way)
        self._force = goal + (self._force - goal) * np.exp(-abs(way) / self._length)
        torque = np.zeros_like(q)
        torque[self._joint] = self._force
        return torque
