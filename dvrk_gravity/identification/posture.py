"""Zeros of joints and tilt of the base: what torque is not linear in.

Around a posture that is known the torque is linear in what it is off by. Those slopes are columns
of a fit like all others; its coefficients correct the posture, and the columns are taken anew
(Gauss-Newton, with everything that is linear solved for at every step).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pinocchio as pin

from dvrk_gravity import gravity
from dvrk_gravity.arm import N_JOINTS, Arm
from dvrk_gravity.effects import State, rigid_body
from dvrk_gravity.recording.data import Array

# Joint 1's zero turns everything about the vertical; joint 7's turns its link's parameters along.
OFFSETS = (1, 2, 3, 4, 5)
_STEP = 1e-6  # rad, of one-sided differences: half the digits of a double


@dataclass(frozen=True, eq=False)
class Posture:
    """Where joints and base are said to be, and the weight whose torque tells it.

    Attributes:
        offset: (7,) measured minus true position, rad.
        tilt: (2,) roll and pitch by which the base is turned further than it is said to be, rad.
        links: (90,) link parameters that the slopes are taken with; ``None``: no slopes.
        springs: (n,) what springs add to the first entries of beta, N·m.
    """

    offset: Array = field(default_factory=lambda: np.zeros(N_JOINTS))
    tilt: Array = field(default_factory=lambda: np.zeros(2))
    links: Array | None = None
    springs: Array = field(default_factory=lambda: np.zeros(0))

    def mounted(self, arm: Arm) -> Arm:
        """Return an arm with its base tilted."""
        if not self.tilt.any():
            return arm
        turn = pin.rpy.rpyToMatrix(*arm.base_rpy) @ pin.rpy.rpyToMatrix(*self.tilt, 0.0)
        return replace(arm, base_rpy=tuple(pin.rpy.matrixToRpy(turn).tolist()))

    def true(self, state: State) -> State:
        """Return a measured state with its joints where they are."""
        return replace(state, q=state.q - self.offset) if self.offset.any() else state

    def slopes(self, arm: Arm, state: State) -> Array:
        """Return (N, 7, 7) joint torques per rad of five further offsets, roll and pitch.

        Args:
            arm: The arm, its base not tilted yet.
            state: The measured motion, (N, 7) arrays.
        """
        vector = self.mounted(arm).gravity
        here = self._torque(arm, self.true(state), vector)
        columns = []
        for joint in OFFSETS:
            step = _STEP * (np.arange(N_JOINTS) == joint)
            there = replace(self, offset=self.offset + step).true(state)
            columns.append((self._torque(arm, there, vector) - here) / _STEP)
        at_rest = State(self.true(state).q)
        for axis in range(2):
            step = _STEP * (np.arange(2) == axis)
            # Weight is linear in gravity, and nothing else of the torque knows of it.
            turned = replace(self, tilt=self.tilt + step).mounted(arm).gravity
            columns.append(self._torque(arm, at_rest, (turned - vector) / _STEP))
        return np.stack(columns, axis=-1)

    def _torque(self, arm: Arm, true: State, vector: Array) -> Array:
        assert self.links is not None
        torque = rigid_body.torque(arm, self.links, true.q, true.qd, true.qdd, vector)
        columns = gravity.regressor(true.q, vector)[..., : len(self.springs)]
        return torque + columns @ self.springs
