"""The torque that a model does not expect, from momentum: no acceleration is measured.

With the generalised momentum p = M(q) qd of the model's inertias and the slope C' qd of its kinetic
energy, the equation of motion M qdd + C qd + g + friction = tau + tau_external reads

    dp/dt = tau + tau_external + C' qd - g - friction,

and the residual, which is -tau_external where the model is right, follows its low-pass

    r_k = e^(-K T) r_(k-1) + (1 - e^(-K T)) [T (tau + C' qd - g - friction) - (p_k - p_(k-1))] / T.

(De Luca and Mattone 2003; Haddadin, De Luca, Albu-Schäffer, T-RO 33(6) 2017. For a short step T it
is theirs; the exponential is the exact solution for a constant integrand, and stable for any T.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import LinearTerm, State
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.monitoring.rows import Rows

_NORMAL = 1.4826  # standard deviation over the median of magnitudes, of normal values

SLOWEST, FASTEST = 2.0 * np.pi * 1.0, 2.0 * np.pi * 5.65
"""1/s, between which gains are chosen.

A push lasts half a second and more; models know their errors below 5.65 Hz.
"""


def white_noise(values: Array) -> Array:
    """Return the (n,) standard deviations of white noise in (K, n) rows of a smooth signal.

    From second differences, whose variance is six times that of the noise; their median is not
    moved by the few in which a joint reverses.
    """
    if len(values) < 3:
        return np.zeros(values.shape[1])
    sizes = np.median(np.abs(np.diff(values, 2, axis=0)), axis=0)
    return np.asarray(_NORMAL * sizes / np.sqrt(6.0))


def local_noise(values: Array, length: int) -> Array:
    """Return the (K, n) standard deviations of white noise around each of (K, n) rows.

    As :func:`white_noise` has it, from about so many rows: in fast motion there is more than at
    rest.
    """
    from scipy.ndimage import median_filter

    if len(values) < 3:
        return np.zeros_like(values)
    sizes = np.pad(np.abs(np.diff(values, 2, axis=0)), ((1, 1), (0, 0)), mode="edge")
    return np.asarray(_NORMAL * median_filter(sizes, (length, 1), mode="reflect") / np.sqrt(6.0))


def gain_for(step: float, torque_noise: Array, momentum_noise: Array) -> Array:
    """Return the (n,) gains K at which noise of torques and of momenta contribute equally, 1/s.

    White noise of variance s_tau^2 in the torques of rows gives K T / (2 - K T) s_tau^2 in r, that
    of variance s_p^2 in the momenta 2 K^2 s_p^2 / (2 - K T): equal at K = T s_tau^2 / (2 s_p^2). A
    faster observer would amplify the noise of velocities, a slower one sees later.

    Args:
        step: T, s.
        torque_noise: (n,) standard deviations of the rows' efforts, N·m.
        momentum_noise: (n,) of their momenta, N·m·s.
    """
    balanced = step * torque_noise**2 / np.maximum(2.0 * momentum_noise**2, 1e-300)
    return np.asarray(np.clip(balanced, SLOWEST, FASTEST))


@dataclass(frozen=True, eq=False)
class ObserverOutput:
    """Residual and momentum of K rows.

    Attributes:
        residual: (K, n) low-passed measured minus expected torque, N·m.
        unexpected: (K, n) the same before the low-pass: what each row adds, N·m.
        momentum: (K, n) N·m·s.
    """

    residual: Array
    unexpected: Array
    momentum: Array

    @classmethod
    def joined(cls, each: Sequence[ObserverOutput]) -> ObserverOutput:
        """Return the outputs of consecutive rows as one."""
        names = [field.name for field in fields(cls)]
        return cls(*(np.concatenate([getattr(one, name) for one in each]) for name in names))


@dataclass(frozen=True, eq=False)
class _ObserverState:
    """State of an observer at the last row.

    Attributes:
        row: That row.
        momentum: (n,) N·m·s.
        driven: (n,) tau + C' qd - g - friction, N·m.
        memories: Internal states of the terms that have any, by their position in the model.
        residual: (n,) N·m.
    """

    row: Rows
    momentum: Array
    driven: Array
    memories: dict[int, Array]
    residual: Array


class MomentumObserver:
    """Residual of a model along rows that follow one another.

    How many rows come at a time does not matter. After a gap it starts again.

    Attributes:
        gain: (n,) K, 1/s.
    """

    def __init__(self, model: TorqueModel, gain: Array, longest_gap: float) -> None:
        """Observe the arm of a model.

        Args:
            model: The model.
            gain: (n,) K, 1/s.
            longest_gap: s between two rows, after which the observer starts again.
        """
        self.gain = gain
        self._model, self._longest = model, longest_gap
        self._last: _ObserverState | None = None

    def advance(self, rows: Rows) -> ObserverOutput:
        """Return the residual of the next (K, n) rows."""
        return ObserverOutput.joined(
            [self._advance_part(rows.at(p)) for p in rows.parts(self._longest)]
        )

    def _advance_part(self, rows: Rows) -> ObserverOutput:
        last = self._last
        if last is None or not 0.0 < rows.time[0] - last.row.time[0] <= self._longest:
            last, self._last = None, None
        known = rows if last is None else Rows.joined([last.row, rows])
        momentum, driven, memories = self._evaluate(known, {} if last is None else last.memories)
        residual, unexpected = np.zeros((2, *rows.q.shape))
        before = np.zeros(rows.q.shape[1])
        if last is not None:
            momentum[0], driven[0], before = last.momentum, last.driven, last.residual
        steps = np.diff(known.time)
        first = len(rows) - len(steps)  # of the very first row nothing is known
        mean = 0.5 * (driven[1:] + driven[:-1])
        unexpected[first:] = mean - np.diff(momentum, axis=0) / steps[:, None]
        for k, keep in enumerate(np.exp(-np.outer(steps, self.gain)), first):
            before = residual[k] = keep * before + (1.0 - keep) * unexpected[k]
        self._last = _ObserverState(
            rows.at(slice(-1, None)), momentum[-1], driven[-1], memories, before
        )
        return ObserverOutput(residual, unexpected, momentum[-len(rows) :])

    def _evaluate(
        self, rows: Rows, before: dict[int, Array]
    ) -> tuple[Array, Array, dict[int, Array]]:
        """Return (K, n) momenta, driving torques, and internal states of terms at the last row."""
        q = rows.q - self._model.joint_offset
        # Acceleration only for terms that are no inertia, and depend on it all the same.
        qdd = np.zeros_like(q)
        if len(q) > 1:
            qdd[1:] = np.diff(rows.qd, axis=0) / np.diff(rows.time)[:, None]
        state, momentum = State(q, rows.qd, qdd), np.zeros_like(q)
        driven, memories = rows.effort.copy(), dict[int, Array]()
        for number, term in enumerate(self._model.terms_in_order):
            moved = term.momentum(q, rows.qd)
            if moved is not None:
                momentum += moved[0]
                driven += moved[1] - term.torque(State(q))
            elif isinstance(term, LinearTerm):
                memory = term.memory(state, before.get(number))
                remembers = memory.shape[1] > 0
                driven -= (
                    term.columns(state, memory) @ term.theta if remembers else term.torque(state)
                )
                if remembers:
                    memories[number] = memory[-1]
            else:
                driven -= term.torque(state)
        return momentum, driven, memories
