"""The filtered regressor of a fit: evaluated once, in chunks, behind the torque's own low-pass."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import State
from dvrk_gravity.identification.columns import Columns
from dvrk_gravity.identification.motion import CalibrationMotion

CHUNK = 2000  # samples whose regressor is held at a time; no result depends on it


@dataclass(frozen=True)
class DesignSettings:
    """How many samples a fit sees.

    Attributes:
        rows: Samples kept after the filter, at most. Chosen for time and memory; see `make
            sensitivity`.
        sampling: Samples kept for each period of the filter's cut-off, at most. Chosen: four times
            what the sampling theorem asks for, as a filter of second order does not end there.
        smooth: Samples for each such period between which slopes are cubics. Chosen.
    """

    rows: int = 12_000
    sampling: float = 8.0
    smooth: float = 10.0


@dataclass(frozen=True, eq=False)
class Design:
    """Filtered regressor and torque at the motors.

    Attributes:
        columns: What the columns are.
        x: (n, 7, p) filtered regressor.
        y: (N, n) filtered torque, N·m.
        time: (n,) s within the recording.
        part: (n,) index of the motion that a sample came from.
        state: (N, n) arrays: the motion at those samples.
        rate: Samples a second.
        measured: (N, n) whether the torque was measured; else both ``x`` and ``y`` are zero.
        told: (N, n) whether it says something besides; else it is predicted, and not fitted.
    """

    columns: Columns
    x: Array
    y: Array
    time: Array
    part: NDArray[np.int64]
    state: State
    rate: float
    measured: NDArray[np.bool_]
    told: NDArray[np.bool_]

    @property
    def fitted(self) -> NDArray[np.bool_]:
        """(N, n) samples that a fit is made to."""
        return self.measured & self.told

    @property
    def compared(self) -> NDArray[np.bool_]:
        """(N, n) samples that errors are of: of motors that are never fitted all."""
        return self.measured & (self.told | ~self.fitted.any(axis=0))


def build_design(
    columns: Columns,
    motions: Sequence[CalibrationMotion],
    progress: Callable[[float], None] = lambda share: None,
) -> Design:
    """Evaluate and filter the regressor of all columns.

    Args:
        columns: The columns.
        motions: At least one.
        progress: Called with the share that is done, 0 to 1.
    """
    total = sum(len(motion) for motion in motions)
    x, y, measured, told, time, part, q, qd = [], [], [], [], [], [], [], []
    done = 0
    rate, settings = motions[0].filter.rate, DesignSettings()
    for index, motion in enumerate(motions):
        low = motion.filter
        dense = int(low.rate / (settings.sampling * low.cutoff))
        stride = max(1, dense, -(-total // settings.rows))
        rate = low.rate / stride
        smooth = max(1, int(low.rate / (settings.smooth * low.cutoff)))
        before = None
        for start in range(low.edge, len(motion) - low.edge, CHUNK):
            stop = min(start + CHUNK, len(motion) - low.edge)
            # The filter's transients at the ends of a chunk fall into its margins.
            first, last = start - low.edge, min(stop + low.edge, len(motion))
            block = slice(first, last)
            state = motion.state.rows(block)
            history = columns.history(state, before)
            before = history[stop - low.edge - first].copy()
            raw = columns.regressor(state, history, smooth)
            # One grid over all chunks.
            offset = (-(start - low.edge)) % stride
            kept = slice(start - first + offset, stop - first, stride)
            # Most columns do not touch most motors: nothing to filter there.
            used = raw.any(axis=0) & motion.measured[:, None]
            filtered = np.zeros((len(range(*kept.indices(len(raw)))), *used.shape))
            filtered[:, used] = low(raw[:, used])[kept]
            x.append(filtered)
            rows = slice(start + offset, stop, stride)
            y.append(motion.effort[rows])
            measured.append(np.tile(motion.measured, (len(y[-1]), 1)))
            told.append(np.broadcast_to(motion.told, motion.effort.shape)[rows])
            time.append(motion.time[rows])
            part.append(np.full(len(y[-1]), index))
            q.append(motion.state.q[rows])
            assert motion.state.qd is not None
            qd.append(motion.state.qd[rows])
            done += stop - start
            progress(done / total)
    return Design(
        columns,
        np.concatenate(x),
        np.concatenate(y),
        np.concatenate(time),
        np.concatenate(part),
        State(np.concatenate(q), np.concatenate(qd)),
        rate,
        np.concatenate(measured),
        np.concatenate(told),
    )
