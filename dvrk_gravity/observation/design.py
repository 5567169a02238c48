"""The regressor of motions, behind the low-pass of the measured torque."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.effects import State
from dvrk_gravity.model import Columns
from dvrk_gravity.observation.observation import Observation

CHUNK = 2000  # samples whose regressor is held at a time; no result depends on it
# Samples kept after the filter, at most. Chosen for time and memory.
ROWS = 12_000
# Samples kept per period of the filter's cut-off, at most. Chosen: four times what the sampling
# theorem asks for, as a filter of second order does not end there.
SAMPLING = 8.0
# Samples per such period between which slopes are cubics. Chosen.
SMOOTH = 10.0


@dataclass(frozen=True, eq=False)
class Design:
    """Filtered regressor and torque at the motors.

    Attributes:
        columns: What the columns are.
        x: (N, n, p) filtered regressor.
        y: (N, n) filtered torque, N·m.
        time: (N,) s within the recording.
        part: (N,) index of the motion that a sample came from.
        state: (N, n) arrays: the motion at those samples.
        rate: Samples a second.
        measured: (N, n) whether the torque was measured; else ``x`` and ``y`` are zero.
        informative: (N, n) whether a fit may use it; else it is predicted only.
    """

    columns: Columns
    x: Array
    y: Array
    time: Array
    part: NDArray[np.int64]
    state: State
    rate: float
    measured: Mask
    informative: Mask

    @property
    def fitted(self) -> Mask:
        """(N, n) samples that a fit is made to."""
        return self.measured & self.informative

    @property
    def compared(self) -> Mask:
        """(N, n) samples that errors are computed on; all those of a motor that is never fitted."""
        return self.measured & (self.informative | ~self.fitted.any(axis=0))


def build_design(
    columns: Columns,
    motions: Sequence[Observation],
    progress: Callable[[float], None] = lambda share: None,
    chosen: Sequence[int] | None = None,
) -> Design:
    """Evaluate and filter the regressor.

    Args:
        columns: The columns.
        motions: At least one, each of one part.
        progress: Called with the share that is done, 0 to 1.
        chosen: Numbers of the columns that ``x`` has, ascending; ``None``: all.
    """
    total = sum(len(motion) for motion in motions)
    kept: list[tuple[NDArray[Any], ...]] = []
    done, rate = 0, 0.0
    for index, motion in enumerate(motions):
        low, effort = motion.filter, motion.motor_effort(columns.arm)
        assert low is not None
        measured = np.broadcast_to(motion.measured, effort.shape)
        usable = np.broadcast_to(~motion.invalid_motor_effort, effort.shape)
        dense = int(low.rate / (SAMPLING * low.cutoff))
        stride = max(1, dense, -(-total // ROWS))
        rate = low.rate / stride
        smooth = max(1, int(low.rate / (SMOOTH * low.cutoff)))
        before = None
        for start in range(low.edge, len(motion) - low.edge, CHUNK):
            stop = min(start + CHUNK, len(motion) - low.edge)
            # The filter's transients at the ends of a chunk fall into its margins.
            first, last = start - low.edge, min(stop + low.edge, len(motion))
            state = motion.state.rows(slice(first, last))
            history = columns.history(state, before, chosen)
            before = history[stop - low.edge - first].copy()
            raw = columns.regressor(state, history, smooth, chosen)
            # One grid over all chunks.
            offset = (-(start - low.edge)) % stride
            own = slice(start - first + offset, stop - first, stride)
            # Most columns do not touch most motors: nothing to filter there.
            used = raw.any(axis=0) & measured[0][:, None]
            filtered = np.zeros((len(range(*own.indices(len(raw)))), *used.shape))
            filtered[:, used] = low(raw[:, used])[own]
            rows = slice(start + offset, stop, stride)
            time = motion.time[rows]
            kept.append((
                filtered, effort[rows], time, np.full(len(time), index), motion.q[rows],
                motion.qd[rows], measured[rows], usable[rows],
            ))  # fmt: skip
            done += stop - start
            progress(done / total)
    x, y, time, part, q, qd, measured, informative = map(
        np.concatenate, zip(*kept, strict=True)
    )  # fmt: skip
    return Design(columns, x, y, time, part, State(q, qd), rate, measured, informative)
