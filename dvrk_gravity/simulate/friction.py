"""Dry friction as a box-constrained problem of one time step, so that what sticks stands still.

With the velocity v+ at the step's end, the momentum p that the step would have without
dry friction, and rows J of what rubs (joints and motors):

    M v+ = p + J^T lambda,   -h f_up <= lambda <= h f_down,
    lambda = -h f_up where J v+ > 0,  lambda = h f_down where J v+ < 0,  J v+ = 0 between

(implicit time stepping of Coulomb friction at fixed normal load: Moreau 1988; Stewart and
Trinkle 1996). Each row is in one of three states, up, down or stuck. The states of the last
step are the first guess; block principal pivoting corrects them (Kostreva 1978; Júdice and
Pires 1994), one row at a time (Murty 1974) should the blocks cycle. The motion is solved in
the null space of the stuck rows, so a stuck arm moves by exactly nothing.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arrays import Array

_BLOCK_STEPS = 8
_SINGLE_STEPS = 400
# Impulses and speeds that round-off alone explains must not flip a state.
_IMPULSE_TOLERANCE = 1e-13
_SPEED_TOLERANCE = 1e-12
_ANY = 1e30


@dataclass(frozen=True, eq=False)
class _States:
    """What depends on the rows' states only, made once and kept.

    Attributes:
        states: (m,) 1 up, -1 down, 0 stuck.
        to_momentum: (2 m, n) bounds of the impulses, lower then upper -> generalised impulse of
            the sliding rows, which are at one of their bounds.
        stuck: (2, m) 1 where stuck, in both rows.
        any_stuck: Whether any is.
        dof: k, how many motions the stuck rows leave.
        free: (n, k) basis of the motions that the stuck rows leave.
        free_transposed: (k, n) the same, transposed.
        to_impulse: (m, n) generalised impulse -> impulses of the stuck rows, least norm.
        sliding: (m, n) J with the stuck rows zeroed.
        limits: (2, m) least and greatest speed of a sliding row; of a stuck row's impulse, what
            is added to its bounds.
    """

    states: NDArray[np.int8]
    to_momentum: Array
    stuck: Array
    any_stuck: bool
    dof: int
    free: Array
    free_transposed: Array
    to_impulse: Array
    sliding: Array
    limits: Array

    @classmethod
    def of(cls, rows: Array, states: NDArray[np.int8]) -> _States:
        stuck = states == 0
        free = _null_space(rows[stuck])
        to_impulse = np.zeros(rows.shape)
        if stuck.any():
            to_impulse[stuck] = np.linalg.pinv(rows[stuck].T)
        return cls(
            states=states.copy(),
            to_momentum=np.vstack([(states > 0)[:, None] * rows, (states < 0)[:, None] * rows]),
            stuck=np.tile(stuck.astype(float), (2, 1)),
            any_stuck=bool(stuck.any()),
            dof=free.shape[1],
            free=free,
            free_transposed=np.ascontiguousarray(free.T),
            to_impulse=to_impulse,
            sliding=np.where(stuck[:, None], 0.0, rows),
            limits=np.stack(
                [
                    np.select([stuck, states > 0], [-_IMPULSE_TOLERANCE, -_SPEED_TOLERANCE], -_ANY),
                    np.select([stuck, states < 0], [_IMPULSE_TOLERANCE, _SPEED_TOLERANCE], _ANY),
                ]
            ),
        )


@dataclass(eq=False)
class FrictionSolver:
    """Solves one step after another, starting from the last one's states.

    Attributes:
        rows: (m, n) J: joint velocities -> velocities of what rubs.
    """

    rows: Array
    _current: _States = field(init=False)
    _known: dict[bytes, _States] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        """Start with everything stuck."""
        self.reset()

    def reset(self) -> None:
        """Reset to everything stuck, as before the first step."""
        self._current = self._of(np.zeros(len(self.rows), dtype=np.int8))

    @property
    def states(self) -> NDArray[np.int8]:
        """(m,) 1 moving up, -1 moving down, 0 stuck, after the last step."""
        return self._current.states.copy()

    def solve(self, mass: Array, momentum: Array, bounds: Array) -> Array:
        """Return the velocity at the end of the step.

        Args:
            mass: (n, n) inertia with implicit damping, symmetric positive definite, kg·m^2.
            momentum: (n,) momentum at the end of the step but for dry friction, N·m·s.
            bounds: (2, m) least impulse of each row, at most 0, and greatest, at least 0, N·m·s.

        Returns:
            (n,) velocity, rad/s.
        """
        current = self._current
        flat = bounds.reshape(-1)
        for count in range(_BLOCK_STEPS + _SINGLE_STEPS):
            target = momentum + flat.dot(current.to_momentum)
            velocity = _move(mass, target, current)
            # One number a row. Sliding: its speed, with the sign that its impulse assumes.
            # Stuck: the impulse that keeps it still, which is within its bounds.
            found = current.sliding.dot(velocity)
            limits = current.limits
            if current.any_stuck:
                found += current.to_impulse.dot(mass.dot(velocity) - target)
                limits = bounds * current.stuck
                limits += current.limits
            below = found < limits[0]
            above = found > limits[1]
            wrong = below | above
            if not np.count_nonzero(wrong):
                break
            # Without friction a row may do as it likes.
            wrong &= (current.states == 0) | (bounds[1] > bounds[0])
            if not np.count_nonzero(wrong):
                break
            if count >= _BLOCK_STEPS:
                first = int(np.argmax(wrong))
                wrong[:] = False
                wrong[first] = True
            states = current.states.copy()
            stuck = states == 0
            states[wrong & ~stuck] = 0
            states[wrong & stuck & above] = -1
            states[wrong & stuck & below] = 1
            current = self._of(states)
        self._current = current
        return velocity

    def _of(self, states: NDArray[np.int8]) -> _States:
        key = states.tobytes()
        known = self._known.get(key)
        if known is None:
            known = self._known[key] = _States.of(self.rows, states)
        return known


def _move(mass: Array, momentum: Array, states: _States) -> Array:
    """Return the velocity with the stuck rows at rest: N (N^T M N)^-1 N^T p."""
    # LAPACK reads by columns: the transpose of a symmetric matrix saves it a copy.
    count = states.dof
    if count == 0:
        return np.zeros(len(momentum))
    from scipy.linalg.lapack import dposv  # slow to load

    if count == len(momentum):
        return dposv(mass.T, momentum)[1]
    reduced = states.free_transposed.dot(mass).dot(states.free)
    target = states.free_transposed.dot(momentum)
    return states.free.dot(dposv(reduced.T, target, overwrite_a=True, overwrite_b=True)[1])


def _null_space(rows: Array) -> Array:
    """Return a basis of the null space, (n, k), with exact zeros where it has none.

    Gauss-Jordan elimination rather than an SVD: the rows hold ones and ratios, and a joint
    that is stuck must come out with zeros, not with 1e-17.
    """
    work = rows.copy()
    n = rows.shape[1]
    pivots: list[int] = []
    for column in range(n):
        rank = len(pivots)
        if rank == len(work):
            break
        best = rank + int(np.argmax(np.abs(work[rank:, column])))
        if abs(work[best, column]) < 1e-9:
            continue
        work[[rank, best]] = work[[best, rank]]
        work[rank] /= work[rank, column]
        for other in range(len(work)):
            if other != rank:
                work[other] -= work[other, column] * work[rank]
        pivots.append(column)
    rest = [column for column in range(n) if column not in pivots]
    basis = np.zeros((n, len(rest)))
    basis[rest, range(len(rest))] = 1.0
    for row, column in enumerate(pivots):
        basis[column] = -work[row, rest]
    return basis + 0.0  # no minus zeros
