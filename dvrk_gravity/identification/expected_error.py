"""What a model expects of itself on a recording: its error, and where it was not identified.

By a model's posterior its torque is off by T u + e, u ~ N(0, 1), and e its error on data that the
fit had not seen. The mean square of that over a recording is a quadratic form of normal variables;
its quantiles are those of a scaled chi-square with the same mean and variance (Satterthwaite 1946).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.effects import State
from dvrk_gravity.model import ModelUncertainty, TorqueModel

_PIECE = 4000  # samples whose columns fit into memory together
_PIECES = 5  # of a recording that are looked at: a bound on time
_SAME_BAND = 0.01  # relative difference of cut-offs that count as one. Chosen: rounding
# The known error is that of held-out blocks of one motion. In another one within the identified
# range RMSE over its expectation was 1.22 in the median, and its logarithm had a standard deviation
# of 0.31, the square root of one over twice the degrees of freedom: what a model lacks depends on
# where and how fast the arm moves. 91 joints of `benchmark/prediction_bands.py --arms
# chain,ur5,psm --seeds 2 8`, without these two numbers.
OTHER_MOTION = 1.22
_DOF = 5.0
_SHIFT = 1e-3  # rad (Arm.scale), of a central difference quotient


@dataclass(frozen=True)
class ExpectedError:
    """RMS error that a model expects of itself at one joint.

    Attributes:
        rmse: Root of the expected mean square, N·m or N.
        low: Lower end of its 95 % band.
        high: Upper end.
    """

    rmse: float
    low: float
    high: float

    def to_json(self) -> dict[str, object]:
        """Return its part of ``evaluate --json``."""
        return {"rmse": self.rmse, "ci95": [self.low, self.high]}


def expected_errors(
    model: TorqueModel, states: Iterable[State], cutoff: float | None, seconds: float
) -> tuple[ExpectedError | None, ...]:
    """Return what a model expects of its RMS error at each joint, in joint space.

    ``None`` where that is not known: of a model without uncertainty, of one whose known error is of
    poses for a trajectory or the reverse, and below another cut-off.

    Args:
        model: The model.
        states: (N, n) measured states, each of samples in a row.
        cutoff: Of the low-pass behind which errors are compared, Hz; ``None`` of poses.
        seconds: Duration of the recording; poses count as independent.
    """
    from scipy.special import gammaincinv

    known, n = model.uncertainty, model.arm.n
    if known is None or model.of_file or not _same_band(known.band, cutoff):
        return (None,) * n
    states = list(states)
    gram, count = np.zeros((n, known.size, known.size)), 0
    for piece in _pieces(states):
        columns = _columns(model, known, piece)
        gram += np.einsum("tja,tjb->jab", columns, columns, optimize=True)
        count += len(columns)
    gram /= max(count, 1)
    # Of errors that last, one correlation time has one.
    samples = sum(len(state.q) for state in states)
    independent = np.full(n, float(samples))
    if cutoff is not None:
        independent = np.minimum(independent, seconds / known.correlation_time)
    found: list[ExpectedError | None] = []
    for joint, square in enumerate(((OTHER_MOTION * known.error) ** 2).tolist()):
        if not np.isfinite([square, independent[joint]]).all() or not square > 0.0:
            found.append(None)
            continue
        spread = float(np.sum(gram[joint] ** 2))  # squares of all eigenvalues
        mean = square + float(np.trace(gram[joint]))
        relative = 1.0 / max(independent[joint], 1.0) + 1.0 / _DOF
        variance = 2.0 * spread + 2.0 * square**2 * relative
        dof = 2.0 * mean**2 / variance
        chi_square = 2.0 * gammaincinv(0.5 * dof, [0.025, 0.975])
        low, high = np.sqrt(mean / dof * chi_square).tolist()
        found.append(ExpectedError(float(np.sqrt(mean)), low, high))
    return tuple(found)


def outside_range(
    model: TorqueModel, q: Array, qd: Array | None, recorded: Mask
) -> tuple[str, ...]:
    """Return where (N, n) measured motions lie outside the range of a model's identification.

    Args:
        model: The model; nothing is said of one without uncertainty.
        q: Measured positions, rad or m.
        qd: Velocities, rad/s or m/s; ``None`` of poses.
        recorded: (n,) joints that were recorded.
    """
    if model.uncertainty is None:
        return ()
    true = q - model.joint_offset
    return tuple(model.uncertainty.outside(model.arm.joints, true, qd, recorded))


def _same_band(band: float, cutoff: float | None) -> bool:
    if cutoff is None or np.isnan(band):
        return cutoff is None and bool(np.isnan(band))
    return abs(band - cutoff) <= _SAME_BAND * cutoff


def _pieces(states: list[State]) -> Iterator[State]:
    """Yield pieces of samples in a row, some of them where there are many."""
    pieces = [
        _part(state, slice(first, first + _PIECE))
        for state in states
        for first in range(0, len(state.q), _PIECE)
    ]
    chosen = np.linspace(0, len(pieces) - 1, min(_PIECES, len(pieces))).round().astype(int)
    yield from (pieces[index] for index in chosen.tolist())


def _part(state: State, rows: slice) -> State:
    parts = (
        None if values is None else values[rows]
        for values in (state.q, state.qd, state.qdd, state.direction)
    )
    q, qd, qdd, direction = parts
    assert q is not None
    return State(q, qd, qdd, direction)


def _columns(model: TorqueModel, known: ModelUncertainty, state: State) -> Array:
    """Return (N, n, d) torques by which a model may be off, one standard deviation each."""
    true = replace(state, q=state.q - model.joint_offset)
    columns = known.torque(model.terms, true)
    for joint in np.flatnonzero(known.offset.any(axis=1)).tolist():
        shift = _SHIFT * model.arm.scale[joint] * np.eye(model.arm.n)[joint]
        there, back = (
            model.torque_at(replace(state, q=state.q + way * shift)) for way in (1.0, -1.0)
        )
        slope = (there - back) / (2.0 * shift.sum())
        columns = columns - slope[:, :, None] * known.offset[joint]
    return columns
