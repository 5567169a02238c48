"""Dahl's element (Dahl 1968), along a recorded path and in a simulation.

dz = (sign(dx) - z) |dx| / displacement: friction that builds up with displacement after a reversal.
"""

from __future__ import annotations

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.motion import Motion


def dahl(position: Array, displacements: Array, first: Array) -> Array:
    """Return (N, K) states of elements in [-1, 1] along (N,) positions, from (K,) first ones on.

    Between reversals z = s + (z0 - s) exp(-way / displacement), which is exact: what happens on
    the way is known as soon as the states at the reversals are, and these follow one another.
    """
    step = np.diff(position)
    states = np.empty((len(position), len(displacements)))
    states[:1] = first
    if not len(step):
        return states
    sign = np.sign(step)
    starts = np.flatnonzero(np.diff(sign, prepend=np.nan))  # of runs that go one way
    way = np.concatenate([[0.0], np.cumsum(np.abs(step))])
    ends = np.append(starts[1:], len(step))
    goals = sign[starts].tolist()
    run = np.repeat(np.arange(len(starts)), ends - starts)
    since = way[1:] - way[starts][run]
    for k, displacement in enumerate(displacements):
        retained = np.exp(-(way[ends] - way[starts]) / displacement).tolist()
        at_start, state = [], float(first[k])
        for goal, kept in zip(goals, retained, strict=True):
            at_start.append(state)
            # Where nothing moves, nothing is lost: of a zero step all is kept.
            state = goal + (state - goal) * kept
        along = np.exp(-since / displacement)
        states[1:, k] = sign + (np.array(at_start)[run] - sign) * along
    return states


def dahl_of_parts(position: Array, displacement: float, first: Array, motion: Motion) -> Array:
    """Return (N,) states of an element along the parts of a motion.

    Args:
        position: (N,) of its site.
        displacement: rad.
        first: (N,) states, those at the first sample of each part.
        motion: The motion.
    """
    length = np.array([displacement])
    parts = (dahl(position[part], length, first[part][:1]) for part in motion.parts)
    return np.concatenate(list(parts))[:, 0]


class DahlElements:
    """Elements at joints and motors on their way through a simulation.

    Over one step an element pushes with what it has at the step's beginning plus its present
    stiffness times the way to come; the stiffness goes into the mass matrix, h^2 K, as an
    implicit spring's does, so that short displacements need no short steps. Along the way that was
    gone the states are exact.
    """

    def __init__(self, arm: Arm, displacement: Array, joint: Array, motor: Array) -> None:
        """Start relaxed.

        Args:
            arm: The arm, for its transmission.
            displacement: (K,) rad.
            joint: (K, n) levels at the joints, N·m.
            motor: (K, n) levels at the motors, N·m.
        """
        # Elements at the joints, then at the motors; those without a level are left out.
        levels = np.hstack([joint, motor])
        element, row = np.nonzero(levels)
        self._level = levels[element, row]
        self._displacement = displacement[element]
        to_motor = arm.joint_to_actuator
        self._rows = np.vstack([np.eye(len(to_motor)), to_motor])[row]
        self._state = np.zeros(len(self._level))

    def reset(self) -> None:
        """Relax all elements."""
        self._state[:] = 0.0

    def torque(self, qd: Array) -> tuple[Array, Array]:
        """Return the friction at (n,) velocities: (n,) N·m, and stiffness (n, n) N·m/rad."""
        slope = self._level / self._displacement
        slope = slope * (1.0 - self._state * np.sign(self._rows.dot(qd)))
        return (self._level * self._state).dot(self._rows), (self._rows.T * slope).dot(self._rows)

    def go(self, way: Array) -> None:
        """Follow the joints along (n,) rad."""
        step = self._rows.dot(way)
        goal = np.sign(step)
        self._state = goal + (self._state - goal) * np.exp(-np.abs(step) / self._displacement)
