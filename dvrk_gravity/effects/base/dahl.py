"""Elastic contacts that yield: dz = (sign(dx) - z) |dx| / displacement (Dahl 1968)."""

from __future__ import annotations

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array


def dahl(position: Array, displacement: float, first: float) -> Array:
    """Return (N,) states of an element in [-1, 1] along (N,) positions, from its first state on.

    Between reversals z = s + (z0 - s) exp(-way / displacement), which is exact: what happens on
    the way is known as soon as the states at the reversals are, and these follow one another.
    """
    step = np.diff(position)
    if not len(step):
        return np.full(len(position), first)
    sign = np.sign(step)
    starts = np.flatnonzero(np.diff(sign, prepend=np.nan))  # of runs that go one way
    way = np.concatenate([[0.0], np.cumsum(np.abs(step))])
    ends = np.append(starts[1:], len(step))
    retained = np.exp(-(way[ends] - way[starts]) / displacement).tolist()
    at_start, state = [], first
    for goal, kept in zip(sign[starts].tolist(), retained, strict=True):
        at_start.append(state)
        # Where nothing moves, nothing is lost: of a zero step all is kept.
        state = goal + (state - goal) * kept
    run = np.repeat(np.arange(len(starts)), ends - starts)
    along = np.exp(-(way[1:] - way[starts][run]) / displacement)
    states = sign + (np.array(at_start)[run] - sign) * along
    return np.concatenate([[first], states])


def build_up(position: Array, first: Array, displacement: Array) -> Array:
    """Return (N, K, 2, n) states along (N, 2, n) positions from (K, 2, n) ``first`` ones on."""
    out = np.empty((len(position), *first.shape))
    for k, kind, index in np.ndindex(*first.shape):
        way = position[:, kind, index]
        out[:, k, kind, index] = dahl(way, float(displacement[k]), float(first[k, kind, index]))
    return out


class Elements:
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
